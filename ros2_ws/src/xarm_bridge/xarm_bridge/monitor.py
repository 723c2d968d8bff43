"""Watches the arm from a thread of its own: the tool pose often, the error code now and then."""

import threading
from collections.abc import Callable

from egophys_core.errors import RobotError
from egophys_core.robot import Transform
from xarm_bridge.arm import Arm

PERIOD_S = 0.02
POSES_PER_ERROR_CODE = 50


class Monitor:
    """Asks an arm for its pose at about 50 Hz until closed, or until the arm no longer answers."""

    def __init__(self, arm: Arm, on_pose: Callable[[Transform], None], on_failure: Callable[[Exception], None]) -> None:
        """Start. Both functions are called from the monitor's thread; after a failure it has ended."""
        self._arm = arm
        self._on_pose = on_pose
        self._on_failure = on_failure
        self._closing = threading.Event()
        self.error_code = 0
        """The controller's error code at the last look, 0 if none."""
        self._thread = threading.Thread(target=self._watch, name="arm-monitor", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop asking and wait until the last answer is there."""
        self._closing.set()
        self._thread.join()

    def _watch(self) -> None:
        count = 0
        try:
            while not self._closing.wait(PERIOD_S):
                self._on_pose(self._arm.tool_pose())
                if count % POSES_PER_ERROR_CODE == 0:
                    self.error_code = self._arm.error_code()
                count += 1
        except RobotError as error:
            self._on_failure(error)
