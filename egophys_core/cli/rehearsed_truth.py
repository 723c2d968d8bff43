"""What `truth.json` in a folder of `egophys rehearse` says of the object, so that it can be handled again."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from egophys_core.errors import OptionsError
from egophys_core.json_numbers import finite_number
from egophys_core.rehearsal import RehearsalOptions


@dataclass(frozen=True, kw_only=True)
class RehearsedTruth:
    """The object, how it is seen, and what was injected."""

    options: RehearsalOptions
    object_seed: int
    effects: dict[str, dict[str, float]]
    """By name, with every parameter."""
    last_seed: int
    """The largest seed of an episode there; 0 if there is none."""


def read_truth(folder: Path) -> RehearsedTruth:
    """Read the `truth.json` in a folder.

    Raises:
        OptionsError: there is none, or not as `egophys rehearse` writes it.
    """
    from egophys_core.options import from_mapping
    from egophys_core.rehearsal import complete_effects

    path = folder / "truth.json"
    try:
        truth = _mapping(json.loads(path.read_text("utf-8")), "it")
        episodes = [_mapping(each, "each of `episodes`") for each in _items(truth, "episodes")]
        effects = [_mapping(each, "each of `effects`") for each in _items(truth, "effects")]
        return RehearsedTruth(
            options=from_mapping(RehearsalOptions, _mapping(truth.get("options"), "`options`")),
            object_seed=_seed(truth, "object_seed"),
            effects=complete_effects({_name(each): _parameters(each) for each in effects}),
            last_seed=max((_seed(each, "seed") for each in episodes), default=0),
        )
    except (OSError, ValueError, RecursionError, OptionsError) as error:
        raise OptionsError(
            f"--world {folder}: cannot use {path}: {error}; give a folder of `egophys rehearse`"
        ) from error


def _parameters(effect: Mapping[str, Any]) -> dict[str, float]:
    found = {}
    for name, about in _mapping(effect.get("parameters"), f"`parameters` of {_name(effect)}").items():
        value = finite_number(about.get("value")) if isinstance(about, Mapping) else None
        if value is None:
            raise OptionsError(f"{_name(effect)}: {name} must have a finite number as its `value`, got {about!r:.80}")
        found[name] = value
    return found


def _name(effect: Mapping[str, Any]) -> str:
    name = effect.get("name")
    if not isinstance(name, str):
        raise OptionsError(f"the `name` of an effect must be a text, got {name!r:.80}")
    return name


def _mapping(value: Any, what: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise OptionsError(f"{what} must be a JSON object, got {value!r:.80}")
    return value


def _items(truth: Mapping[str, Any], key: str) -> list[Any]:
    value = truth.get(key)
    if not isinstance(value, list):
        raise OptionsError(f"`{key}` must be a list, got {value!r:.80}")
    return value


def _seed(content: Mapping[str, Any], key: str) -> int:
    value = content.get(key)
    if type(value) is not int or value < 0:
        raise OptionsError(f"`{key}` must be a whole number from 0 on, got {value!r:.80}")
    return value
