"""One measurement of the arm for all who ask at the same time, so that watching it costs the stream little."""

import threading
import time

from egophys_core.robot.arm_driver import ArmDriver, ArmState
from egophys_core.waypoint_plan import NANOSECONDS


class MeasuredArm:
    """Asks a driver for its state, at most as often as someone needs a newer one. From any thread."""

    def __init__(self, driver: ArmDriver) -> None:
        self._driver = driver
        self._lock = threading.Lock()
        self._newest: ArmState | None = None

    def state(self, *, oldest: float) -> ArmState:
        """A state that was measured at most `oldest` seconds ago.

        Raises:
            RobotError: the arm does not tell.
        """
        with self._lock:
            if self._newest is None or time.time_ns() - self._newest.stamp_ns > oldest * NANOSECONDS:
                self._newest = self._driver.state()
            return self._newest
