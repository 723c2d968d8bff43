"""A twin as forward model: what waypoint plans do to the object, and what that costs."""

from collections.abc import Sequence

import numpy as np

from egophys_core.errors import PlanningError
from egophys_core.evaluation import two_way_chamfer
from egophys_core.planning.grasp import controls_of_plan, grasp_from_points
from egophys_core.planning.start import Start, require_start, start_of_twin
from egophys_core.simulation import Rollout, batch_of_models, rollout
from egophys_core.twin import Twin
from egophys_core.waypoint_plan import WaypointPlan


def rollout_plans(twin: Twin, plans: Sequence[WaypointPlan], *, start: Start | None = None) -> Rollout:
    """Roll out the twin from rest under several plans at once.

    The plans must close the gripper at the same time and last equally long, so that they share frames.

    Args:
        start: where the object lies and is held; by default as the twin was built.

    Raises:
        PlanningError, SimulationError: a plan cannot be simulated, or not from this start.
    """
    if not plans:
        raise PlanningError("no plan to roll out")
    start = start or start_of_twin(twin)
    require_start(start, twin)
    grasp = grasp_from_points(start.grasp)
    controls = [controls_of_plan(plan, grasp) for plan in plans]
    count = len(plans)
    return rollout(
        batch_of_models([twin.model] * count, controls, starts=[start.nodes] * count, ground_height=twin.ground_height)
    )


def final_shapes(twin: Twin, result: Rollout) -> np.ndarray:
    """[K, S, 3] float32 metres, world: the surface nodes at the end of each rollout."""
    return result.positions[:, -1][:, twin.model.graph.surface]


def twin_costs(
    twin: Twin, plans: Sequence[WaypointPlan], target: np.ndarray, *, start: Start | None = None
) -> np.ndarray:
    """[K] metres: what the plans cost for a target shape [P, 3], by `shape_costs` of the rolled-out ends."""
    return shape_costs(final_shapes(twin, rollout_plans(twin, plans, start=start)), target)


def shape_costs(shapes: np.ndarray, target: np.ndarray) -> np.ndarray:
    """[K] metres: two-way Chamfer distance of shapes [K, S, 3] to a target [P, 3]; infinite if not finite.

    Raises:
        PlanningError: the target is empty or not finite.
    """
    if target.ndim != 2 or target.shape[1] != 3 or len(target) == 0 or not np.isfinite(target).all():
        raise PlanningError(f"the target must be [P, 3] finite points in metres, got shape {target.shape}")
    return np.array([two_way_chamfer(shape, target) if np.isfinite(shape).all() else np.inf for shape in shapes])
