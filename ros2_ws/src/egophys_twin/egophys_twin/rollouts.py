"""What the rollout service computes. Imports no ROS."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from egophys_core.planning import final_shapes, rollout_plans, shape_costs
from egophys_core.twin import Twin
from egophys_core.waypoint_plan import WaypointPlan


@dataclass(frozen=True, kw_only=True)
class RolloutAnswer:
    """Ends of K rollouts."""

    shapes: np.ndarray
    """[K, S, 3] float32 metres, world: surface nodes; not finite where a rollout diverged."""
    costs: np.ndarray
    """[K] metres, infinite where a rollout diverged; [0] without a target."""


def simulate(twin: Twin, plans: Sequence[WaypointPlan], target: np.ndarray) -> RolloutAnswer:
    """Roll a twin out under plans and compare the ends with a target [P, 3]; no points, no costs.

    Raises:
        PlanningError, SimulationError: a plan cannot be simulated.
    """
    shapes = final_shapes(twin, rollout_plans(twin, plans))
    return RolloutAnswer(shapes=shapes, costs=shape_costs(shapes, target) if len(target) else np.empty(0))
