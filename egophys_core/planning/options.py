"""Options of the planner; the same names in YAML, on the command line and as ROS parameters."""

from dataclasses import dataclass

from egophys_core.errors import OptionsError
from egophys_core.options import number, validate


@dataclass(frozen=True, kw_only=True)
class PlanOptions:
    """What MPPI searches over and how long."""

    waypoints: int = number(6, low=1, high=100, doc="free waypoints after the grasp")
    segment_s: float = number(0.6, low=0.05, high=10.0, doc="time between free waypoints, s")
    settle_s: float = number(1.0, low=0.0, high=60.0, doc="time held still at the end, s")
    approach_m: float = number(0.10, low=0.0, high=1.0, doc="height above the grasp to come from, m")
    approach_s: float = number(2.0, low=0.1, high=60.0, doc="time to come down to the grasp, s")
    grip_s: float = number(0.5, low=0.0334, high=10.0, doc="time to close the gripper, s")
    samples: int = number(16, low=2, high=10_000, doc="rollouts per iteration")
    iterations: int = number(12, low=1, high=10_000, doc="MPPI iterations")
    noise_m: float = number(0.03, low=1e-4, high=1.0, doc="standard deviation of a waypoint's step, m")
    noise_decay: float = number(0.9, low=0.1, high=1.0, doc="factor on the noise after each iteration")
    temperature: float = number(0.1, low=1e-3, high=100.0, doc="lambda over the spread of the costs")
    tolerance_m: float = number(
        0.03, low=1e-4, high=1.0, doc="distance to the target up to which it counts as reached, m"
    )
    max_speed_m_s: float = number(0.2, low=0.01, high=2.0, doc="fastest tool motion, m/s")
    low_m: tuple[float, float, float] = number(
        (-0.25, -0.4, 0.0), low=-5.0, high=5.0, doc="lower corner of the box the tool stays in, m, world"
    )
    high_m: tuple[float, float, float] = number(
        (0.2, 0.4, 0.5), low=-5.0, high=5.0, doc="upper corner; the default box is that of the bridge, m, world"
    )

    def __post_init__(self) -> None:
        validate(self)
        if not all(low < high for low, high in zip(self.low_m, self.high_m, strict=True)):
            raise OptionsError(f"low_m must be below high_m on every axis, got {self.low_m} and {self.high_m}")
