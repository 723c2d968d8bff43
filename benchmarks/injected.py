"""Diagnoses of rehearsed episodes with an injected effect, or none: the confusion matrix by size of the effect.

Every data set is a new object: three motions in the MuJoCo world, a twin fitted to two of them, and the diagnosis of
that twin on them, which the third has to bear out. Results are kept after each set, and a run goes on where the last
one stopped.
"""

import json
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.kept import kept_in
from benchmarks.movement import movement
from benchmarks.provenance import commit
from benchmarks.side_by_side import side_by_side
from egophys_core.diagnosis.diagnose import diagnose, fitted_and_validation
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.diagnosis.verdict.search_verdict import Search
from egophys_core.episode import Episode
from egophys_core.files import write_json
from egophys_core.identification import FitOptions, build
from egophys_core.rehearsal.injection import INJECTABLE, injected_sizes
from egophys_core.rehearsal.options import Motion, RehearsalObject, RehearsalOptions
from egophys_core.rehearsal.world import rehearse

RESULT = Path(__file__).parent / "results/injected.json"

FIT = FitOptions(generations=6, dense_steps=0)
"""A quick twin: the diagnosis refits it anyway."""

DIAGNOSIS = DiagnosisOptions(surrogates=60, bootstraps=200)

NONE_SETS = 20

POINTS = 200
"""Tracked points of an object; a set of 350 takes nearly twice as long."""

SLIDING = (Motion.PULL, Motion.DOUBLE_PULL, Motion.PULL)
HOLDING = (Motion.HANG, Motion.LIFT, Motion.SHAKE)
LIFTING = (Motion.LIFT, Motion.DOUBLE_LIFT, Motion.SHAKE)
MOVING = (Motion.LIFT, Motion.SHAKE, Motion.DOUBLE_LIFT)
MOTIONS = {
    "place_dependent_friction": SLIDING,
    "stribeck_friction": SLIDING,
    "table_adhesion": LIFTING,
    "grasp_slip": HOLDING,
    "viscoelasticity": HOLDING,
    "plasticity": HOLDING,
    "hysteresis": HOLDING,
}
"""Motions in which an effect shows, of which the last is not fitted; `MOVING` for the others."""

SOLIDS = ("uneven_mass", "plasticity", "viscoelasticity", "tension_compression_asymmetry", "hysteresis")
"""Effects that are injected into a toy; the others in a sheet."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One data set."""

    effect: str
    """Name, or "none"."""
    size: str
    """"small", "large", or "" for none."""
    object: str
    motions: tuple[str, ...]
    object_seed: int
    without: str = ""
    """Effect taken out of the library."""

    @property
    def key(self) -> str:
        """What tells cases apart."""
        return json.dumps(asdict(self), sort_keys=True)


def cases() -> list[Case]:
    """Those without an effect, the large ones, the small ones, and the large ones without their entry."""
    objects = list(RehearsalObject)
    motions = (MOVING, HOLDING, LIFTING, SLIDING, (Motion.LIFT, Motion.PULL, Motion.DOUBLE_LIFT))
    nothing = [
        Case(
            effect="none",
            size="",
            object=objects[index % len(objects)],
            motions=motions[index % len(motions)],
            object_seed=100 + index,
        )
        for index in range(NONE_SETS)
    ]
    injected = [
        Case(
            effect=name,
            size=size,
            object=RehearsalObject.ELLIPSOID if name in SOLIDS else RehearsalObject.SHEET,
            motions=MOTIONS.get(name, MOVING),
            object_seed=200 + index,
            without=name if left_out else "",
        )
        for size, left_out in (("large", False), ("small", False), ("large", True), ("small", True))
        for index, name in enumerate(INJECTABLE)
    ]
    return [*nothing, *injected]


