"""Scripted hands: where they go, and the points that a hand tracker sees of them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.errors import PlanningError
from egophys_core.geometry import about_vertical
from egophys_core.minimum_jerk import minimum_jerk
from egophys_core.rehearsal.bodies import SoftBody
from egophys_core.rehearsal.engine import HAND_RADIUS
from egophys_core.rehearsal.options import Motion
from egophys_core.waypoint_plan import CLOSED_BELOW, WaypointPlan

CONTACT_BEGINS = 1.05
"""Seconds: the hands have arrived, grips close."""

HAND_POINTS = 30
"""Tracked points on all hands together."""

AWAY = np.array([0.33, -0.19, 0.28])
"""From where a hand comes, metres from where it takes hold."""


@dataclass(frozen=True, kw_only=True)
class Hands:
    """Where hands are, and how they are turned."""

    centres: np.ndarray
    """[H, 3] metres."""
    turns: np.ndarray
    """[H] radians about the vertical, from how they are when an episode begins."""

    def points(self, cloud: np.ndarray) -> np.ndarray:
        """[C, 3] metres: points [H, C / H, 3] of them about their centres, as these are when an episode begins."""
        return (self.centres[:, None] + about_vertical(cloud, self.turns[:, None])).reshape(-1, 3)


HandsAt = Callable[[float], Hands]
"""The hands at a time in seconds; before zero they are where they are at zero."""


@dataclass(frozen=True, kw_only=True)
class Script:
    """What the hands do in one episode."""

    times: np.ndarray
    """[W] seconds, increasing."""
    centres: np.ndarray
    """[W, H, 3] metres, where the hands are at those times."""
    turns: np.ndarray
    """[W, H] radians, how they are turned."""
    closes: float
    """Seconds at which the hands take hold of what they reach; infinite for hands that press."""
    opens: float = np.inf
    """Seconds at which they let go."""
    smooth: bool = True
    """Whether they stop at each of those places, or go through."""

    def at(self, time: float) -> Hands:
        """The hands: along straight lines, between stops with a smooth speed."""
        after = int(np.searchsorted(self.times, time, side="right"))
        if after in (0, len(self.times)):
            return Hands(centres=self.centres[max(after - 1, 0)], turns=self.turns[max(after - 1, 0)])
        begin, end = self.times[after - 1 : after + 1]
        share = (time - begin) / (end - begin)
        if self.smooth:
            share = minimum_jerk(share)
        centres, turns = (
            values[after - 1] + share * (values[after] - values[after - 1]) for values in (self.centres, self.turns)
        )
        return Hands(centres=centres, turns=turns)


def write_script(motion: Motion, body: SoftBody, vertices: np.ndarray, random: np.random.Generator) -> Script:
    """Where the hands go for a motion of a body that lies with its vertices at `vertices` [V, 3]."""
    places = _places(motion, body, vertices)
    moves = [(0.0, AWAY), (0.8, np.array([0.0, 0.0, 0.03])), (1.0, np.zeros(3)), (1.1, np.zeros(3))]
    time = moves[-1][0]
    for duration, offset in _moves(motion, body.is_sheet, np.ptp(vertices, axis=0), random):
        time += duration * random.uniform(0.9, 1.1)
        moves.append((time, np.asarray(offset, float)))
    times, offsets = (np.array(each) for each in zip(*moves, strict=True))
    centres = places + offsets[:, None]
    return Script(
        times=times,
        centres=centres,
        turns=np.zeros(centres.shape[:2]),
        closes=np.inf if motion is Motion.PUSH else CONTACT_BEGINS,
    )


def script_of_plans(plans: Sequence[WaypointPlan]) -> Script:
    """The hands as plans have them, one a hand, in the world in which the object was when its twin was built.

    Hands here turn about the vertical only: what a plan tilts its tool by is left out.

    Raises:
        PlanningError: the plans do not have the same times, or their grippers do not close together, once, and open
            together at most once.
    """
    first = plans[0]
    for plan in plans[1:]:
        if not (np.array_equal(plan.times, first.times) and np.array_equal(_closed(plan), _closed(first))):
            raise PlanningError(
                "the plans of two hands must have the same times and close together; take those of one experiment"
            )
    changes = np.flatnonzero(np.diff(_closed(first).astype(int), prepend=0))
    if len(changes) not in (1, 2) or not (np.diff(first.times) > 0.0).all():
        raise PlanningError(
            "the gripper must close once and open once at most, at times that increase; it closes or opens "
            f"{len(changes)} times"
        )
    closes, opens = [*first.times[changes], np.inf][:2]
    centres = np.stack([plan.positions for plan in plans], axis=1)
    turns = np.stack([_turns(plan) for plan in plans], axis=1)
    return Script(
        times=first.times, centres=centres, turns=turns, closes=float(closes), opens=float(opens), smooth=False
    )


def _closed(plan: WaypointPlan) -> np.ndarray:
    return np.asarray(plan.gripper_opening < CLOSED_BELOW)


def _turns(plan: WaypointPlan) -> np.ndarray:
    """[W] radians by which a plan turns its tool about the vertical since its start."""
    rotations = Rotation.from_quat(plan.quaternions)
    _, _, about_z, real = (rotations * rotations[0].inv()).as_quat().T
    return np.unwrap(2.0 * np.arctan2(about_z, real))


def hand_cloud(hands: int, random: np.random.Generator) -> np.ndarray:
    """Tracked points of each hand relative to its centre, [H, C / H, 3] metres: inside the ball that presses."""
    directions = random.normal(size=(hands, HAND_POINTS // hands, 3))
    radius = random.uniform(0.6, 0.85, size=(*directions.shape[:2], 1)) * HAND_RADIUS
    return directions / np.linalg.norm(directions, axis=2, keepdims=True) * radius


def _places(motion: Motion, body: SoftBody, vertices: np.ndarray) -> np.ndarray:
    """Where the hands take hold or begin to press, [H, 3] metres."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle = (low + high) / 2.0
    if motion is Motion.PUSH:
        height = low[2] + HAND_RADIUS if body.is_sheet else max(middle[2], HAND_RADIUS)
        return np.array([[high[0] + HAND_RADIUS + 0.015, middle[1], height]])
    if body.is_sheet:
        inset = 0.012
        corners = np.array([(high[0] - inset, low[1] + inset, high[2]), (low[0] + inset, low[1] + inset, high[2])])
        # A sheet without corners is held where it is nearest to them.
        for corner in corners:
            distances = np.linalg.norm(vertices - corner, axis=1)
            if distances.min() > HAND_RADIUS:
                corner[:] = vertices[distances.argmin()]
    else:
        along = 0.3 * (high[0] - low[0])
        corners = np.array([(middle[0] + along, middle[1], high[2]), (middle[0] - along, middle[1], high[2])])
        # A hand holds the skin, not the air above a rounded body.
        for corner in corners:
            near = np.linalg.norm(vertices[:, :2] - corner[:2], axis=1) < 0.035
            corner[2] = vertices[near, 2].max() - 0.005
    two = motion in (Motion.DOUBLE_LIFT, Motion.DOUBLE_PULL) or (motion is Motion.FOLD and body.is_sheet)
    return corners if two else corners[:1]


