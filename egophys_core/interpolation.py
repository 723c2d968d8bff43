"""Records read at other times than those of their samples: values linearly, orientations along the shortest turn."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


def values_at(times: ArrayLike, record: ArrayLike, at: ArrayLike) -> np.ndarray:
    """A record [T, ...] at other times [F], seconds, as [F, ...]; before and after it its first and last sample."""
    values = np.asarray(record)
    found = [np.interp(np.asarray(at), np.asarray(times), column) for column in values.reshape(len(values), -1).T]
    return np.stack(found, axis=-1).reshape((*np.shape(at), *values.shape[1:]))


def tracks_at(times: np.ndarray, tracks: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Tracks [T, N, 3] at other times [F], seconds, as [F, N, 3]; NaN beyond their ends and beside unseen places."""
    before = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    share = ((at - times[before]) / (times[before + 1] - times[before]))[:, None, None]
    found = (1.0 - share) * tracks[before] + share * tracks[before + 1]
    found[(at < times[0]) | (at > times[-1])] = np.nan
    return found


class PosesOverTime:
    """Poses at increasing times; before and after them the first and the last."""

    def __init__(self, times: np.ndarray, positions: np.ndarray, rotations: "Rotation") -> None:
        """Positions [T, 3] and T rotations at times [T], in any one unit."""
        # Who reads values alone, as the light rooms do, loads no SciPy.
        from scipy.spatial.transform import Slerp

        self._times = times
        self._positions = positions
        self._rotations = rotations
        self._slerp = Slerp(times, rotations) if len(times) > 1 else None

    def at(self, times: np.ndarray | float) -> tuple[np.ndarray, "Rotation"]:
        """Positions [..., 3] and rotations at times [...], none or one axis."""
        inside = np.clip(times, self._times[0], self._times[-1])
        if self._slerp is not None:
            return values_at(self._times, self._positions, inside), self._slerp(inside)
        only = np.zeros(np.shape(times), int)
        return self._positions[only], self._rotations[only]
