"""One planning goal: what it asks for, and planning it. Imports no ROS messages."""

from collections.abc import Callable
from dataclasses import dataclass, field
from threading import Event

import numpy as np
from egophys_ros_common.worker import CanceledError

from egophys_core.observation import SeenObject, present_nodes
from egophys_core.planning import (
    ForwardModel,
    PlanOptions,
    Start,
    TargetText,
    carried_start,
    check_shape,
    grasp_from_points,
    plan_to_target,
    start_of_twin,
    target_points,
)
from egophys_core.twin import Twin
from egophys_core.waypoint_plan import WaypointPlan


@dataclass(frozen=True, kw_only=True)
class PlanningProblem:
    """All that a plan depends on besides twin, options and seed."""

    start: Start
    target: np.ndarray
    """[P, 3] float32 metres, world."""


@dataclass(frozen=True, kw_only=True)
class PlanningJob:
    """An accepted goal."""

    twin: Twin
    options: PlanOptions
    seed: int
    target: TargetText | np.ndarray
    """As text, or [P, 3] metres, world."""
    seen: SeenObject | None
    """The object as it is now, from which to plan; None to plan from the twin as it was built."""
    why_twin: str = ""
    """Why the plan begins where the twin was built, if nobody asked for that."""
    canceled: Event = field(default_factory=Event)

    def prepare(self) -> PlanningProblem:
        """Find where the object is, and read the target.

        Raises:
            PlanningError, EpisodeError, RecordingError, TwinError: the object is not the twin's, or the target is none.
        """
        start = start_of_twin(self.twin)
        if self.seen is not None:
            start = carried_start(self.twin, present_nodes(self.twin, self.seen))
        surface = start.surface(self.twin)
        if isinstance(self.target, TargetText):
            return PlanningProblem(start=start, target=target_points(self.target, surface))
        check_shape(self.target, surface, "the target")
        return PlanningProblem(start=start, target=self.target)

    def run(
        self, problem: PlanningProblem, forward: ForwardModel, on_progress: Callable[[int, int, float], None]
    ) -> tuple[WaypointPlan, float]:
        """Plan; the cheapest plan and the cost of not moving, metres.

        Args:
            problem: from `prepare`.
            forward: costs of plans.
            on_progress: called after each iteration with iterations done, iterations, best cost in metres.

        Raises:
            PlanningError: no plan could be made.
            CanceledError: `canceled` was set.
        """

        def checked_progress(done: int, total: int, cost: float) -> None:
            if self.canceled.is_set():
                raise CanceledError(f"stopped after {done} of {total} iterations")
            on_progress(done, total, cost)

        return plan_to_target(
            forward,
            grasp_from_points(problem.start.grasp),
            self.options,
            seed=self.seed,
            twin_id=self.twin.twin_id,
            progress=checked_progress,
        )
