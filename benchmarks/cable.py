"""Rehearsed cables: built and diagnosed on two motions of the hands, reported on a third.

A cable's row is kept as soon as it is measured, and a run goes on where the last one stopped.
"""

import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.beam import rmse
from benchmarks.cable_world import COILED, MOTIONS, record
from benchmarks.kept import fill, kept_in
from benchmarks.provenance import commit
from egophys_core.diagnosis.diagnose import diagnose
from egophys_core.diagnosis.evidence.marker_observations import observe_markers
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.identification import build

RESULT = Path(__file__).parent / "results/cable.json"

SECONDS = 5.0
INJECTED: dict[str, dict[str, float]] = {
    "none": {},
    "coiled": {},
    "quadratic_drag": {"coefficient": 3.0},
    "control_delay": {"delay": 0.05},
    "constant_body_force": {"x": 0.0, "y": 0.5, "z": 0.0},
    "time_varying_body_force": {
        "x": 0.0,
        "y": 1.0,
        "z": 0.0,
        "onset": 2.0,
        "duration": SECONDS,
        "frequency": 0.5,
        "phase": 0.5 * np.pi,
    },
    "gravity_scale": {"scale": 0.8},
    "uneven_mass": {"x": -0.2, "y": 0.0, "z": 0.0, "radius": 0.009, "fraction": 0.4},
    "hidden_tether": {
        "x": 0.35,
        "y": 0.0,
        "z": 0.7,
        "anchor_x": 0.0,
        "anchor_y": 0.4,
        "stiffness": 10.0,
        "length": 0.25,
    },
    "tracking_scale": {"scale": 0.96},
    "tracking_rotation": {"about_x": 0.0296, "about_y": 0.0206},
}
"""By the name of the effect, with its parameters; no effect: "none", and in a cable that is bent by
nature "coiled"."""


def measure(injected: str) -> dict[str, Any]:
    """One cable: a twin of two motions, its diagnosis on all three."""
    effects = {injected: INJECTED[injected]} if INJECTED[injected] else {}
    intrinsic_curvature = COILED if injected == "coiled" else 0.0
    episodes = [
        record(motion, seconds=SECONDS, effects=effects, seed=index, intrinsic_curvature=intrinsic_curvature)
        for index, motion in enumerate(MOTIONS)
    ]
    began = time.perf_counter()
    twin = build(episodes[:2])
    built = time.perf_counter()
    observed = [observe_markers(twin, episode) for episode in episodes]
    finding = diagnose(twin, episodes, DiagnosisOptions())
    diagnosis = finding.diagnosis.as_dict()
    models = {"built": twin.model, "before": finding.before, "after": finding.twin.model}
    return {
        "injected": INJECTED[injected],
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
    fill(RESULT, kept, kept["cables"], measure, {name: name for name in INJECTED})
    return {"cables": {name: kept["cables"][name] for name in INJECTED}, "held_out": kept["held_out"]}
