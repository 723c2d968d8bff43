"""The plan file: what `egophys plan` writes and the bridge, `egophys execute` and services take. JSON, SI units."""

import difflib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from egophys_core.errors import PlanningError
from egophys_core.files import FileKind, write_json
from egophys_core.json_numbers import finite_number, nulled
from egophys_core.waypoint_plan import WaypointPlan, why_no_motion

ARRAYS = {
    "times_s": "times",
    "positions_m": "positions",
    "quaternions_xyzw": "quaternions",
    "gripper_opening_m": "gripper_opening",
}
"""Keys of the file and the fields of `WaypointPlan` they hold."""

PLAN_FILE = FileKind(name="a plan", head=rb'\s*\{.*"stamp_ns":')
LATEST_STAMP_NS = 2**63
"""What a clock of nanoseconds counts to, in the year 2262."""


@dataclass(frozen=True, kw_only=True)
class PlanFile:
    """A plan, when it was made and how near to its target it had to end."""

    plan: WaypointPlan
    stamp_ns: int
    """When it was planned, nanoseconds since the epoch."""
    tolerance: float
    """Distance to the target up to which the target counts as reached, metres; NaN if the plan has no target."""

    @property
    def reached(self) -> bool:
        """Whether the plan is predicted to end within the tolerance; also where it has no target."""
        return math.isnan(self.tolerance) or self.plan.predicted_cost <= self.tolerance


def write_plan(path: Path, content: PlanFile) -> None:
    """Write a plan file, atomically; what is not a number is null.

    Raises:
        PlanningError: it cannot be written there.
    """
    plan = content.plan
    keys = {key: getattr(plan, name).tolist() for key, name in ARRAYS.items()}
    about = {
        "twin_id": plan.twin_id,
        "stamp_ns": content.stamp_ns,
        "predicted_cost_m": plan.predicted_cost,
        "tolerance_m": content.tolerance,
        "reached": content.reached,
    }
    try:
        write_json(path, nulled({**about, **keys}))
    except OSError as error:
        raise PlanningError(f"cannot write plan {path}: {error.strerror}") from error


def read_plan(path: Path) -> PlanFile:
    """Read a plan file. Whether an arm may execute it is for `egophys_core.robot.check_plan` to say.

    Raises:
        PlanningError: absent, not JSON, keys missing or unknown, a value of the wrong type or shape, or numbers that
            are no motion of a hand or an arm.
    """
    try:
        content = json.loads(Path(path).read_text("utf-8"), parse_constant=_no_number)
    except (OSError, ValueError, RecursionError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise PlanningError(
            f"cannot read plan {path}: {reason}; a plan file is the JSON that `egophys plan` writes"
        ) from error
    try:
        return _plan_of(content)
    except PlanningError as error:
        raise PlanningError(f"plan {path}: {error}") from error


def _plan_of(content: Any) -> PlanFile:
    if not isinstance(content, Mapping):
        raise PlanningError(f"a plan is a JSON object, got {type(content).__name__}")
    known = (*ARRAYS, "twin_id", "stamp_ns", "predicted_cost_m", "tolerance_m", "reached")
    for key in content:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1, cutoff=0.0)
            raise PlanningError(f"unknown key {key!r}; did you mean {near[0]!r}?")
    missing = [key for key in known if key not in content]
    if missing:
        raise PlanningError(f"it lacks {', '.join(missing)}; write it with `egophys plan`")
    stamp_ns, twin_id, reached = content["stamp_ns"], content["twin_id"], content["reached"]
    if type(stamp_ns) is not int or not 0 <= stamp_ns < LATEST_STAMP_NS:
        raise PlanningError(f"stamp_ns must be whole nanoseconds since the epoch, got {stamp_ns!r}")
    if not isinstance(twin_id, str):
        raise PlanningError(f"twin_id must be a text, got {twin_id!r}")
    found = PlanFile(
        plan=WaypointPlan(
            **{name: _array(content[key], key) for key, name in ARRAYS.items()},
            twin_id=twin_id,
            predicted_cost=_number(content["predicted_cost_m"], "predicted_cost_m"),
        ),
        stamp_ns=stamp_ns,
        tolerance=_number(content["tolerance_m"], "tolerance_m"),
    )
    if reason := why_no_motion(found.plan):
        raise PlanningError(reason)
    if reached is not found.reached:
        raise PlanningError(
            f"reached is {json.dumps(reached)}, but a predicted cost of {found.plan.predicted_cost:g} m with a "
            f"tolerance of {found.tolerance:g} m says {json.dumps(found.reached)}; plan again"
        )
    return found


def _array(value: Any, key: str) -> np.ndarray:
    try:
        array = np.array(value)
    except ValueError:  # lists of different lengths
        array = np.array(None)
    if array.dtype.kind not in "iuf":
        raise PlanningError(f"{key} must be numbers, one row a waypoint, all of one length")
    return array.astype(np.float64)


def _number(value: Any, key: str) -> float:
    if value is None:
        return float("nan")
    number = finite_number(value)
    if number is None:
        raise PlanningError(f"{key} must be metres or null, got {value!r:.80}")
    return number


def _no_number(name: str) -> float:
    raise ValueError(f"{name} is not JSON")
