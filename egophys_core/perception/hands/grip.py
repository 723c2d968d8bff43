"""Where a hand acts on the object, told when the object begins to move.

Then the object is where it lay, so that what the hand covers or touches has a known place. From then on the width of
the hand tells how deep in the view its middle is, and the place where it acts stays beside that as it was.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.perception.hands.arms import SeenArm, SizeCue
from egophys_core.perception.hands.hand_points import RADIUS_M, at_depth
from egophys_core.perception.stages import View

HELD_RADIUS_M = 0.015
"""Metres around the grip: what is held, wherever the hand turns; about a fingertip."""

FEWEST_HELD = 3
"""Vertices that are held, however far apart they are."""

USUAL_HALF_WIDTH_M = 0.042
"""Metres: of a closed hand."""

COVERED_RADIUS_M = 0.025
"""Metres around the place where a hand holds: what it may touch."""

COVERED_SIGMA_M = 0.01
"""Metres: by which what a hand covers is nearer or farther than where it holds."""

TOUCH_M, TOUCH_SIGMA_M = RADIUS_M, 0.015
"""Metres from the surface to where a hand pushes, and their standard deviation."""

PUSHED_SHARE = 0.25
"""Of the object's height: how far from half of that hands push it, as a standard deviation."""

BEYOND_M, DEPTH_STEP_M = 0.1, 0.004
"""Metres before and behind the object within which a hand pushes it, and between the depths that are tried."""

WIDTH_SHARE = 0.07
"""Standard deviation of the width of hands; error of a depth by it."""

PALM_BEFORE_M = 0.06
"""Metres by which the middle of a hand is usually nearer to the eye than where it acts."""

NEARER_M = 2 * USUAL_HALF_WIDTH_M
"""Metres: the middle of a hand is nearer to the eye than what it holds, by no more than it is wide."""


@dataclass(frozen=True, kw_only=True)
class HandGrip:
    """What stays the same of a hand that acts on the object."""

    half_width: float
    """Metres."""
    offset: np.ndarray
    """[3] metres, frame world: from the middle of the hand to where it holds or pushes."""
    vertices: np.ndarray
    """[H] int: vertices of the object that it holds; none of a hand that pushes."""
    beside: np.ndarray
    """[H, 3] metres, frame world: from where it holds to these."""
    holds: bool
    """Whether it covers what it acts on; it pushes where it does not."""
    cue: SizeCue
    """What its width and its middle are from."""


def covered_share(arm: SeenArm, silhouette: np.ndarray) -> float:
    """How much of a hand lies over the object, whose silhouette is [S, S] bool: its pixels over those of a disc."""
    return float(np.count_nonzero(arm.mask & silhouette) / (np.pi * arm.radius**2))


