"""What a camera with a point tracker makes of the true places: occlusion, dropouts, noise."""

import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.rehearsal.injection import Effects
from egophys_core.rehearsal.options import RehearsalOptions

CAMERA = np.array([-0.35, 0.35, 0.6])
"""Metres: where the head with the camera is."""

COVER_RADIUS = 0.007
"""Metres around the line of sight to a point within which another point of the object hides it."""

HAND_COVER_RADIUS = 0.012
"""Metres, the same for a point of a hand."""

COVER_DEPTH = 0.03
"""Metres that what hides a point is nearer to the camera, at least."""

CONFIDENCE = 0.9
"""Of every point that is seen."""


def observe(
    points: np.ndarray, hands: np.ndarray, options: RehearsalOptions, effects: Effects, random: np.random.Generator
) -> np.ndarray:
    """One frame.

    Args:
        points: [N, 3] metres, where the tracked points truly are.
        hands: [C, 3] metres, the points of the hands, which hide what is behind them.
        options: how well it is seen.
        effects: what is injected; here a tracker that is off.
        random: of dropouts and noise.

    Returns:
        [N, 3] float32, metres; NaN where a point is not seen.
    """
    seen = random.random(len(points)) >= options.dropout
    if options.occlusion:
        seen &= ~_covered(points, points, COVER_RADIUS) & ~_covered(points, hands, HAND_COVER_RADIUS)
    noisy = points + random.normal(scale=options.noise_m, size=points.shape)
    return np.where(seen[:, None], mistracked(noisy, effects), np.nan).astype(np.float32)


def mistracked(points: np.ndarray, effects: Effects) -> np.ndarray:
    """Points [N, 3] in the frame of a tracker that is off as injected."""
    if "tracking_scale" in effects:
        points = effects["tracking_scale"]["scale"] * points
    points = in_tracking_frame(points, effects)
    if "tracking_offset" in effects:
        points = points + np.array([effects["tracking_offset"][axis] for axis in ("x", "y", "z")])
    return points


def in_tracking_frame(points: np.ndarray, effects: Effects) -> np.ndarray:
    """Points [N, 3], of the object or of hands, as a tracker whose frame is turned as injected records them."""
    if "tracking_rotation" not in effects:
        return points
    turn = Rotation.from_rotvec([*(effects["tracking_rotation"][axis] for axis in ("about_x", "about_y")), 0.0])
    return np.asarray(turn.apply(points))


def _covered(points: np.ndarray, covers: np.ndarray, radius: float) -> np.ndarray:
    """[N] whether one of `covers` [M, 3] is between the camera and each of `points` [N, 3]."""
    to_points, to_covers = points - CAMERA, covers - CAMERA
    depths = np.linalg.norm(to_points, axis=1)
    sight = to_points / depths[:, None]
    along = sight @ to_covers.T
    beside = np.sum(to_covers**2, axis=1) - along**2
    return np.any((beside < radius**2) & (along < depths[:, None] - COVER_DEPTH), axis=1)
