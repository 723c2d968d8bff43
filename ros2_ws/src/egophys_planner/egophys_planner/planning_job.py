"""One planning goal: what it asks for, and planning it. Imports no ROS messages."""

from collections.abc import Callable
from dataclasses import dataclass, field
from threading import Event

from egophys_ros_common.worker import CanceledError

from egophys_core.planning import ForwardModel, PlanOptions, grasp_from_points, plan_to_target
from egophys_core.twin import Twin
from egophys_core.waypoint_plan import WaypointPlan


@dataclass(frozen=True, kw_only=True)
class PlanningJob:
    """An accepted goal."""

    twin: Twin
    options: PlanOptions
    seed: int
    canceled: Event = field(default_factory=Event)

    def run(self, forward: ForwardModel, on_progress: Callable[[int, int, float], None]) -> tuple[WaypointPlan, float]:
        """Plan; the cheapest plan and the cost of not moving, metres.

        Args:
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
            grasp_from_points(self.twin.grasp),
            self.options,
            seed=self.seed,
            twin_id=self.twin.twin_id,
            progress=checked_progress,
        )
