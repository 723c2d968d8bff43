"""Where what is replayed differs from what was recorded: the first place, and how many there are."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from egophys_core.twin import Twin
from egophys_core.waypoint_plan import WaypointPlan

_PLAN_UNITS = {"times": "s", "positions": "m", "quaternions": "", "gripper_opening": "m"}


@dataclass(frozen=True, kw_only=True)
class Difference:
    """The first of the values that differ."""

    quantity: str
    """What differs: `positions`."""
    unit: str = ""
    place: str = ""
    """What there is one value of: `waypoint`; empty for what has no places."""
    index: int | None = None
    """Of the first place that differs, from 0; None where there are no places, or not equally many."""
    recorded: Any
    """Value there in the log: a number, a list of numbers, a word."""
    replayed: Any
    differing: int = 1
    """Number of places that differ."""
    of: int = 1
    """Number of places."""

    def __str__(self) -> str:
        """What and where, without the values."""
        if self.index is None:
            return f"{self.quantity} differ"
        return (
            f"{self.quantity} differ at {self.differing} of {self.of} {self.place}s, first at {self.place} {self.index}"
        )


def difference_of_plans(recorded: WaypointPlan, replayed: WaypointPlan) -> Difference | None:
    """None if they are the same, bit for bit."""
    for name, unit in _PLAN_UNITS.items():
        found = difference_of_arrays(getattr(recorded, name), getattr(replayed, name), name, "waypoint", unit)
        if found is not None:
            return found
    if recorded.predicted_cost == replayed.predicted_cost:
        return None
    return Difference(
        quantity="predicted costs", unit="m", recorded=recorded.predicted_cost, replayed=replayed.predicted_cost
    )


def difference_of_twins(recorded: Twin, replayed: Twin) -> Difference | None:
    """Parameters first, then what there is of each node and spring, then where the twins come from."""
    headers = [_flat(each.header()) for each in (recorded, replayed)]
    of_model = [{key: each[key] for key in each if not key.startswith("provenance")} for each in headers]
    return (
        _difference_of_mappings(*of_model)
        or next(filter(None, (_difference_of_array(name, recorded, replayed) for name in recorded.arrays())), None)
        or _difference_of_mappings(*headers)
    )


def difference_of_arrays(
    recorded: np.ndarray, replayed: np.ndarray, quantity: str, place: str, unit: str = ""
) -> Difference | None:
    """The first row of two arrays that differs; None if none does, where NaN is NaN."""
    if recorded.shape != replayed.shape:
        counts = len(recorded), len(replayed)
        return Difference(quantity=f"numbers of {place}s", recorded=counts[0], replayed=counts[1])
    differs = (recorded != replayed) & ~(_is_nan(recorded) & _is_nan(replayed))
    rows = np.flatnonzero(differs.reshape(len(differs), -1).any(axis=1))
    if not len(rows):
        return None
    first = int(rows[0])
    return Difference(
        quantity=quantity,
        unit=unit,
        place=place,
        index=first,
        recorded=recorded[first].tolist(),
        replayed=replayed[first].tolist(),
        differing=len(rows),
        of=len(differs),
    )


def _difference_of_array(name: str, recorded: Twin, replayed: Twin) -> Difference | None:
    of_springs = name in ("springs", "kinds", "rest_lengths", "stiffness")
    place = "spring" if of_springs else "controller" if name == "grasp" else "node"
    return difference_of_arrays(recorded.arrays()[name], replayed.arrays()[name], name, place)


def _difference_of_mappings(recorded: Mapping[str, Any], replayed: Mapping[str, Any]) -> Difference | None:
    for key in dict.fromkeys((*recorded, *replayed)):
        if recorded.get(key) != replayed.get(key):
            return Difference(quantity=key, recorded=recorded.get(key), replayed=replayed.get(key))
    return None


def _flat(content: Any, name: str = "") -> dict[str, Any]:
    """Values of nested mappings and lists by their path, `parameters.node_mass`."""
    if isinstance(content, list | tuple):
        content = {str(index): each for index, each in enumerate(content)}
    if not isinstance(content, Mapping):
        return {name: content}
    parts = (_flat(each, f"{name}.{part}".lstrip(".")) for part, each in content.items())
    return {key: value for part in parts for key, value in part.items()}


def _is_nan(values: np.ndarray) -> np.ndarray:
    return np.isnan(values) if values.dtype.kind == "f" else np.zeros(values.shape, bool)
