"""Diagnoses that may ask: two passive recordings, then at most two motions of their own choice, in the rehearsal world.

Every set is an object nobody has seen, drawn when this was frozen: change `DRAWN` before a new revision is measured.
Results are kept after each set, and a run goes on where the last one stopped. `calibrated_on` of the result are sets
without an effect that were looked at before: what their best effects gained after one or two such motions.
"""

import json
import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.asked_table import limit_of
from benchmarks.injected import DIAGNOSIS, FIT, POINTS
from benchmarks.kept import kept_in
from benchmarks.provenance import commit
from benchmarks.side_by_side import side_by_side
from egophys_core.diagnosis.diagnose import fitted_and_validation
from egophys_core.diagnosis.diagnosis import Diagnosis
from egophys_core.diagnosis.evidence.fitted_parameters import with_effect
from egophys_core.diagnosis.evidence.predicting_twin import predicting_pair
from egophys_core.diagnosis.evidence.refit import refit_from
from egophys_core.diagnosis.tracked_episode import observe
from egophys_core.effects import effect_named
from egophys_core.episode import Episode
from egophys_core.experiments import PERSON, Conclusion, Proposal, diagnose_and_ask
from egophys_core.experiments.hand_path import plan_of_path
from egophys_core.files import write_json
from egophys_core.identification import build
from egophys_core.observation import observe_episodes
from egophys_core.rehearsal import Motion, RehearsalObject, RehearsalOptions, rehearse, rehearse_plans
from egophys_core.rehearsal.injection import injected_sizes
from egophys_core.twin import ObjectModel, Twin

RESULT = Path(__file__).parent / "results/asked.json"

DRAWN = 20261130_02
"""Seed of the objects and motions of this table."""

MOST_ASKED = 2

PASSIVE = (Motion.LIFT, Motion.PULL)
"""What was recorded before anything was asked."""

JUDGED_ON = (Motion.DOUBLE_LIFT, Motion.FOLD, Motion.SHAKE, Motion.DOUBLE_PULL)
"""Motions that have no part in a diagnosis: errors are reported on them, on the first one apart. A sheet crumples there
one way or the other, whatever the effect is; the others say whether what follows from a name is worth more."""

NONE_SETS = 40

AIMS = (
    ("quadratic_drag", RehearsalObject.SHEET),
    ("uneven_mass", RehearsalObject.ELLIPSOID),
    ("gravity_scale", RehearsalObject.SHEET),
    ("gravity_tilt", RehearsalObject.SHEET),
    ("constant_body_force", RehearsalObject.SHEET),
    ("uneven_mass", RehearsalObject.SHEET),
    ("control_delay", RehearsalObject.SHEET),
    ("grasp_slip", RehearsalObject.SHEET),
    ("viscoelasticity", RehearsalObject.ELLIPSOID),
    ("control_delay", RehearsalObject.ELLIPSOID),
    ("gravity_scale", RehearsalObject.ELLIPSOID),
    ("quadratic_drag", RehearsalObject.ELLIPSOID),
    ("grasp_slip", RehearsalObject.ELLIPSOID),
    ("gravity_tilt", RehearsalObject.ELLIPSOID),
    ("constant_body_force", RehearsalObject.ELLIPSOID),
)
"""Effects whose limits have an aim, and in what they are injected."""


@dataclass(frozen=True, kw_only=True)
class AskedCase:
    """One set."""

    effect: str
    """Name, or "none"."""
    size: str
    """"small", "large", or "" for none."""
    object: str
    seed: int
    """Of the object, and ten times that of its motions."""

    @property
    def effects(self) -> Mapping[str, Mapping[str, float]]:
        """What is injected."""
        return {} if self.effect == "none" else {self.effect: injected_sizes(self.effect)[self.size]}


def cases() -> list[AskedCase]:
    """Of every kind some from the first on, so that a part of the table is like the whole."""
    random = np.random.default_rng(DRAWN)
    injected = [(name, size, str(body)) for size in ("large", "small") for name, body in AIMS]
    objects = [str(each) for each in (RehearsalObject.ELLIPSOID, RehearsalObject.SHEET)]
    nothing = [("none", "", objects[index % len(objects)]) for index in range(NONE_SETS)]
    rounds = [each for pair in zip(injected, nothing, strict=False) for each in pair] + nothing[len(injected) :]
    seeds = random.choice(np.arange(10_000, 100_000), size=len(rounds), replace=False)
    return [
        AskedCase(effect=effect, size=size, object=body, seed=int(seed))
        for (effect, size, body), seed in zip(rounds, seeds, strict=True)
    ]


def fewest_rows_first(missing: Sequence[AskedCase], rows: Sequence[Mapping[str, Any]]) -> list[AskedCase]:
    """Cases of kinds that have fewest rows first: objects are drawn anew for a revision, and begin all over."""
    known = Counter(_kind(row) for row in rows)
    order = []
    for case in missing:
        kind = _kind(asdict(case))
        order.append((known[kind], case))
        known[kind] += 1
    return [case for _, case in sorted(order, key=lambda each: each[0])]


