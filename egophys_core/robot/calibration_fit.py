"""Where the robot stands, from points known in the world and touched by the arm: a rigid fit that mis-touched points do
not move, and how far it can be trusted."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache, cached_property
from itertools import combinations
from math import comb

import numpy as np
from scipy.special import fdtrc

from egophys_core.geometry import rigid_fit
from egophys_core.robot.calibration_checks import (
    require_fitting_pairs,
    require_right_handed,
    require_same_scale,
    require_triangle,
)
from egophys_core.robot.frames import Transform

FEWEST_TO_LEAVE_OUT = 5
"""Pairs of which one can be left out: the four others still contradict each other if they are wrong."""

MISTOUCHED_M = 0.008
"""Metres: a touch that is off by less is not left out however well the others agree; it is no mistake."""

SIGNIFICANCE = 0.01
"""Chance at which good touches are taken to be no good."""

GOOD_M, FAIR_M = 0.003, 0.008
"""Metres of leave-one-out error: grasps of cloth work with the first, with the second some miss."""

_MOST_TRIPLES = 1000


class FitQuality(StrEnum):
    """What a fit is good for."""

    GOOD = "good"
    FAIR = "fair"
    POOR = "poor"
    UNCHECKED = "unchecked"
    """Three points: any three fit, so a mis-touched one would not show."""


@dataclass(frozen=True, kw_only=True)
class FitReport:
    """A fitted transform and how well it explains the pairs of points it was fitted to."""

    world_to_base: Transform
    """Least-squares rigid transform from world to base over the pairs that are used."""
    residuals: np.ndarray
    """[N] float64, distance between each moved world point and its base point, metres; also of pairs left out."""
    used: np.ndarray
    """[N] bool: false for pairs that were left out as mis-touched."""
    left_one_out: np.ndarray
    """[N] float64, metres: how far each used point is from where a fit to the other used ones has it; NaN of those left
    out, and of all where fewer than four are used."""
    expected_error: float
    """Metres: standard error of where the transform puts the used points, at the worst of them; NaN for three."""

    @property
    def rms(self) -> float:
        """Root mean square residual of the pairs used, metres; a careful touch-off gives 1 to 3 mm."""
        return float(np.sqrt(np.mean(self.residuals[self.used] ** 2)))

    @property
    def leave_one_out(self) -> float:
        """Root mean square of `left_one_out`, metres: by how much a point that was not touched will be missed."""
        return float(np.sqrt(np.mean(self.left_one_out[self.used] ** 2)))

    @cached_property
    def quality(self) -> FitQuality:
        """By the leave-one-out error."""
        if not np.isfinite(self.leave_one_out):
            return FitQuality.UNCHECKED
        limits = ((GOOD_M, FitQuality.GOOD), (FAIR_M, FitQuality.FAIR))
        return next((quality for limit, quality in limits if self.leave_one_out <= limit), FitQuality.POOR)


def fit_world_to_base(
    world_points: np.ndarray, base_points: np.ndarray, *, names: Sequence[str] | None = None
) -> FitReport:
    """Fit the calibration from points known in both frames (touch them with the tool, read its position).

    Least trimmed squares (Rousseeuw, J. Am. Stat. Assoc. 79 (1984) 871): of all triples of pairs the one whose
    transform most others agree with, then least squares over those that agree. Of five pairs one, of six two, of more
    up to a third may be mis-touched.

    Args:
        world_points: [N, 3] metres, N >= 3, not all on one line.
        base_points: [N, 3] metres, the same points in the robot base frame, same order.
        names: of the pairs, for messages; None counts them from 1.

    Raises:
        RobotError: shapes differ, too few points, a number not finite, two pairs of one point, points on one line,
            another unit or scale, or mirrored axes.
    """
    world = np.asarray(world_points, dtype=np.float64)
    base = np.asarray(base_points, dtype=np.float64)
    require_fitting_pairs(world, base, names or [f"pair {number}" for number in range(1, len(world) + 1)])
    used = np.ones(len(world), bool)
    if len(world) >= FEWEST_TO_LEAVE_OUT:
        used = _agreeing(world, base)
        require_triangle("world", world[used])
    transform = _fitted(world[used], base[used])
    require_right_handed(world[used], base[used], transform)
    require_same_scale(world[used], base[used], transform)
    return FitReport(
        world_to_base=transform,
        residuals=_residuals(transform, world, base),
        used=used,
        left_one_out=_left_one_out(world, base, used),
        expected_error=_expected_error(world[used], _residuals(transform, world[used], base[used])),
    )


def _agreeing(world: np.ndarray, base: np.ndarray) -> np.ndarray:
    """[N] bool: the pairs that one transform explains.

    Pairs are left out together where an F test says that the others then fit better than chance has it, among all
    choices of as many pairs, and where each of them is off by more than `MISTOUCHED_M`.
    """
    count = len(world)
    kept = [_best_subset(world, base, count - left_out) for left_out in range(count // 3 + 1)]
    errors = [_squared_error(world[each], base[each]) for each in kept]
    chosen = 0
    while True:
        chances = {
            more: comb(count - chosen, more - chosen)
            * _chance(errors[chosen], errors[more], 3 * (more - chosen), 3 * (count - more) - 6)
            for more in range(chosen + 1, len(kept))
        }
        better = min(chances, key=chances.__getitem__, default=chosen)
        if better == chosen or chances[better] > SIGNIFICANCE:
            break
        chosen = better
    used = kept[chosen]
    residuals = _residuals(_fitted(world[used], base[used]), world, base)
    return used | (residuals <= MISTOUCHED_M)


def _chance(worse: float, better: float, left_out: int, freedom: int) -> float:
    """Of a sum of squares that falls that far when `left_out` numbers go and `freedom` remain to tell the noise."""
    if better <= 0.0:
        return 0.0 if worse > 0.0 else 1.0
    return float(fdtrc(left_out, freedom, ((worse - better) / left_out) / (better / freedom)))


def _best_subset(world: np.ndarray, base: np.ndarray, kept: int) -> np.ndarray:
    """[N] bool: so many pairs with the least sum of squared residuals, as good as the best triple finds them."""
    if kept == len(world):
        return np.ones(len(world), bool)

    def nearest(members: np.ndarray) -> tuple[float, np.ndarray]:
        residuals = _residuals(_fitted(world[members], base[members]), world, base)
        order = np.argsort(residuals, kind="stable")[:kept]
        return float(np.sum(residuals[order] ** 2)), order

    least, best = min((nearest(triple) for triple in _triples(len(world))), key=lambda found: found[0])
    # Concentration: fit to those that fit best, as long as that makes them fit better.
    while (found := nearest(best))[0] < least:
        least, best = found
    used = np.zeros(len(world), bool)
    used[best] = True
    return used


@cache
def _triples(count: int) -> list[np.ndarray]:
    """All of them, or as many as are enough: chosen by a fixed seed, so that a fit can be repeated."""
    if comb(count, 3) <= _MOST_TRIPLES:
        return [np.array(each) for each in combinations(range(count), 3)]
    random = np.random.default_rng(0)
    return [random.choice(count, 3, replace=False) for _ in range(_MOST_TRIPLES)]


def _sigma(residuals: np.ndarray) -> float:
    """Standard deviation of one coordinate of one point, metres: six of the 3 N numbers went into the transform."""
    return float(np.sqrt(np.sum(residuals**2) / max(3 * len(residuals) - 6, 1)))


def _left_one_out(world: np.ndarray, base: np.ndarray, used: np.ndarray) -> np.ndarray:
    errors = np.full(len(world), np.nan)
    for index in np.flatnonzero(used) if used.sum() > 3 else ():
        others = used & (np.arange(len(world)) != index)
        transform = _fitted(world[others], base[others])
        errors[index] = np.linalg.norm(transform.apply(world[index]) - base[index])
    return errors


def _expected_error(world: np.ndarray, residuals: np.ndarray) -> float:
    """Standard error of the moved points, at the worst of them, metres.

    A transform that is off by a shift t and a small rotation w about the middle moves a point p by t + w x p; least
    squares leave both with the covariance sigma^2 (J^T J)^-1, J the derivatives of all points.
    """
    if len(world) < 4:
        return float("nan")
    arms = world - world.mean(axis=0)
    derivatives = np.stack([np.hstack([np.eye(3), -_cross_matrix(arm)]) for arm in arms])
    covariance = np.linalg.inv(np.einsum("nij,nik->jk", derivatives, derivatives))
    variances = np.einsum("nij,jk,nik->n", derivatives, covariance, derivatives)
    return _sigma(residuals) * float(np.sqrt(variances.max()))


def _cross_matrix(vector: np.ndarray) -> np.ndarray:
    """[3, 3]: its product with another vector is the cross product."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _squared_error(world: np.ndarray, base: np.ndarray) -> float:
    return float(np.sum(_residuals(_fitted(world, base), world, base) ** 2))


def _fitted(world: np.ndarray, base: np.ndarray) -> Transform:
    rotation, translation = rigid_fit(world, base)
    return Transform(rotation=rotation, translation=translation)


def _residuals(transform: Transform, world: np.ndarray, base: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(transform.apply(world) - base, axis=1))
