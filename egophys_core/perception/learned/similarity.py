"""Similarities (scale, rotation, translation) and the best one between paired points."""

from dataclasses import dataclass

import numpy as np

from egophys_core.errors import EpisodeError
from egophys_core.geometry import nearest_rotation


@dataclass(frozen=True, kw_only=True)
class Similarity:
    """Target = scale * rotation @ source + translation."""

    scale: float
    """Units of the target per unit of the source, above 0."""
    rotation: np.ndarray
    """[3, 3] float64, proper rotation."""
    translation: np.ndarray
    """[3] float64, units of the target."""

    def apply(self, points: np.ndarray) -> np.ndarray:
        """[..., 3] points of the source in the target's frame."""
        moved: np.ndarray = self.scale * (points @ self.rotation.T) + self.translation
        return moved

    def apply_inverse(self, points: np.ndarray) -> np.ndarray:
        """[..., 3] points of the target in the source's frame."""
        moved: np.ndarray = (points - self.translation) @ self.rotation / self.scale
        return moved


def fit_similarity(source: np.ndarray, target: np.ndarray) -> Similarity:
    """The similarity of least squares between paired points [N, 3], N >= 3.

    Umeyama, "Least-squares estimation of transformation parameters between two point patterns", PAMI 1991, Eq. 40-43.
    Of points on a line the turn about it is arbitrary.

    Raises:
        EpisodeError: fewer than three pairs, or all source points are one.
    """
    if source.shape != target.shape or len(source) < 3:
        raise EpisodeError(f"a similarity needs three pairs of points or more, got {source.shape} and {target.shape}")
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    variance = ((source - source_mean) ** 2).sum() / len(source)
    if variance <= 0:
        raise EpisodeError("a similarity needs points that are apart; all source points are one")
    left, singular, right = np.linalg.svd((target - target_mean).T @ (source - source_mean) / len(source))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left) * np.linalg.det(right))])
    rotation = left @ np.diag(signs) @ right
    scale = float((singular * signs).sum() / variance)
    return Similarity(scale=scale, rotation=rotation, translation=target_mean - scale * rotation @ source_mean)


def mean_rotation(rotations: np.ndarray) -> np.ndarray:
    """[3, 3]: the rotation nearest to all of [N, 3, 3] in the sum of squared differences of their entries."""
    return nearest_rotation(rotations.mean(axis=0))
