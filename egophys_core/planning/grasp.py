"""How the tool holds the object, and what a waypoint plan does to the controller points."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.errors import PlanningError
from egophys_core.interpolation import PosesOverTime
from egophys_core.simulation import ContactKind, Controls
from egophys_core.waypoint_plan import CLOSED_BELOW, POINTING_DOWN, UNIT_QUATERNION_TOLERANCE, WaypointPlan

FRAME_DURATION = 1.0 / 30.0
"""Seconds between simulated frames of a plan."""


@dataclass(frozen=True, kw_only=True)
class Grasp:
    """Where the tool takes hold and which points then move with it."""

    position: np.ndarray
    """[3] float64, tool position at the grasp, metres, world."""
    controllers: np.ndarray
    """[C, 3] float64, controller points in the tool frame, metres."""


def grasp_from_points(points: np.ndarray) -> Grasp:
    """The grasp of a downward-pointing tool that does what a hand's controller points did.

    Args:
        points: [C, 3] metres, world, as the hand took hold (`Twin.grasp`).

    Raises:
        PlanningError: there are no points.
    """
    if len(points) == 0:
        raise PlanningError("the twin has no grasp: no hand took hold in its episodes; build it from one where it does")
    position = points.astype(np.float64).mean(axis=0)
    return Grasp(position=position, controllers=Rotation.from_quat(POINTING_DOWN).inv().apply(points - position))


def controls_of_plan(plan: WaypointPlan, grasp: Grasp) -> Controls:
    """Motion of the controller points under a plan, from just before the gripper first closes.

    Before that the object is at rest and nothing acts on it. The tool moves linearly between waypoints; the
    gripper is as its last passed waypoint says.

    Raises:
        PlanningError: not finite, times do not increase, or the gripper never closes.
    """
    times = np.asarray(plan.times, np.float64)
    if len(times) < 2 or not (np.isfinite(plan.positions).all() and np.isfinite(plan.quaternions).all()):
        raise PlanningError("a plan to simulate needs at least 2 waypoints and finite poses")
    if not (np.diff(times) > 0).all():
        waypoint = int(np.argmin(np.diff(times) > 0)) + 1
        raise PlanningError(f"plan time does not increase at waypoint {waypoint} (t={times[waypoint]:g} s)")
    lengths = np.linalg.norm(plan.quaternions, axis=1)
    if not (np.abs(lengths - 1.0) < UNIT_QUATERNION_TOLERANCE).all():
        waypoint = int(np.argmax(np.abs(lengths - 1.0)))
        raise PlanningError(f"the quaternion of waypoint {waypoint} has length {lengths[waypoint]:g}; it must be 1")
    closed = np.flatnonzero(plan.gripper_opening < CLOSED_BELOW)
    if len(closed) == 0 or closed[0] == len(times) - 1:
        raise PlanningError(
            f"the gripper never closes before the last waypoint (below {CLOSED_BELOW} m), so nothing is moved"
        )
    start = times[closed[0]]
    count = max(2, int(np.ceil((times[-1] - start) / FRAME_DURATION)) + 1)
    frames = start + np.arange(count) * FRAME_DURATION
    inside = np.minimum(frames, times[-1])
    positions, rotations = PosesOverTime(times, plan.positions, Rotation.from_quat(plan.quaternions)).at(inside)
    points = np.stack([rotation.apply(grasp.controllers) for rotation in rotations]) + positions[:, None]
    waypoint = np.searchsorted(times, inside, side="right") - 1
    contact = np.where(plan.gripper_opening[waypoint] < CLOSED_BELOW, ContactKind.HOLD, ContactKind.NONE)
    return Controls(
        times=frames - start,
        positions=points.astype(np.float32),
        contact=np.repeat(contact[:, None], len(grasp.controllers), axis=1),
    )