def _moves(
    motion: Motion, is_sheet: bool, size: np.ndarray, random: np.random.Generator
) -> list[tuple[float, tuple[float, float, float]]]:
    """Durations in seconds and where the hands are then, metres from where they took hold."""

    def some(value: float) -> float:
        return float(value * random.uniform(0.8, 1.2))

    up = some(0.16)
    side, back = some(0.07), some(0.05)
    match motion:
        case Motion.LIFT | Motion.DOUBLE_LIFT:
            return [
                (1.2, (0.0, 0.0, up)),
                (0.8, (side, back, up)),
                (0.6, (-side, -0.5 * back, up)),
                (0.6, (0.8 * side, 0.5 * back, 0.9 * up)),
                (1.1, (-0.3 * side, 0.6 * back, 0.5 * up)),
                (1.2, (-0.3 * side, 0.0, 0.7 * up)),
            ]
        case Motion.PULL | Motion.DOUBLE_PULL:
            pull = some(0.1)
            along = np.array([1.0, 0.15, 0.0]) if motion is Motion.PULL else np.array([0.2, -1.0, 0.0])
            aside = np.array([-along[1], along[0], 0.0])
            lift = np.array([0.0, 0.0, some(0.012)])
            return [
                (1.2, tuple(pull * along + lift)),
                (0.8, tuple(0.35 * pull * along + 0.3 * pull * aside + lift)),
                (0.7, tuple(1.1 * pull * along + lift)),
                (1.0, tuple(0.8 * pull * along - 0.4 * pull * aside + 2.0 * lift)),
                (1.1, tuple(1.2 * pull * along + 0.2 * pull * aside + lift)),
            ]
        case Motion.FOLD:
            across = 0.8 * size[1] if is_sheet else 0.0
            over = (0.0, 0.5 * across, 0.6 * across) if is_sheet else (-0.4 * size[0], 0.0, 0.3 * size[2])
            down = (0.0, across, 0.012) if is_sheet else (-0.7 * size[0], 0.0, 0.0)
            return [(1.3, over), (1.3, down), (0.8, down), (1.2, tuple(0.6 * np.array(over)))]
        case Motion.PUSH:
            far = -some(0.6) * size[0]
            rise = 0.0 if is_sheet else some(0.01)
            return [
                (1.3, (far, 0.0, 0.0)),
                (0.7, (0.8 * far, 0.0, rise)),
                (0.8, (1.3 * far, some(0.02), rise)),
                (0.8, (0.7 * far, some(0.02), 0.0)),
                (1.0, (1.1 * far, 0.0, 0.0)),
            ]
        case Motion.SHAKE:
            shakes = [
                (0.35, (0.7 * sign * side, -0.3 * sign * back, up + 0.02 * sign))
                for sign in (1.0, -1.0) * int(random.integers(4, 6))
            ]
            return [(1.2, (0.0, 0.0, up)), *shakes, (0.5, (0.0, 0.0, up)), (0.8, (0.0, 0.0, 0.7 * up))]
        case Motion.HANG:
            return [(0.9, (0.0, 0.0, up)), (3.0, (0.0, 0.0, up)), (1.0, (0.0, 0.0, 0.3 * up))]
