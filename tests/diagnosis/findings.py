"""Findings made by hand, for tests of what is done with them."""

from typing import Any

import numpy as np

from egophys_core.diagnosis.criterion import Direction, compare, not_asked
from egophys_core.diagnosis.diagnosis import (
    Candidate,
    Decision,
    DetectionLimit,
    Diagnosis,
    Estimate,
    Evidence,
    NamedEffect,
    NearestMiss,
    Outcome,
    PredictionErrors,
    Where,
)

MISSED = compare("worth_a_refit", "held-out gain by slopes:", 4.1, Direction.AT_LEAST, 8.33, because=" for a refit")
"""A criterion that was failed."""


def make_decision(**changes: Any) -> Decision:
    """Drag passes."""
    fields: dict[str, Any] = {
        "rule": "named",
        "sentence": "One candidate passes all criteria.",
        "candidate": "quadratic_drag",
        "criterion": compare("held_out_gain", "gain on left-out data", 406.0, Direction.AT_LEAST, 50.0),
        "beside": (),
        "nearest_misses": (),
    }
    return Decision(**{**fields, **changes})


def make_nothing_found() -> Diagnosis:
    """No effect, and what came nearest."""
    misses = (
        NearestMiss(candidate="quadratic_drag", failed=(MISSED,)),
        NearestMiss(candidate="bending_damping", failed=(MISSED, MISSED)),
    )
    decision = make_decision(
        rule="no_candidate_passes",
        sentence="No candidate passes all criteria.",
        candidate="quadratic_drag",
        criterion=MISSED,
        nearest_misses=misses,
    )
    return make_diagnosis(outcome=Outcome.NONE, effects=(), decisions=(decision,))


def make_diagnosis(**changes: Any) -> Diagnosis:
    """Drag, found in two episodes and reported on a third."""
    fields: dict[str, Any] = {
        "outcome": Outcome.NAMED,
        "effects": (
            NamedEffect(
                name="quadratic_drag",
                parameters={"coefficient": Estimate(value=3.8, unit="1/m", ci95=(2.75, 4.6))},
                episodes_agree=True,
            ),
        ),
        "ambiguous": (),
        "candidates": (
            Candidate(
                name="quadratic_drag",
                held_out_gain=406.0,
                p_null=0.005,
                fitted_gain=450.0,
                validation_gain=55.0,
                values={"coefficient": 3.8},
                criteria=(
                    compare("held_out_gain", "gain on left-out data", 406.0, Direction.AT_LEAST, 50.0),
                    not_asked("every_episode", "least gain of an episode: asked beside a named effect only"),
                ),
                is_measured=False,
            ),
            Candidate(
                name="bending_damping",
                held_out_gain=-900.0,
                p_null=0.4,
                fitted_gain=4.0,
                validation_gain=None,
                values={"factor": 1.2},
                criteria=(MISSED,),
                is_measured=False,
            ),
        ),
        "decisions": (make_decision(),),
        "limits": (
            DetectionLimit(
                effect="quadratic_drag",
                parameter="coefficient",
                unit="1/m",
                null=0.0,
                size=2.25,
                alike=("gravity_scale",),
            ),
            DetectionLimit(effect="control_delay", parameter="delay", unit="s", null=0.0, size=None, alike=()),
        ),
        "experiment": None,
        "scale_m": 0.0012,
        "where": Where(
            size_m=0.0062,
            by_region={"near the hand": 0.002, "on the table": float("nan")},
            by_motion={"low speed": 0.0021, "high speed": 0.0102},
            worst_time_s={"swing": 3.125},
            law="a = -3.5 |v| v (1/m)",
        ),
        "error": (episode_error("lift", fitted=True), episode_error("pull", fitted=True), episode_error("swing")),
        "seconds": 341.25,
        "reason": "quadratic_drag gains 406 on held-out data",
        "twin_id": "93f0a1b2c3d4e5f6",
        "improved_twin_id": "0123456789abcdef",
    }
    return Diagnosis(**{**fields, **changes})


def episode_error(
    episode: str, *, fitted: bool = False, before: float = 0.012, after: float = 0.005
) -> PredictionErrors:
    """An error that the effect makes smaller; 1 mm less in what was fitted."""
    less = 0.001 if fitted else 0.0
    return PredictionErrors(
        episode=episode,
        track_before_m=before - less,
        track_after_m=after - less,
        chamfer_before_m=0.004,
        chamfer_after_m=0.0025,
        last_residual_track_m=0.0066,
        follow_track_m=0.031,
        fitted=fitted,
    )


def make_evidence(names: tuple[str, ...] = ("lift", "pull", "swing"), points: int = 40) -> Evidence:
    """Errors that rise after a quiet second, and a sheet that droops."""
    times = np.linspace(0.0, 4.0, 60)
    rising = np.where(times < 1.0, np.nan, 0.004 * times)
    generator = np.random.default_rng(3)
    rest = generator.uniform([-0.1, -0.2, 0.004], [0.1, 0.2, 0.006], size=(points, 3))
    field = np.zeros((points, 3))
    field[:, 2] = -0.02 * rest[:, 1]
    return Evidence(
        times=dict.fromkeys(names, times),
        before=dict.fromkeys(names, rising),
        after=dict.fromkeys(names, 0.4 * rising),
        rest=rest,
        field=field,
        mismatch_gain=73.0,
    )
