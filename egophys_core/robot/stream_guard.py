"""The last look at a pose before it goes to the arm: knows nothing of plans, so that no mistake there passes."""

import numpy as np

from egophys_core.errors import RobotError
from egophys_core.robot.frames import Transform
from egophys_core.robot.limits import MEASURED_SLACK, MotionLimits


class StreamGuard:
    """Refuses poses of the tool point that are outside the workspace or a jump away from the one before."""

    def __init__(self, limits: MotionLimits, world_to_base: Transform, start: Transform, largest_step: float) -> None:
        """Knows where the tool stands.

        Args:
            limits: workspace and table.
            world_to_base: where the robot stands.
            start: measured pose of the tool point, world.
            largest_step: metres between poses.
        """
        self._limits = limits
        self._world_to_base = world_to_base
        self._largest_step = largest_step
        self._before = start.translation

    def check(self, pose: Transform) -> None:
        """Let a pose of the tool point (world) pass.

        Raises:
            RobotError: it must not be sent.
        """
        step = float(np.linalg.norm(pose.translation - self._before))
        # The way to a plan begins where the arm was measured.
        reason = self._limits.why_not(pose, self._world_to_base, slack=MEASURED_SLACK)
        if reason is None and not step <= self._largest_step:
            reason = f"it is {step:.4f} m from the pose before, at most {self._largest_step:.4f} m may be streamed"
        if reason is not None:
            raise RobotError(f"a pose was not streamed: {reason}; the arm was halted, plan again")
        self._before = pose.translation
