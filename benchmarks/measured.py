"""Recordings by cameras and motion capture: built and diagnosed on some, reported on others that nothing was fitted to.

Of each recording, mean track error over all frames, millimetres: `static_mm` of its first shape, `rigid_lag_mm` of
points that follow the nearest hand at its best lag, `built_mm` of the twin as built, `before_mm` and `after_mm` of the
twin that a diagnosis refitted without and with what it named. `fitted` says whether the diagnosis fitted it. Of each
set, the sizes from which effects would have been named in its recordings, and the motion of an arm that would show most
of what they leave open.

A set's rows are kept as soon as they are measured, and a run goes on where the last one stopped.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy import DATA
from benchmarks.beam import DENSITY, LOADS, TEMPLATE
from benchmarks.kept import fill, kept_in
from benchmarks.provenance import commit
from egophys_core.diagnosis.diagnose import Finding, diagnose, fitted_and_validation
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.evaluation import lagging_prediction, track_error_per_frame
from egophys_core.experiments import arm_hands, next_motion
from egophys_core.identification import FitOptions, build, evaluate_twin
from egophys_core.observation import ObservedEpisode, observe_episode
from egophys_core.recording import read_episode
from egophys_core.robot import MotionLimits

RESULT = Path(__file__).parent / "results/measured.json"


@dataclass(frozen=True, kw_only=True)
class MeasuredSet:
    """Recordings of one object."""

    folder: str
    given: tuple[str, ...]
    """What a twin is built from and diagnosed on; the others are only reported on."""
    options: FitOptions = field(default_factory=FitOptions)
    loads: Mapping[str, float] = field(default_factory=dict)
    """N at the free end, by file."""


SETS = {
    "cloth": MeasuredSet(folder="cloth", given=("range30_rep1.mcap", "range90_rep1.mcap", "range120_rep4.mcap")),
    "cloth, others": MeasuredSet(folder="cloth", given=("range60_rep2.mcap", "range60_rep5.mcap", "range90_rep3.mcap")),
    "cable": MeasuredSet(folder="cable", given=tuple(f"DLO1_train_{clip}.mcap" for clip in (101, 103, 104, 106))),
    "beam": MeasuredSet(
        folder="beam",
        given=("gravity.mcap", "load52.mcap"),
        options=FitOptions(template=TEMPLATE, density=DENSITY),
        loads=LOADS,
    ),
}


def measure(name: str) -> dict[str, Any]:
    """Rows of a set, and its diagnosis."""
    chosen = SETS[name]
    observed = {
        path.name: observe_episode(read_episode(path), load=chosen.loads.get(path.name, 0.0))
        for path in sorted((DATA / "measured" / chosen.folder).iterdir())
    }
    given = [observed[each] for each in chosen.given]
    others = [each for each in observed.values() if each.name not in chosen.given]
    twin = build(given, chosen.options)
    finding = diagnose(twin, given, DiagnosisOptions(), report_on=others)
    diagnosis = finding.diagnosis
    fitted = [each.name for each in fitted_and_validation(given)[0]]
    errors = {each.episode: each for each in diagnosis.error}
    rows = [
        {
            "set": name,
            "record": each.name,
            "fitted": each.name in fitted,
            **_baselines(each),
            "built_mm": 1e3 * evaluate_twin(twin, each)[0].all_track_m,
            "before_mm": 1e3 * errors[each.name].track_before_m,
            "after_mm": 1e3 * errors[each.name].track_after_m,
        }
        for each in (*given, *others)
    ]
    found = {
        "set": name,
        "records": [each.name for each in given],
        "outcome": str(diagnosis.outcome),
        "effects": {each.name: _values(each.parameters) for each in diagnosis.effects},
        "reason": diagnosis.reason,
        "limits": [asdict(each) for each in diagnosis.limits],
        "experiment": experiment(finding),
        "seconds": diagnosis.seconds,
        "commit": commit(),
    }
    return {"rows": rows, "diagnosis": found}


def experiment(finding: Finding) -> dict[str, Any]:
    """What an arm should do next with the object, and what is expected of that; or why it can do nothing."""
    proposal, why = next_motion(finding, arm_hands(MotionLimits()))
    if proposal is None:
        return {"refused": why}
    motion = proposal.motion
    return {"motion": motion.name, "sentence": motion.sentence, "after": [asdict(each) for each in proposal.after]}


def _values(parameters: Mapping[str, Any]) -> dict[str, list[float]]:
    """Value and 95 % interval of each parameter."""
    return {name: [each.value, *each.ci95] for name, each in parameters.items()}


def _baselines(observed: ObservedEpisode) -> dict[str, float]:
    """Errors of what stays and of what follows, over all frames."""
    episode = observed.episode
    bound = np.arange(episode.points.shape[1])
    stays = np.repeat(episode.points[:1], episode.frames, axis=0)
    follows = lagging_prediction(episode, observed.contact)
    return {
        name: float(1e3 * np.nanmean(track_error_per_frame(predicted[1:], episode.points[1:], bound)))
        for name, predicted in (("static_mm", stays), ("rigid_lag_mm", follows))
    }


def run() -> dict[str, Any]:
    """The keys of `results/measured.json`."""
    kept = kept_in(RESULT, {"sets": {}})
    fill(RESULT, kept, kept["sets"], measure, {name: name for name in SETS})
    sets = [kept["sets"][name] for name in SETS]
    return {
        "rows": [row for each in sets for row in each["rows"]],
        "diagnoses": [each["diagnosis"] for each in sets],
        "sets": kept["sets"],
    }
