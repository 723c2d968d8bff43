"""Injected faults: what goes wrong, when, and for how long."""

import logging
import math
import re
from dataclasses import dataclass

from xarm_bridge.emulator.controller import Controller, Mode

log = logging.getLogger("xarm_emulator")

NUMBER = r"\d+(?:\.\d+)?"
FORM = re.compile(rf"(?P<kind>[a-z-]+)(?:=(?P<value>{NUMBER}))?@(?P<after>{NUMBER})$")

LASTING = ("silence", "cut", "no-reports")
"""Kinds that last: for their value in seconds, without one for good."""
KINDS = (*LASTING, "error", "stop", "mode")

HELP = """\
faults (times in seconds of the arm's clock, see --speedup):
  error=CODE     the controller enters this error, 1 to 255
  stop           somebody presses stop: state 4
  mode=NUMBER    somebody changes the mode from elsewhere: state 5 follows
  silence[=FOR]  the controller hangs: requests are read, not carried out and never answered, no reports come
  cut[=FOR]      the network is cut: nothing passes, connecting times out; afterwards old connections are reset
  no-reports[=FOR]  the report streams stay open and empty
Meanwhile the arm does what it was last told: in servo mode it goes to the newest target and holds there."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One fault, parsed from `error=31@2.5`, `silence=3@2`, `cut@0`, ..."""

    kind: str
    """One of `KINDS`; see `HELP`."""
    value: float | None
    """Controller error code of an `error`, number of a `mode`, seconds that a lasting fault lasts, or nothing."""
    after: float
    """Seconds after the first motion command that the controller accepts."""

    def __str__(self) -> str:
        return self.kind if self.value is None else f"{self.kind}={self.value:g}"

    @classmethod
    def parse(cls, text: str) -> "Fault":
        """Read the command line form.

        Raises:
            ValueError: names the form expected.
        """
        match = FORM.match(text)
        if match is None or match["kind"] not in KINDS:
            raise ValueError(f"fault {text!r} must be KIND@SECONDS or KIND=VALUE@SECONDS, kinds: {', '.join(KINDS)}")
        fault = cls(
            kind=match["kind"],
            value=None if match["value"] is None else float(match["value"]),
            after=float(match["after"]),
        )
        if wrong := fault._value_wrong():
            raise ValueError(f"fault {text!r}: {wrong}")
        return fault

    def _value_wrong(self) -> str:
        if self.kind == "error" and self.value not in range(1, 256):
            return "controller error codes are 1 to 255"
        if self.kind == "mode" and self.value not in list(Mode):
            return f"modes emulated are {', '.join(str(mode.value) for mode in Mode)}"
        if self.kind == "stop" and self.value is not None:
            return "a stop has no value"
        if self.kind in LASTING and self.value == 0:
            return "a fault of 0 s is none"
        return ""


class FaultSchedule:
    """Lets each fault happen at its time, and end."""

    def __init__(self, faults: list[Fault]) -> None:
        self._waiting = list(faults)
        self._started: float | None = None
        self._ends: dict[str, float] = {}

    @property
    def cut(self) -> bool:
        """Whether the network is cut now."""
        return "cut" in self._ends

    @property
    def silent(self) -> bool:
        """Whether requests are lost now."""
        return self.cut or "silence" in self._ends

    @property
    def reports_stopped(self) -> bool:
        """Whether no report comes now."""
        return self.silent or "no-reports" in self._ends

    def advance(self, controller: Controller, now: float) -> None:
        """End the faults that are over and cause those that are due at a time in seconds."""
        for kind in [kind for kind, end in self._ends.items() if now >= end]:
            log.warning("%s is over", kind)
            del self._ends[kind]
        if self._started is None and controller.motion_commands:
            self._started = now
        if self._started is None:
            return
        for fault in [fault for fault in self._waiting if now - self._started >= fault.after]:
            self._waiting.remove(fault)
            self.cause(fault, controller, now)

    def cause(self, fault: Fault, controller: Controller, now: float) -> None:
        """Let a fault happen now, whatever its time."""
        log.warning("fault %s", fault)
        if fault.kind in LASTING:
            self._ends[fault.kind] = math.inf if fault.value is None else now + fault.value
        elif fault.kind == "error":
            controller.raise_error(int(fault.value or 0))
        elif fault.kind == "mode":
            controller.set_mode(int(fault.value or 0))
        else:
            controller.stop()
