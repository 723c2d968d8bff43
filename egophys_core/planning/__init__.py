"""Planning with a twin as forward model: MPPI over tool waypoints to a target shape."""

from typing import TYPE_CHECKING

from egophys_core.on_demand import names_on_demand
from egophys_core.planning.options import PlanOptions

if TYPE_CHECKING:
    from egophys_core.planning.bag_frame import path_and_frame
    from egophys_core.planning.forward import final_shapes, rollout_plans, shape_costs, twin_costs
    from egophys_core.planning.grasp import Grasp, controls_of_plan, grasp_from_points
    from egophys_core.planning.mppi import ForwardModel, plan_to_target
    from egophys_core.planning.start import Start, carried_start, start_of_twin
    from egophys_core.planning.start_source import start_of_source
    from egophys_core.planning.target import TargetText, check_shape, parse_target, target_points

__all__ = [
    "ForwardModel",
    "Grasp",
    "PlanOptions",
    "Start",
    "TargetText",
    "carried_start",
    "check_shape",
    "controls_of_plan",
    "final_shapes",
    "grasp_from_points",
    "parse_target",
    "path_and_frame",
    "plan_to_target",
    "rollout_plans",
    "shape_costs",
    "start_of_source",
    "start_of_twin",
    "target_points",
    "twin_costs",
]

__getattr__ = names_on_demand(__name__, "bag_frame", "forward", "grasp", "mppi", "start", "start_source", "target")