def _kind(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return row["effect"], row["size"], row["object"]


def measure(case: AskedCase) -> dict[str, Any]:
    """One row."""
    options = RehearsalOptions(object=RehearsalObject(case.object), points=POINTS)
    handle = partial(rehearse, options, effects=case.effects, object_seed=case.seed)
    episodes = [handle(motion, seed=10 * case.seed + index) for index, motion in enumerate(PASSIVE)]
    # Up to two motions that are asked for have the seeds after the first of them.
    seeds = [len(PASSIVE), *range(len(PASSIVE) + 1 + MOST_ASKED, len(PASSIVE) + MOST_ASKED + len(JUDGED_ON))]
    judged_on = [handle(motion, seed=10 * case.seed + index) for motion, index in zip(JUDGED_ON, seeds, strict=True)]
    twin = build(episodes, FIT, seed=0)

    def world(proposal: Proposal, number: int) -> Episode:
        plans = [plan_of_path(each, "") for each in proposal.motion.paths]
        seed = 10 * case.seed + len(PASSIVE) + number
        return rehearse_plans(
            options, plans, name=f"asked_{number}", seed=seed, effects=case.effects, object_seed=case.seed
        )

    started = time.monotonic()
    answer = diagnose_and_ask(twin, episodes, DIAGNOSIS, world, most=MOST_ASKED, limits=PERSON, report_on=judged_on)
    seconds = time.monotonic() - started
    diagnosis = answer.finding.diagnosis
    first = answer.asked[0].before.diagnosis if answer.asked else diagnosis
    limits, passive_limits = ([asdict(each) for each in found.limits] for found in (diagnosis, first))
    true = errors_with_true_effect(twin, answer, judged_on, case)
    errors = {each.episode: each for each in diagnosis.error}
    first_judged, *others = (errors[each.name] for each in judged_on)
    return {
        **asdict(case),
        "asked": len(answer.asked),
        "motions": [each.proposal.motion.name for each in answer.asked],
        "ended": answer.ended,
        "outcome": str(diagnosis.outcome),
        "named": [each.name for each in diagnosis.effects],
        "estimates": {
            each.name: {name: [estimate.value, *estimate.ci95] for name, estimate in each.parameters.items()}
            for each in diagnosis.effects
        },
        "passive_outcome": str(first.outcome),
        "passive_named": [each.name for each in first.effects],
        "limit": limit_of(limits, case.effect),
        "passive_limit": limit_of(passive_limits, case.effect),
        "planted": injected_size(case),
        "track_before_m": first_judged.track_before_m,
        "track_after_m": first_judged.track_after_m,
        "track_true_m": true[0],
        "others": [
            {
                "motion": str(motion),
                "track_before_m": each.track_before_m,
                "track_after_m": each.track_after_m,
                "track_true_m": with_true,
            }
            for motion, each, with_true in zip(JUDGED_ON[1:], others, true[1:], strict=True)
        ],
        "p_null": least_p(diagnosis),
        "limits": limits,
        "candidates": diagnosis.as_dict()["candidates"][:5],
        "reason": diagnosis.reason,
        "seconds": seconds,
        "commit": commit(),
    }


def errors_with_true_effect(
    twin: Twin, answer: Conclusion, judged_on: Sequence[Episode], case: AskedCase
) -> Sequence[float | None]:
    """Metres, track errors of motions that had no part in it, of the twin refitted beside what was injected, if any.

    Nothing can be named that predicts better, but by chance. Refits start where the diagnosis ended, without what it
    named and with it, and free rollouts choose the baseline, as they do for what is named.

    Args:
        answer: of the loop.
        judged_on: those motions.
    """
    if not case.effects:
        return [None] * len(judged_on)
    finding, recorded = answer.finding, answer.recorded
    observed = observe_episodes([*recorded, *judged_on])
    observations = [observe(replace(twin.model, effects=()), each) for each in observed]
    fitted, _ = fitted_and_validation(observations[: len(recorded)])
    before = finding.searches[0].before

    own = {each.name: case.effects[case.effect][each.name] for each in effect_named(case.effect).parameters}

    def beside(model: ObjectModel) -> ObjectModel:
        return with_effect(replace(model, effects=()), case.effect, own)

    starts = [beside(before.model), beside(finding.twin.model)]
    best = refit_from(fitted, starts, before.parameters, scale=before.scale, iterations=DIAGNOSIS.refit_iterations)
    _, _, errors = predicting_pair(before.model, best.model, observations, given=len(recorded))
    return [float(np.nanmean(after.track)) for _, after in errors[len(recorded) :]]


def injected_size(case: AskedCase) -> float | None:
    """How far off no effect the injected one is: the length of all of its sizes together."""
    if case.effect == "none":
        return None
    values = case.effects[case.effect]
    parameters = effect_named(case.effect).parameters
    return math.hypot(*(values[each.name] - each.null for each in parameters if each.null is not None))


def least_p(diagnosis: Diagnosis) -> float:
    """Share of sets that lack nothing in which some effect gains as much as the candidate that gains most."""
    return max(diagnosis.candidates, key=lambda each: each.held_out_gain).p_null


def run(*, minutes: float = 1e9) -> dict[str, Any]:
    """Measure what is missing; the keys of `results/asked.json`.

    Args:
        minutes: begin no further set after this long.
    """
    kept = kept_in(RESULT, {"rows": [], "calibrated_on": []})
    rows = kept["rows"]
    done = {_key(row) for row in rows}
    missing = [case for case in cases() if json.dumps(asdict(case), sort_keys=True) not in done]
    for _, row in side_by_side(measure, fewest_rows_first(missing, rows), minutes=minutes):
        rows.append(row)
        write_json(RESULT, kept)
    return {
        "rows": rows,
        "p_null": [row["p_null"] for row in rows if row["effect"] == "none"],
        "calibrated_on": kept["calibrated_on"],
        "revision": commit(),
    }


def _key(row: Mapping[str, Any]) -> str:
    return json.dumps({name: row[name] for name in AskedCase.__dataclass_fields__}, sort_keys=True)
