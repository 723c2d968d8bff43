"""What a diagnosis left open, from the content of its `diagnosis.json`."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from egophys_core.diagnosis.diagnosis import DetectionLimit
from egophys_core.diagnosis.saving import DIAGNOSIS_NAME
from egophys_core.effects import effect_named
from egophys_core.errors import DiscrepancyError, TwinError
from egophys_core.json_numbers import finite_number


@dataclass(frozen=True, kw_only=True)
class OpenQuestions:
    """What to ask about, and what is known."""

    effects: tuple[str, ...]
    """To ask about: those that it could not tell apart, else all that it does not name. What came nearest to being
    named is no guide: what the motions could not show comes last."""
    ambiguous: tuple[str, ...]
    """Those that it could not tell apart."""
    limits: tuple[DetectionLimit, ...]
    """What its recordings could have shown."""
    scale_m: float
    """Size of the residuals that its twin leaves."""


def read_open_questions(folder: Path) -> OpenQuestions:
    """What the `diagnosis.json` in a folder leaves open.

    Raises:
        DiscrepancyError: there is none, one of an earlier version, or a damaged one.
    """
    path = folder / DIAGNOSIS_NAME
    try:
        content = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise DiscrepancyError(f"cannot read {path}: {error}; give the folder that `egophys diagnose` made") from error
    try:
        return open_questions(content)
    except DiscrepancyError as error:
        raise DiscrepancyError(f"{path}: {error}; diagnose again") from error


def open_questions(content: Any) -> OpenQuestions:
    """What the content of a `diagnosis.json` leaves open.

    Raises:
        DiscrepancyError: it is not what a diagnosis has.
    """
    if not isinstance(content, Mapping):
        raise DiscrepancyError(f"a diagnosis is a JSON object, got {type(content).__name__}")
    for name in ("limits", "ambiguous", "scale_m", "effects", "candidates"):
        if name not in content:
            raise DiscrepancyError(f"it lacks `{name}`, as one of an earlier version does")
    ambiguous = tuple(_effect(each, "ambiguous") for each in _items(content, "ambiguous"))
    named, candidates = (
        [_effect(each.get("name") if isinstance(each, Mapping) else each, key) for each in _items(content, key)]
        for key in ("effects", "candidates")
    )
    return OpenQuestions(
        effects=ambiguous or tuple(name for name in candidates if name not in named),
        ambiguous=ambiguous,
        limits=tuple(_limit(each) for each in _items(content, "limits")),
        scale_m=_number(content["scale_m"], "`scale_m`", low=0.0),
    )


def _items(content: Mapping[str, Any], key: str) -> list[Any]:
    value = content[key]
    if not isinstance(value, list):
        raise DiscrepancyError(f"`{key}` must be a list, got {value!r:.80}")
    return value


def _effect(name: Any, key: str) -> str:
    if not isinstance(name, str):
        raise DiscrepancyError(f"`{key}` must name effects, got {name!r:.80}")
    try:
        return effect_named(name).name
    except TwinError as error:
        raise DiscrepancyError(f"`{key}`: {error}") from error


def _limit(value: Any) -> DetectionLimit:
    names = [field.name for field in fields(DetectionLimit)]
    if not isinstance(value, Mapping) or set(value) != set(names):
        raise DiscrepancyError(f"each of `limits` has {', '.join(names)}, got {value!r:.80}")
    for name in ("parameter", "unit"):
        if not isinstance(value[name], str):
            raise DiscrepancyError(f"`{name}` in `limits` must be a text, got {value[name]!r:.80}")
    return DetectionLimit(
        effect=_effect(value["effect"], "limits"),
        parameter=value["parameter"],
        unit=value["unit"],
        null=_number(value["null"], "`null` in `limits`"),
        size=None if value["size"] is None else _number(value["size"], "`size` in `limits`", low=0.0),
        alike=tuple(_effect(each, "limits") for each in _items(value, "alike")),
    )


def _number(value: Any, what: str, *, low: float = -math.inf) -> float:
    """A finite number above `low`."""
    number = finite_number(value)
    if number is None or not number > low:
        above = "" if low == -math.inf else f" above {low:g}"
        raise DiscrepancyError(f"{what} must be a finite number{above}, got {value!r:.80}")
    return number
