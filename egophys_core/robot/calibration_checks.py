"""What pairs of touched points must be to fix a transform: refused otherwise, with what is probably wrong."""

from collections.abc import Sequence

import numpy as np

from egophys_core.errors import RobotError
from egophys_core.geometry import rigid_fit
from egophys_core.robot.frames import Transform

SMALLEST_TRIANGLE_M = 0.01
"""Points that lie closer than this to one line do not fix the rotation about it."""

SAME_POINT_M = 0.002
"""Points nearer to each other than this are one point."""

LARGEST_SCALE_ERROR = 0.02
"""Share by which distances may differ: a printer that fits to the page shrinks by 3 % and more."""

UNITS = {1000.0: "millimetres", 100.0: "centimetres", 39.37: "inches"}
"""What there are of them in a metre."""

FLAT_M = 0.005
"""Points within this of one plane do not tell which side of it is up."""


def require_fitting_pairs(world: np.ndarray, base: np.ndarray, names: Sequence[str]) -> None:
    """Check points [N, 3] in both frames, metres: shapes, numbers, units, and that they span a triangle.

    Raises:
        RobotError: they do not; says what is wrong.
    """
    if world.shape != base.shape or world.ndim != 2 or world.shape[1] != 3 or len(world) < 3:
        raise RobotError(f"calibration needs two lists [N, 3] with N >= 3, got {world.shape} and {base.shape}")
    if not (np.isfinite(world).all() and np.isfinite(base).all()):
        raise RobotError("calibration points must be finite; remove the pair with NaN or infinity")
    _require_right_unit(world, base)
    for label, points in (("world", world), ("base", base)):
        _require_distinct(label, points, names)
        require_triangle(label, points)


def require_triangle(label: str, points: np.ndarray) -> None:
    """Check that points [N, 3] span a triangle.

    Raises:
        RobotError: they lie on one line.
    """
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] / np.sqrt(len(points))
    if spread < SMALLEST_TRIANGLE_M:
        raise RobotError(
            f"the {label} points lie within {spread * 1000:.1f} mm of one line, so the rotation about it "
            f"is unknown; touch points that span at least {SMALLEST_TRIANGLE_M * 1000:.0f} mm"
        )


def require_right_handed(world: np.ndarray, base: np.ndarray, transform: Transform) -> None:
    """Check that the axes of both frames are in the same order.

    Raises:
        RobotError: a mirrored fit is far better, or points of one plane fit only with the world's z pointing down.
    """
    height = np.linalg.svd(world - world.mean(axis=0), compute_uv=False)[2] / np.sqrt(len(world))
    if height < FLAT_M:
        if transform.rotation[2, 2] < 0:
            raise RobotError(
                "the points fit only with the world's z pointing down in the base frame: are x and y of one frame "
                "swapped, or a sign? Where the arm hangs from the ceiling touch a point well above the table, too"
            )
        return
    rotation, translation = rigid_fit(-world, base)
    mirrored = np.sqrt(np.mean(np.sum((-world @ rotation.T + translation - base) ** 2, axis=1)))
    straight = np.sqrt(np.mean(np.sum((transform.apply(world) - base) ** 2, axis=1)))
    if straight > 2 * mirrored and straight > FLAT_M:
        raise RobotError(
            f"the points fit mirrored to {1000 * mirrored:.1f} mm and straight to {1000 * straight:.1f} mm: one frame "
            "is left-handed; are two columns swapped, or is a sign wrong?"
        )


def require_same_scale(world: np.ndarray, base: np.ndarray, transform: Transform) -> None:
    """Check that distances are the same in both frames, as far as the points can tell.

    Raises:
        RobotError: they are not.
    """
    moved, target = (transform.apply(world) - base.mean(axis=0)), base - base.mean(axis=0)
    scale = float(np.sum(moved * target) / np.sum(moved**2))
    rest = np.sqrt(np.sum((scale * moved - target) ** 2) / max(3 * len(world) - 7, 1))
    uncertainty = rest / np.linalg.norm(moved)
    if abs(scale - 1) > max(LARGEST_SCALE_ERROR, 4 * uncertainty):
        raise RobotError(
            f"distances between the base points are {scale:.3f} of those between the world points; was the board not "
            "printed at 100 %, or is a world coordinate not what was measured?"
        )


def _require_distinct(label: str, points: np.ndarray, names: Sequence[str]) -> None:
    distances = np.linalg.norm(points[:, None] - points[None], axis=2)
    near = np.argwhere(np.triu(distances < SAME_POINT_M, 1))
    if len(near):
        first, second = (names[each] for each in near[0])
        raise RobotError(
            f"{first} and {second} are the same {label} point within {1000 * SAME_POINT_M:.0f} mm; "
            "remove one: a point that counts twice looks better known than it is"
        )


def _require_right_unit(world: np.ndarray, base: np.ndarray) -> None:
    spreads = [float(np.median(np.linalg.norm(each - np.median(each, axis=0), axis=1))) for each in (world, base)]
    if min(spreads) <= 0:
        return
    ratio = spreads[1] / spreads[0]
    for factor, unit in UNITS.items():
        for label, measured in (("base", ratio), ("world", 1 / ratio)):
            if factor / 1.6 < measured < factor * 1.6:
                raise RobotError(
                    f"the {label} points are {measured:.0f} times as far apart as the others: they seem to be "
                    f"{unit}; give metres, or name the columns {label}_x_mm and so on for millimetres"
                )
