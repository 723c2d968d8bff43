"""Adam (Kingma and Ba, "Adam: a method for stochastic optimization", 2015)."""

import numpy as np

FIRST_DECAY, SECOND_DECAY = 0.9, 0.999
SMALLEST = 1e-12
"""Guards the division where a derivative has always been 0."""


class Adam:
    """Running moments of a gradient."""

    def __init__(self, *, rate: float, size: int) -> None:
        """For `size` numbers; `rate` is about the largest change per step."""
        self._rate, self._count = rate, 0
        self._first, self._second = np.zeros(size), np.zeros(size)

    def step(self, gradient: np.ndarray) -> np.ndarray:
        """What to subtract from the numbers now, [size]."""
        self._count += 1
        self._first = FIRST_DECAY * self._first + (1 - FIRST_DECAY) * gradient
        self._second = SECOND_DECAY * self._second + (1 - SECOND_DECAY) * gradient**2
        mean = self._first / (1 - FIRST_DECAY**self._count)
        spread = np.sqrt(self._second / (1 - SECOND_DECAY**self._count))
        return self._rate * mean / (spread + SMALLEST)
