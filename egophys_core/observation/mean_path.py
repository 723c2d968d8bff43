"""How something moves on the whole whose points are seen now and then."""

import numpy as np

SEEN_SHARE = 0.6
"""Of the frames in which a point is seen at least, to tell how it moves with the others."""

ROUNDS = 20


def points_seen_mostly(positions: np.ndarray) -> np.ndarray:
    """Indices of the points [F, P, 3] that are seen in most frames; NaN where they are not."""
    return np.flatnonzero(np.isfinite(positions).all(axis=2).mean(axis=0) >= SEEN_SHARE)


def mean_path(positions: np.ndarray) -> np.ndarray:
    """[F, 3] the mean of points [F, P, 3] in each frame, as if each were seen in all; NaN in frames without any.

    Each point is taken to stay where it is beside the mean: what is not seen in a frame does not move the mean of the
    others. Of points that are seen in all frames it is the mean.
    """
    places = np.asarray(positions, np.float64)
    seen = np.isfinite(places).all(axis=2)
    places = np.where(seen[:, :, None], places, 0.0)
    frames, points = (np.maximum(seen.sum(axis=axis), 1)[:, None] for axis in (1, 0))
    beside = places.sum(axis=0) / points
    for _ in range(ROUNDS):
        path = (places - seen[:, :, None] * beside).sum(axis=1) / frames
        beside = (places - seen[:, :, None] * path[:, None]).sum(axis=0) / points
    known = seen.any(axis=0)
    path = path + beside[known].sum(axis=0) / max(known.sum(), 1)
    return np.asarray(np.where(seen.any(axis=1)[:, None], path, np.nan))
