"""What the recordings of a diagnosis could have shown, in a sentence and as a table."""

from collections.abc import Mapping, Sequence
from typing import Any

from egophys_core.reporting.diagnosis_words import figures, join
from egophys_core.reporting.html_page import Table

Limits = Sequence[Mapping[str, Any]]
"""Of `diagnosis.json`."""


def limits_in_words(limits: Limits) -> str:
    """From which size on effects would have been named, and which no size shows; empty if nothing is known.

    Of an effect with several sizes the largest counts: it would have shown from there in whatever direction.
    """
    if not limits:
        return "not known of these recordings; two motions tell"
    shown, hidden = [], []
    for name, own in _by_effect(limits).items():
        if any(each["size"] is None for each in own):
            hidden.append(name)
        else:
            largest = max(own, key=lambda each: each["size"])
            shown.append(f"{name} from {_quantity(largest)}")
    parts = [join(shown, "and")] if shown else []
    if hidden:
        parts.append(f"in these motions no size shows of {join(hidden, 'and')}")
    return "; ".join(parts)


def limits_table(limits: Limits) -> Table:
    """A row for every size of every effect."""
    return Table(
        header=("effect", "parameter", "shows from", "cannot be told from"),
        rows=[
            [
                each["effect"],
                each["parameter"],
                "in no size" if each["size"] is None else _quantity(each),
                ", ".join(each["alike"]),
            ]
            for each in limits
        ],
        kinds=("", "text", "", "text"),
    )


def _by_effect(limits: Limits) -> dict[str, list[Mapping[str, Any]]]:
    found: dict[str, list[Mapping[str, Any]]] = {}
    for each in limits:
        found.setdefault(each["effect"], []).append(each)
    return found


def _quantity(limit: Mapping[str, Any]) -> str:
    unit = "" if limit["unit"] == "1" else f" {limit['unit']}"
    return f"{figures(limit['size'])}{unit}"
