"""Injected faults: what goes wrong, and when, counted from the first motion command."""

import re
from dataclasses import dataclass

from xarm_bridge.emulator.controller import Controller

FORM = re.compile(r"(?P<kind>error|silence|no-reports)(?:=(?P<code>\d{1,3}))?@(?P<after>\d+(?:\.\d+)?)$")


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One fault, parsed from `error=31@2.5`, `silence@2.5` or `no-reports@0`."""

    kind: str
    """`error`: the controller enters this error; `silence`: commands are read and never answered;
    `no-reports`: the report stream stays open and empty."""
    code: int
    """Controller error code 1 to 255 of an `error`."""
    after: float
    """Seconds after the first motion command that the controller accepts."""

    @classmethod
    def parse(cls, text: str) -> "Fault":
        """Read the command line form.

        Raises:
            ValueError: names the form expected.
        """
        match = FORM.match(text)
        if match is None or (match["kind"] == "error") != (match["code"] is not None):
            raise ValueError(f"fault {text!r} must be error=CODE@SECONDS, silence@SECONDS or no-reports@SECONDS")
        code = int(match["code"] or 0)
        if match["kind"] == "error" and not 1 <= code <= 255:
            raise ValueError(f"fault {text!r}: controller error codes are 1 to 255")
        return cls(kind=match["kind"], code=code, after=float(match["after"]))


class FaultSchedule:
    """Lets each fault happen once, at its time."""

    def __init__(self, faults: list[Fault]) -> None:
        self._waiting = list(faults)
        self._started: float | None = None
        self.silent = False
        self.reports_stopped = False

    def advance(self, controller: Controller, now: float) -> None:
        """Cause the faults that are due at a time in seconds."""
        if self._started is None and controller.motion_commands:
            self._started = now
        if self._started is None:
            return
        for fault in [fault for fault in self._waiting if now - self._started >= fault.after]:
            self._waiting.remove(fault)
            if fault.kind == "error":
                controller.raise_error(fault.code)
            elif fault.kind == "silence":
                self.silent = True
            else:
                self.reports_stopped = True
