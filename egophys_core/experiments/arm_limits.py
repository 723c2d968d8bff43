"""Which motions an arm may do: those of whose plans its bridge would refuse none."""

from dataclasses import replace

import numpy as np

from egophys_core.errors import RobotError
from egophys_core.experiments.family import HandMotion, hangs_in_a_hand
from egophys_core.experiments.hand_path import plan_of_path
from egophys_core.robot import MotionLimits, Transform, check_plan
from egophys_core.twin import Twin


def why_no_motion_of_an_arm(motion: HandMotion, twin: Twin, limits: MotionLimits) -> str | None:
    """Why the bridge would refuse a motion, or None.

    Plans are held against all limits. Where the arm stands beside the object is not known here, so it is taken to stand
    best for the motion: with the table at z = 0 of its base, its axes along those of the world, and its box about the
    middle of the motion in x and y. So a motion that is too wide for the box is refused, but not one that is merely
    beside it: whoever places the object sees to that, and the bridge checks it. What hangs in a hand has no table, and
    the box is about the middle of its motion in z, too.
    """
    box = np.array([limits.workspace_min_m, limits.workspace_max_m])
    for path in motion.paths:
        plan = plan_of_path(path, "")
        extent = np.array([plan.positions.min(axis=0), plan.positions.max(axis=0)])
        shift = box.mean(axis=0) - extent.mean(axis=0)
        if not hangs_in_a_hand(twin):
            shift[2] = -twin.ground_height
        # Nodes are float32: what lies on the table is not a rounding error below it.
        moved = replace(plan, positions=np.round(plan.positions + shift, 6))
        try:
            check_plan(moved, limits, Transform.identity())
        except RobotError as error:
            return str(error)
    return None
