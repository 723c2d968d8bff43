"""What the rollout service computes. Imports no ROS."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from egophys_core.planning import Start, final_shapes, rollout_plans, shape_costs, start_of_twin
from egophys_core.twin import Twin
from egophys_core.waypoint_plan import WaypointPlan


@dataclass(frozen=True, kw_only=True)
class RolloutAnswer:
    """Ends of K rollouts."""

    shapes: np.ndarray
    """[K, S, 3] float32 metres, world: surface nodes; not finite where a rollout diverged."""
    costs: np.ndarray
    """[K] metres, infinite where a rollout diverged; [0] without a target."""


def start_of(twin: Twin, nodes: np.ndarray, grasp: np.ndarray) -> Start:
    """The start with nodes [N, 3] and points of the grasp [C, 3], metres; those of the twin where there are none."""
    own = start_of_twin(twin)
    return Start(nodes=nodes if len(nodes) else own.nodes, grasp=grasp if len(grasp) else own.grasp)


def simulate(twin: Twin, plans: Sequence[WaypointPlan], target: np.ndarray, start: Start) -> RolloutAnswer:
    """Roll a twin out under plans and compare the ends with a target [P, 3]; no points, no costs.

    Raises:
        PlanningError, SimulationError: a plan cannot be simulated, or not from this start.
    """
    shapes = final_shapes(twin, rollout_plans(twin, plans, start=start))
    return RolloutAnswer(shapes=shapes, costs=shape_costs(shapes, target) if len(target) else np.empty(0))
