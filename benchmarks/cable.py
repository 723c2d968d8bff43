"""Rehearsed cables: built and diagnosed on two motions of the hands, reported on a third.

A cable's row is kept as soon as it is measured, and a run goes on where the last one stopped.
"""

import time
from pathlib import Path
from typing import Any

from benchmarks.beam import rmse
from benchmarks.cable_world import COILED, MOTIONS, record
from benchmarks.kept import fill, kept_in
from benchmarks.provenance import commit
from egophys_core.diagnosis.diagnose import diagnose_observed
from egophys_core.diagnosis.evidence.marker_observations import observe_markers, unidentifiable_effects
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.identification.marker_fit import build_marker_twin

RESULT = Path(__file__).parent / "results/cable.json"

SECONDS = 5.0
PLANTED: dict[str, dict[str, float]] = {
    "none": {},
    "coiled": {},
    "quadratic_drag": {"c_per_kg": 3.0},
    "control_delay": {"delay": 0.05},
    "constant_body_force": {"ax": 0.0, "ay": 0.5, "az": 0.0},
    "time_varying_body_force": {"ax": 0.0, "ay": 1.0, "az": 0.0, "frequency": 0.5, "onset": 2.0},
    "gravity_scale": {"factor": 0.8},
    "uneven_mass": {"fraction": 0.4, "x": 0.3, "y": 0.0, "z": 1.0, "radius": 0.02},
    "hidden_tether": {
        "px": 0.35,
        "py": 0.0,
        "pz": 0.7,
        "ax": 0.35,
        "ay": 0.4,
        "az": 0.5,
        "stiffness": 0.5,
        "length": 0.3,
    },
    "tracking_scale": {"scale": 0.96},
    "tracking_rotation": {"rx": 0.03, "ry": 0.02, "rz": 0.04},
}
"""By the name of the effect, with its numbers in the rehearsal world; no effect: "none", and in a cable that is bent by
nature "coiled"."""


def measure(planted: str) -> dict[str, Any]:
    """One cable: a twin of two motions, its diagnosis on all three."""
    effects = {planted: PLANTED[planted]} if PLANTED[planted] else {}
    natural_bend = COILED if planted == "coiled" else 0.0
    episodes = [
        record(motion, seconds=SECONDS, effects=effects, seed=index, natural_bend=natural_bend)
        for index, motion in enumerate(MOTIONS)
    ]
    began = time.perf_counter()
    twin = build_marker_twin(episodes[:2], None)
    built = time.perf_counter()
    observed = [observe_markers(twin, episode) for episode in episodes]
    finding = diagnose_observed(
        twin, observed, DiagnosisOptions(), without=unidentifiable_effects(twin.model.kind, observed)
    )
    diagnosis = finding.diagnosis.as_dict()
    models = {"built": twin.model, "before": finding.before, "after": finding.twin.model}
    return {
        "planted": PLANTED[planted],
        "assumed": twin.provenance.settings["assumed"],
        "outcome": diagnosis["outcome"],
        "reason": diagnosis["reason"],
        "effects": diagnosis["effects"],
        "candidates": diagnosis["candidates"][:5],
        "rmse_m": {
            each.episode.name: {label: rmse(each, model) for label, model in models.items()} for each in observed
        },
        "build_seconds": built - began,
        "diagnose_seconds": diagnosis["seconds"],
        "commit": commit(),
    }


def run() -> dict[str, Any]:
    """The keys of `results/cable.json`."""
    kept = kept_in(RESULT, {"cables": {}})
    kept["held_out"] = MOTIONS[-1].name
    fill(RESULT, kept, kept["cables"], measure, {name: name for name in PLANTED})
    return {"cables": {name: kept["cables"][name] for name in PLANTED}, "held_out": kept["held_out"]}
