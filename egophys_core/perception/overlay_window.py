"""The part of a view that is magnified, and that follows the object calmly."""

from dataclasses import dataclass

import numpy as np

MARGIN = 1.5
"""Side of the window over that of the object, so that the hand beside it shows too."""
SMALLEST_SHARE = 0.2
"""Of the view's side: a window magnifies five times at most."""
CALM = 0.15
"""Share of the way to the object that a window goes from view to view."""


@dataclass(frozen=True, kw_only=True)
class Window:
    """A square of a view."""

    centre: np.ndarray
    """[2] float64, x and y, pixels."""
    side: float
    """Pixels."""

    @property
    def corner(self) -> np.ndarray:
        """[2] pixels: upper left."""
        return np.asarray(self.centre - self.side / 2)

    def matrix(self, side: int) -> np.ndarray:
        """[2, 3]: pixels of the view to those of a picture `side` pixels wide; pixel centres at integers."""
        scale = side / self.side
        return np.column_stack([scale * np.eye(2), (side - 1) / 2 - scale * self.centre])

    def magnified(self, pixels: np.ndarray, side: int) -> np.ndarray:
        """[N, 2]: pixels [N, 2] of the view in such a picture."""
        matrix = self.matrix(side)
        return np.asarray(pixels * matrix[0, 0] + matrix[:, 2])


def follow(mask: np.ndarray, previous: Window | None = None) -> Window:
    """The window for the object's mask [S, S]: inside the view, near the previous one; that one if the mask is empty.

    Without a previous one it is where it should be; without either it is the whole view.
    """
    view = mask.shape[0]
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) == 0:
        return previous or Window(centre=np.full(2, (view - 1) / 2), side=float(view))
    low, high = np.array([columns[0], rows[0]]), np.array([columns[-1], rows[-1]])
    side = float(np.clip(MARGIN * (high - low + 1).max(), SMALLEST_SHARE * view, view))
    centre = (low + high) / 2
    if previous is not None:
        side = previous.side + CALM * (side - previous.side)
        centre = previous.centre + CALM * (centre - previous.centre)
    return Window(centre=centre.clip(side / 2 - 0.5, view - side / 2 - 0.5), side=side)
