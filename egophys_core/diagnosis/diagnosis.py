"""Diagnosis: what a twin lacks, the evidence, and the error before and after; plain data, one JSON file."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from egophys_core.diagnosis.criterion import CriterionResult
from egophys_core.files import write_atomically
from egophys_core.json_numbers import nulled

MOST_MISSES = 3
"""Candidates that a decision lists as nearest misses."""


class Outcome(StrEnum):
    """How a diagnosis ends; exactly one of these."""

    NONE = "none"
    """The residual is at the floor of noise and model: no effect."""
    NAMED = "named"
    AMBIGUOUS = "ambiguous"
    """Several effects explain the residual alike; `experiment` would split them."""
    NAMED_AND_UNEXPLAINED = "named_and_unexplained"
    NAMED_AND_AMBIGUOUS = "named_and_ambiguous"
    """Beside what is named several effects explain the rest alike."""
    UNEXPLAINED = "unexplained"
    """Structure that no effect of the library fits."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A number with its 95 % confidence interval."""

    value: float
    unit: str
    ci95: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class NamedEffect:
    """An effect that the evidence supports."""

    name: str
    parameters: dict[str, Estimate]
    episodes_agree: bool
    """Whether each episode alone asks for the same parameters, within their intervals."""

    @property
    def values(self) -> dict[str, float]:
        """The parameters without their intervals."""
        return {name: each.value for name, each in self.parameters.items()}


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """What was found for one effect of the library."""

    name: str
    held_out_gain: float
    """Log-likelihood gain on blocks and episodes that were not fitted, over the same refit without the effect;
    of what was measured directly, on grips, falls or sheets at rest that were not fitted."""
    p_null: float
    """Share of rehearsed sets without an effect in which some effect gains as much (`null_gains.py`); of what
    was measured directly, how likely such a gain is without it."""
    fitted_gain: float
    """Log-likelihood gain on what was fitted."""
    validation_gain: float | None
    """The effect's share of what is gained in the episodes that took no part in the fit; None without any, or if it was
    not refitted."""
    values: dict[str, float]
    """The fitted parameters, SI units."""
    criteria: tuple[CriterionResult, ...]
    """What it was held against, in that order: all criteria of the verdict if it was refitted, those of the measurement
    if it was measured, else what kept it from a refit."""
    is_measured: bool
    """Whether it was measured directly, without the twin."""


@dataclass(frozen=True, kw_only=True)
class NearestMiss:
    """A candidate that fails few criteria."""

    candidate: str
    failed: tuple[CriterionResult, ...]


@dataclass(frozen=True, kw_only=True)
class Decision:
    """Which rule made the outcome of a search, and by which criterion."""

    rule: str
    """Its name."""
    sentence: str
    """When it applies, and what it makes of that."""
    candidate: str | None
    """Whose criterion decided; None where it is of no candidate."""
    criterion: CriterionResult
    """What decided, with its numbers."""
    beside: tuple[str, ...]
    """The effects that were known when it was made."""
    nearest_misses: tuple[NearestMiss, ...]
    """Where nothing is named: those that came nearest, the nearest first."""

    def with_further_misses(self, misses: Sequence[NearestMiss]) -> "Decision":
        """The decision with others that came less near, as far as there is room for them."""
        return replace(self, nearest_misses=(*self.nearest_misses, *misses)[:MOST_MISSES])


@dataclass(frozen=True, kw_only=True)
class DetectionLimit:
    """How small a size of an effect some recordings can show."""

    effect: str
    parameter: str
    """The size: one of the effect's parameters."""
    unit: str
    null: float
    """Where the effect vanishes."""
    size: float | None
    """How far off that it must be, in the parameter's unit, to be named; None where none within bounds is."""
    alike: tuple[str, ...]
    """Effects that these recordings cannot tell from it."""


@dataclass(frozen=True, kw_only=True)
class PredictionErrors:
    """Errors of a free rollout on one episode: the refit without, and with the effect; metres."""

    episode: str
    track_before_m: float
    track_after_m: float
    chamfer_before_m: float
    chamfer_after_m: float
    last_residual_track_m: float
    """The baseline: before, with the residual of the last fitted frame held."""
    follow_track_m: float
    """Without physics: points move with the nearest hand, at the lag that fits the train frames best."""
    fitted: bool
    """Whether the episode took part in the fit."""


@dataclass(frozen=True, kw_only=True)
class Where:
    """Where the twin is off, before any effect: offsets of tracks from those of its free rollouts."""

    size_m: float
    """Median length of an offset."""
    by_region: dict[str, float]
    """Metres, by where on the object (near the hand, middle, far) and contact (on the table, in the air)."""
    by_motion: dict[str, float]
    """Metres, by speed and strain (low, high third)."""
    worst_time_s: dict[str, float]
    """Per episode the time at which it is largest, seconds."""
    law: str
    """The best generic force law found, as a formula, or empty."""


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What the report draws; metres, per fitted or reported episode by name."""

    times: dict[str, np.ndarray]
    """[T] seconds."""
    before: dict[str, np.ndarray]
    """[T] track error of the free rollout without the effect."""
    after: dict[str, np.ndarray]
    """[T] track error with it."""
    rest: np.ndarray
    """[P, 3] tracks of the first episode at rest, metres."""
    field: np.ndarray
    """[P, 3] their mean residual before any effect, metres."""
    mismatch_gain: float
    """Held-out gain that is reached in few sets that lack nothing."""


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """The whole of it."""

    outcome: Outcome
    effects: tuple[NamedEffect, ...]
    """Those that are named, then those that cannot be told apart."""
    ambiguous: tuple[str, ...]
    """Names of those that cannot be told apart."""
    candidates: tuple[Candidate, ...]
    """By falling held-out gain."""
    decisions: tuple[Decision, ...]
    """Of each search, in order: the first beside what was measured directly, a second one beside what that named."""
    limits: tuple[DetectionLimit, ...]
    """What the fitted recordings could have shown, of every size of every effect that was searched for."""
    experiment: str | None
    scale_m: float
    """Size of the residuals that the refitted twin leaves, before any effect that was searched for:
    `evidence.refit.residual_scale`."""
    where: Where
    error: tuple[PredictionErrors, ...]
    seconds: float
    reason: str
    """Why it ended so, in a sentence or two."""
    twin_id: str
    """Of the twin diagnosed."""
    improved_twin_id: str
    """Of the twin written."""

    def as_dict(self) -> dict[str, Any]:
        """The content of `diagnosis.json`; numbers that are not finite are None."""
        return dict(nulled(asdict(self)))


def save_diagnosis(diagnosis: Diagnosis, path: Path) -> None:
    """Write `diagnosis.json` atomically."""
    write_atomically(path, json.dumps(diagnosis.as_dict(), indent=1).encode())