def take_grip(
    arm: SeenArm,
    silhouette: np.ndarray,
    positions: np.ndarray,
    places: np.ndarray,
    view: View,
    *,
    holds: bool,
    is_solid: bool,
) -> HandGrip:
    """Where a hand acts when the object begins to move.

    That is by its landmarks, else in the middle of what it covers. A hand at the rim of a solid covers only what is
    inside of where it holds: the less it covers, the more that is ahead of its own middle, as of a hand that pushes.

    Args:
        arm: of the hand.
        silhouette: [S, S] bool: where the object is, seen or hidden.
        positions: [W, 3] metres, frame world: the object's vertices, then points of its hidden side.
        places: [V, 3] pixels and depth in metres, of the vertices.
        view: its pose is known.
        holds: whether it holds; it pushes otherwise.
        is_solid: whether the object is.
    """
    pixel = _held_pixel(arm, silhouette, is_solid) if holds and arm.landmarks is None else arm.grip
    focal = view.camera_matrix[0, 0]
    away = np.linalg.norm(places[:, :2] - pixel, axis=1) * places[:, 2] / focal
    # Landmarks tell the depth of the fingers themselves.
    before = 0.0 if arm.landmarks else PALM_BEFORE_M
    by_width = depth_by_width(USUAL_HALF_WIDTH_M, arm, view) + before
    if holds:
        depth = _covered_depth(places[away <= max(COVERED_RADIUS_M, float(away.min())), 2], by_width)
    else:
        depth = _touching_depth(pixel, positions, places[:, 2], by_width, view)
    if_as_deep = arm.radius * depth / focal
    half_width = float(np.clip(USUAL_HALF_WIDTH_M, if_as_deep * (1 - NEARER_M / depth), if_as_deep))
    middle = at_depth(arm.centre[None], depth_by_width(half_width, arm, view), view)[0]
    place = at_depth(pixel[None], depth, view)[0]
    apart = np.linalg.norm(positions[: len(places)] - place, axis=1)
    nearest = np.argsort(apart, kind="stable")[: FEWEST_HELD if holds else 0]
    held = np.union1d(nearest, np.flatnonzero((apart <= HELD_RADIUS_M) & holds)).astype(int)
    return HandGrip(
        half_width=half_width,
        offset=place - middle,
        vertices=held,
        beside=positions[held] - place,
        holds=holds,
        cue=arm.cue,
    )


def _held_pixel(arm: SeenArm, silhouette: np.ndarray, is_solid: bool) -> np.ndarray:
    """[2] pixel x, y: where a hand holds a solid, or a sheet, with a silhouette [S, S] bool."""
    rows, columns = np.nonzero(arm.mask & silhouette)
    if not len(rows):
        return arm.grip
    share = min(covered_share(arm, silhouette), 1.0) if is_solid else 1.0
    return np.asarray(share * np.array([columns.mean(), rows.mean()]) + (1 - share) * arm.grip)


def _covered_depth(covered: np.ndarray, by_width: float) -> float:
    """Metres: by depths of what is covered, and by the width."""
    nearest, farthest = sorted((float(np.median(covered)), by_width))
    depths = np.arange(nearest, farthest + DEPTH_STEP_M, DEPTH_STEP_M)
    of_covered = (depths - np.median(covered)) ** 2 / (COVERED_SIGMA_M**2 + float(covered.var()))
    return float(depths[(of_covered + _misses_of_width(depths, by_width)).argmin()])


def _misses_of_width(depths: np.ndarray, by_width: float) -> np.ndarray:
    """How unlikely depths [D], metres, are by the width; what is no hand may have any, so doubt grows slowly."""
    return np.log1p(((depths - by_width) / (WIDTH_SHARE * by_width)) ** 2)


def _touching_depth(
    pixel: np.ndarray, positions: np.ndarray, of_object: np.ndarray, by_width: float, view: View
) -> float:
    """Metres: where a hand seen at a pixel is as near to the object as one that pushes, about half as high as that.

    A side that is pushed may be hidden, and as long in depth as the object is: there its height and the hand's width
    tell.
    """
    depths = np.arange(max(float(of_object.min()) - BEYOND_M, DEPTH_STEP_M), of_object.max() + BEYOND_M, DEPTH_STEP_M)
    along = np.vstack([at_depth(pixel[None], depth, view) for depth in depths])
    apart = cKDTree(positions).query(along)[0]
    of_touch = ((apart - TOUCH_M) / TOUCH_SIGMA_M) ** 2
    low, high = positions[:, 2].min(), positions[:, 2].max()
    of_height = ((along[:, 2] - (low + high) / 2) / max(PUSHED_SHARE * (high - low), DEPTH_STEP_M)) ** 2
    return float(depths[(of_touch + of_height + _misses_of_width(depths, by_width)).argmin()])


def depth_by_width(half_width: float, arm: SeenArm, view: View) -> float:
    """Metres along the optical axis of a hand that is so wide, metres."""
    return float(view.camera_matrix[0, 0] * half_width / arm.radius)
