"""Where a hand holds or pushes, and how far away that is, by its landmarks.

Landmarks come twice, in pixels and in metres about the hand's middle; how large the hand is in the view tells how deep
in it. The hand is moved and slightly turned so that its landmarks project to their pixels (robust least squares).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from egophys_core.perception.stages import HandLandmarks

WRIST, THUMB_TIP, INDEX_KNUCKLE, INDEX_TIP, MIDDLE_KNUCKLE = 0, 4, 5, 8, 9
TIPS = (4, 8, 12, 16, 20)

FEWEST_LANDMARKS = 6
"""Of one hand: as many as the unknowns, twice over."""

SMALLEST_PX, SMALLEST_M = 2.0, 0.005
"""Of the spread of the landmarks (root mean square): less is a point, not a hand."""

LONGEST_M = 0.25
"""Metres: no landmark is farther from the middle of a hand."""

WIDEST = 4.0
"""Tangent of the angle from the optical axis beyond which no landmark is seen: 76 degrees."""

NEAREST_M = 0.02
"""Metres: nothing is nearer to the camera."""

NOISE_SHARE = 0.1
"""Of that spread: error of a landmark. MediaPipe's authors give 10 to 13 % of a palm (Zhang et al., "MediaPipe Hands:
On-device Real-time Hand Tracking", 2020)."""

TURN_SIGMA = 0.2
"""Radians: error of the orientation of the metric landmarks; a tenth of the hand over half of its length."""

WORST_FIT = 0.05
"""Share of the depth: where its error by the fit alone is larger, the two sets of landmarks are not of one hand."""

HAND_SIZE_SHARE = 0.06
"""Standard deviation of the length of adults' hands (women and men, 187 +- 12 mm or so), of which metric landmarks know
nothing: error of a depth by them, the same in all views of one person."""


@dataclass(frozen=True, kw_only=True)
class LandmarkGrip:
    """Where a hand holds or pushes, by its landmarks."""

    pixel: np.ndarray
    """[2] x, y."""
    depth: float
    """Metres along the optical axis there."""
    sigma: float
    """Metres: standard deviation of the depth, by the fit, by how people's hands differ in size, and of a landmark."""


def landmark_grip(hand: HandLandmarks, camera_matrix: np.ndarray) -> LandmarkGrip | None:
    """Where a hand holds or pushes; None if its landmarks do not tell.

    Args:
        hand: with any numbers.
        camera_matrix: [3, 3] pixels.
    """
    known = _possible(hand, camera_matrix)
    acting = acting_landmarks(np.where(known[:, None], hand.metric, np.nan))
    if np.count_nonzero(known) < FEWEST_LANDMARKS or not known[acting].all():
        return None
    spread_px, spread_m = _spread(hand.pixels[known]), _spread(hand.metric[known][:, :2])
    if spread_px < SMALLEST_PX or spread_m < SMALLEST_M:
        return None
    fit = _Fit(
        pixels=hand.pixels[known],
        metric=hand.metric[known],
        camera_matrix=camera_matrix,
        usual_depth=float(camera_matrix[0, 0] * spread_m / spread_px),
        noise=NOISE_SHARE * spread_px,
    )
    # Least squares with Cauchy's loss: a landmark that is far off does not count.
    solved = least_squares(fit.residuals, np.zeros(6), loss="cauchy", max_nfev=50)
    depths = np.full(len(known), np.nan)
    depths[known] = fit.points(solved.x)[:, 2]
    depth, share = float(depths[acting].mean()), _depth_share(solved)
    if not share <= WORST_FIT or depth < NEAREST_M:
        return None
    return LandmarkGrip(
        pixel=hand.pixels[acting].mean(axis=0),
        depth=depth,
        sigma=float(np.linalg.norm([depth * share, depth * HAND_SIZE_SHARE, NOISE_SHARE * spread_m])),
    )


def acting_landmarks(metric: np.ndarray) -> list[int]:
    """The tips of thumb and index finger, if they hold something between them, else the foremost tip.

    The thumb is held against the index finger where its tip is nearer to the tip of that than to its knuckle.

    Args:
        metric: [21, 3] metres; NaN where unknown.
    """
    thumb = metric[THUMB_TIP]
    if np.linalg.norm(thumb - metric[INDEX_TIP]) < np.linalg.norm(thumb - metric[INDEX_KNUCKLE]):
        return [THUMB_TIP, INDEX_TIP]
    forward = metric[MIDDLE_KNUCKLE] - metric[WRIST]
    return [TIPS[int(np.argmax(metric[list(TIPS)] @ forward))]]


def _possible(hand: HandLandmarks, camera_matrix: np.ndarray) -> np.ndarray:
    """[21] bool: landmarks whose numbers are known and can be those of a hand in view."""
    focal, centre = np.diag(camera_matrix)[:2], camera_matrix[:2, 2]
    with np.errstate(over="ignore"):
        is_in_view = (np.abs((hand.pixels - centre) / focal) < WIDEST).all(axis=1)
    return np.asarray(is_in_view & (np.abs(hand.metric) < LONGEST_M).all(axis=1))


@dataclass(frozen=True, kw_only=True)
class _Fit:
    """Turn, place in the view and logarithm of the depth of a hand, six numbers, each over its usual error."""

    pixels: np.ndarray
    metric: np.ndarray
    camera_matrix: np.ndarray
    usual_depth: float
    noise: float

    def points(self, unknowns: np.ndarray) -> np.ndarray:
        """[L, 3] metres, frame camera."""
        middle = np.append(self.pixels.mean(axis=0) + self.noise * unknowns[3:5], 1.0)
        ray = np.linalg.solve(self.camera_matrix, middle)
        # Far from the right depth the exponential overflows.
        depth = self.usual_depth * np.exp(np.clip(NOISE_SHARE * unknowns[5], -5, 5))
        turned = (self.metric - self.metric.mean(axis=0)) @ cv2.Rodrigues(TURN_SIGMA * unknowns[:3])[0].T
        return np.asarray(turned @ _towards(ray).T + depth * ray)

    def residuals(self, unknowns: np.ndarray) -> np.ndarray:
        """[2L + 3]: of the pixels, and of the turn, which is none but for errors."""
        points = self.points(unknowns) @ self.camera_matrix.T
        projected = points[:, :2] / np.maximum(points[:, 2:], NEAREST_M)
        return np.concatenate([((projected - self.pixels) / self.noise).ravel(), unknowns[:3]])


def _towards(ray: np.ndarray) -> np.ndarray:
    """[3, 3] rotation that turns the optical axis to a ray [3] in front of the camera the shortest way."""
    axis = np.cross([0.0, 0.0, 1.0], ray)
    sine = np.linalg.norm(axis)
    angle = np.arctan2(sine, ray[2])
    return np.asarray(cv2.Rodrigues(axis * (angle / sine if sine > 0 else 0.0))[0])


def _depth_share(solved: OptimizeResult) -> float:
    """Standard deviation of the depth by the fit, over the depth: as large as the residuals say the errors are.

    NaN or large if the landmarks do not tell it.
    """
    scale = 2 * solved.cost / (len(solved.fun) - len(solved.x))
    covariance = np.linalg.inv(solved.jac.T @ solved.jac + 1e-9 * np.eye(len(solved.x)))
    with np.errstate(invalid="ignore"):
        return float(NOISE_SHARE * np.sqrt(scale * covariance[5, 5]))


def _spread(places: np.ndarray) -> float:
    """Root mean square distance of places [L, D] from their middle."""
    return float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean()))
