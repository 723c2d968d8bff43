"""A motion that is asked for, moved to where the object lies now, in the shape of its twin. Imports no ROS."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.errors import EpisodeError
from egophys_core.experiments.hand_path import ABOVE_M, ToolPath, plan_of_path
from egophys_core.geometry import rigid_fit
from egophys_core.observation import SeenObject, require_at_rest
from egophys_core.observation.lying import lying_nodes
from egophys_core.recording import PointFrame
from egophys_core.twin import Twin
from egophys_core.waypoint_plan import NANOSECONDS, WaypointPlan

RESTED_S = 1.0
"""Seconds for which an object that has not moved is at rest."""

OFF_M = 0.01
"""Metres, root mean square over the nodes, by which an object may lie otherwise than its twin."""

OPENS_S, RISES_S = 0.5, 1.0
"""Seconds from the end of a motion until the gripper opens, and from there until it is clear of the object."""


@dataclass(frozen=True, kw_only=True)
class Placement:
    """How an object lies that was moved as a whole since its twin was built."""

    turn: np.ndarray
    """[3, 3] rotation of the twin's rest shape."""
    shift: np.ndarray
    """[3] metres, after it."""

    def of(self, path: ToolPath) -> ToolPath:
        """The path, moved with the object."""
        return replace(path, positions=path.positions @ self.turn.T + self.shift)


def points_at_rest(frames: Sequence[PointFrame]) -> np.ndarray:
    """[P, 3] float32 metres: the points of the newest of some frames, if the object is at rest.

    Args:
        frames: of the object, in order of their stamps.

    Raises:
        EpisodeError: it has not been seen for long enough, or it moves.
    """
    if not frames:
        raise EpisodeError("the object is not seen")
    rested = frames[-1].stamp_ns - RESTED_S * NANOSECONDS
    earlier = [frame for frame in frames if frame.stamp_ns <= rested]
    if not earlier:
        raise EpisodeError(f"the object has been seen for less than {RESTED_S:g} s")
    now = _seen(frames[-1])
    require_at_rest(_seen(earlier[-1]), now)
    return now.points


def placement(twin: Twin, points: np.ndarray) -> Placement:
    """How the object of a twin lies, from points [P, 3] of it at rest, metres.

    Raises:
        EpisodeError: not as its twin does.
    """
    nodes = lying_nodes(twin, points)
    found = None if nodes is None else rigid_placement(twin.model.graph.positions, nodes)
    if found is None:
        raise EpisodeError(
            f"the object ({len(points)} points of it are seen) does not lie as twin {twin.twin_id} does at rest, so "
            "its hands would not find it; lay it down as it lay when the twin was built, all in sight, wherever on "
            "the table, and diagnose again"
        )
    return found


def rigid_placement(rest: np.ndarray, nodes: np.ndarray) -> Placement | None:
    """The motion as a whole that brings nodes at rest [N, 3] to others [N, 3], metres; None if there is none."""
    turn, shift = rigid_fit(rest.astype(np.float64), nodes.astype(np.float64))
    off = np.linalg.norm(rest @ turn.T + shift - nodes, axis=1)
    return Placement(turn=turn, shift=shift) if np.sqrt(np.mean(off**2)) <= OFF_M else None


def plan_that_lets_go(path: ToolPath, *, highest: float) -> WaypointPlan:
    """The plan of a path, after which the gripper opens and rises, so that the object can come to rest.

    It names no twin: it holds for the object where it lies, whichever twin is in use.

    Args:
        path: of the tool.
        highest: metres, z up to which the tool rises.
    """
    end = path.positions[-1]
    above = np.array([*end[:2], max(end[2], min(end[2] + ABOVE_M, highest))])
    opens = path.times[-1] + OPENS_S
    whole = ToolPath(
        times=np.append(path.times, [opens, opens + RISES_S]),
        positions=np.vstack([path.positions, end, above]),
        turns=np.append(path.turns, path.turns[[-1, -1]]),
        holds=np.append(path.holds, [False, False]),
    )
    return plan_of_path(whole, twin_id="")


def _seen(frame: PointFrame) -> SeenObject:
    good = np.isfinite(frame.xyz).all(axis=1) & (frame.confidence > 0)
    ids, first = np.unique(frame.ids[good], return_index=True)
    return SeenObject(ids=ids, points=frame.xyz[good][first], bound=None)
