"""Arrays that the host reads and writes in every frame."""

import numpy as np
import warp as wp


class HostAccess:
    """An array on a device. On a CPU the host uses its memory: copies of ten arrays took a tenth of a rollout."""

    def __init__(self, array: wp.array) -> None:
        """Of an array that stays where it is."""
        self._array = array
        self._memory = array.numpy() if array.device.is_cpu else None

    def read(self) -> np.ndarray:
        """What is there now; on a CPU it changes with the array."""
        return self._array.numpy() if self._memory is None else self._memory

    def write(self, values: np.ndarray) -> None:
        """Put values of the array's shape and kind there."""
        if self._memory is None:
            self._array.assign(values)
        else:
            self._memory[...] = values
