"""Mounting: what markers say once it is set aside where they, and the clamp, were fixed.

Markers are measured to hundredths of a millimetre, and every record is mounted anew: half a degree at a clamp moves
the tip of a beam by a millimetre, all the time. A twin that is bent to make up for that moves otherwise than the real
thing.
"""

import numpy as np
from scipy.spatial.transform import Rotation

SHARE = 0.2
"""Share of a marker's mean offset over a record that counts: enough to keep a twin from hanging elsewhere."""

MOST_TURN = np.radians(5.0)
"""Radians by which a record is mounted aslant at most; a clamp's own markers turned by 2.6 degrees between records."""


def as_mounted(
    predicted: np.ndarray, bound: np.ndarray, observed: np.ndarray, clamp: np.ndarray, frames: int
) -> np.ndarray:
    """Predicted nodes [F, N, 3] metres, all turned about a clamp as the record is mounted.

    How, the first frames tell: the rotation that leaves their markers least off (Kabsch), `MOST_TURN` at most.

    Args:
        predicted: finite.
        bound: [P] the node of each marker, -1 for none.
        observed: [F, P, 3] metres; NaN where not seen.
        clamp: [3] metres, where it is held.
        frames: how many of them tell it.
    """
    tracks = np.flatnonzero(bound >= 0)
    seen = np.isfinite(observed[:frames, tracks]).all(axis=2)
    arms = predicted[:frames, bound[tracks]][seen] - clamp, observed[:frames, tracks][seen] - clamp
    turn = Rotation.align_vectors(arms[1], arms[0])[0].as_rotvec()
    size = float(np.linalg.norm(turn))
    turn *= min(1.0, MOST_TURN / size) if size else 0.0
    return np.asarray(clamp + (predicted - clamp) @ Rotation.from_rotvec(turn).as_matrix().T)


def beside_mounting(means: np.ndarray) -> np.ndarray:
    """Block means [K, B, Q, 3] of offsets with most of each marker's mean over the record taken off; NaN stays."""
    seen = np.isfinite(means)
    total = np.where(seen, means, 0.0).sum(axis=1, keepdims=True)
    return np.asarray(means - (1.0 - SHARE) * total / np.maximum(seen.sum(axis=1, keepdims=True), 1))
