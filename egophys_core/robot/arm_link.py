"""Watches an arm from a thread of its own: where it is, its errors, who owns it; finds it again when it was lost."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from egophys_core.errors import ArmLostError, RobotError
from egophys_core.robot.arm_driver import ArmDriver, ArmState
from egophys_core.robot.measured_arm import MeasuredArm
from egophys_core.robot.ownership import RENEW_PERIOD_S, Ownership

PERIOD_S = 0.02
ERROR_PERIOD_S = 0.2
RETRY_PERIOD_S = 1.0


@dataclass(frozen=True, kw_only=True)
class LinkEvents:
    """What the link tells, from its thread."""

    on_state: Callable[[ArmState], None] = lambda state: None
    """Fifty times a second."""
    on_error: Callable[[int], None] = lambda code: None
    """The controller's error code has changed; 0 is none."""
    on_lost: Callable[[RobotError], None] = lambda error: None
    """The arm no longer answers, or another process has taken it."""
    on_found: Callable[[], None] = lambda: None
    """It answers again, and has been halted: nothing goes on that was begun before."""


class ArmLink:
    """The connection to an arm while it is in use."""

    def __init__(self, driver: ArmDriver, measured: MeasuredArm, ownership: Ownership, events: LinkEvents) -> None:
        """Start to watch a connected arm."""
        self._driver = driver
        self._measured = measured
        self._ownership = ownership
        self._events = events
        self._closing = threading.Event()
        self._errors_due = self._renewal_due = 0.0
        self.error_code = 0
        """The controller's error code at the last look, 0 if none."""
        self.lost = ""
        """Why the arm cannot be used now, empty if it can."""
        self._thread = threading.Thread(target=self._watch, name="arm-link", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop watching, and wait until the last answer is there."""
        self._closing.set()
        self._thread.join()

    def lose(self, error: RobotError) -> None:
        """Connect anew: someone got no answer, and one that comes late would be taken for another. From any thread."""
        was_lost, self.lost = self.lost, str(error)
        if not was_lost:
            self._events.on_lost(error)

    def _watch(self) -> None:
        while not self._closing.wait(RETRY_PERIOD_S if self.lost else PERIOD_S):
            try:
                if self.lost:
                    self._find_again()
                else:
                    self._look_twice()
            except RobotError as error:
                self.lose(error)

    def _look_twice(self) -> None:
        """A process that was stopped for a while takes its own silence for that of the arm, once."""
        try:
            self._look()
        except ArmLostError:
            self._look()

    def _look(self) -> None:
        self._events.on_state(self._measured.state(oldest=PERIOD_S / 2))
        now = time.monotonic()
        if now >= self._renewal_due:
            self._renewal_due = now + RENEW_PERIOD_S
            self._ownership.renew()
        if now >= self._errors_due:
            self._errors_due = now + ERROR_PERIOD_S
            self._note_error(self._driver.error_code())

    def _note_error(self, code: int) -> None:
        if code != self.error_code:
            self.error_code = code
            self._events.on_error(code)

    def _find_again(self) -> None:
        self._driver.connect()
        self._ownership.acquire(sleep=self._closing.wait)
        self._driver.halt()
        self.lost = ""
        self._events.on_found()