def episodes_of(case: Case) -> list[Episode]:
    """The rehearsed episodes of a case, the last of which is not fitted."""
    options = RehearsalOptions(object=RehearsalObject(case.object), points=POINTS)
    return [
        rehearse(options, motion, seed=seed, effects=_effects(case), object_seed=case.object_seed)
        for motion, seed in _motions(case)
    ]


def movement_of(case: Case) -> float:
    """Metres by which the effect of a case moves the points."""
    options = RehearsalOptions(
        object=RehearsalObject(case.object), points=POINTS, noise_m=0.0, dropout=0.0, occlusion=False
    )
    return movement(options, _motions(case), _effects(case), object_seed=case.object_seed)


def _effects(case: Case) -> Mapping[str, Mapping[str, float]]:
    return {} if case.effect == "none" else {case.effect: injected_sizes(case.effect)[case.size]}


def _motions(case: Case) -> list[tuple[Motion, int]]:
    """The motions of a case, each with the seed of its hands."""
    return [(Motion(motion), 10 * case.object_seed + index) for index, motion in enumerate(case.motions)]


def measure(case: Case) -> dict[str, Any]:
    """One row of the result."""
    episodes = episodes_of(case)
    twin = build(fitted_and_validation(episodes)[0], FIT, seed=0)
    started = time.monotonic()
    left_out = (case.without,) if case.without else ()
    finding = diagnose(twin, episodes, DIAGNOSIS, without=left_out)
    diagnosis = finding.diagnosis
    content = diagnosis.as_dict()
    return {
        **asdict(case),
        "outcome": str(diagnosis.outcome),
        "named": [effect.name for effect in diagnosis.effects],
        "beside": [effect.name for effect in diagnosis.effects if effect.name not in diagnosis.ambiguous],
        "effects": content["effects"],
        "reason": diagnosis.reason,
        "candidates": content["candidates"][:5],
        "searches": [_searched(search) for search in finding.searches],
        "track_before_m": [error.track_before_m for error in diagnosis.error],
        "track_after_m": [error.track_after_m for error in diagnosis.error],
        "seconds": time.monotonic() - started,
        "commit": commit(),
    }


def _searched(search: Search) -> dict[str, Any]:
    """What the verdict of a search rested on: thresholds are calibrated on these."""
    return {
        "scale_m": search.before.scale,
        "law_gain": search.law.held_out_gain,
        "judged": [
            {
                "name": each.name,
                "fitted_gain": each.fitted_gain,
                "held_out_gain": each.held_out_gain,
                "gain_ci95": each.gain_ci95,
                "episode_gains": each.episode_gains.tolist(),
                "validation_gains": each.validation_gains.tolist(),
                "share_of_surrogates": search.ranking.share_of_surrogates(each.gain),
                "parameters": {name: asdict(estimate) for name, estimate in each.parameters.items()},
                "episodes_agree": each.episodes_agree,
            }
            for each in search.refitted
        ],
    }


def run(*, minutes: float = 1e9) -> dict[str, Any]:
    """Measure what is missing; the keys of `results/injected.json`.

    Args:
        minutes: begin no further case after this long.
    """
    kept = kept_in(RESULT, {"rows": []})
    rows, moved = kept["rows"], kept.setdefault("moved_m", {})
    done = {_key(row) for row in rows}
    injected = [case for case in cases() if case.effect != "none" and not case.without]
    unmoved = [case for case in injected if case.size not in moved.get(case.effect, {})]
    for case, metres in side_by_side(movement_of, unmoved, minutes=minutes):
        moved.setdefault(case.effect, {})[case.size] = metres
        write_json(RESULT, kept)
    missing = [case for case in cases() if case.key not in done]
    for _, row in side_by_side(measure, missing, minutes=minutes):
        rows.append(row)
        write_json(RESULT, kept)
    return {"rows": rows, "moved_m": moved}


def _key(row: Mapping[str, Any]) -> str:
    return json.dumps({name: row[name] for name in Case.__dataclass_fields__}, sort_keys=True)
