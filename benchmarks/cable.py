"""Rehearsed cables: built and diagnosed on two motions of the hands, reported on a third.

A cable's row is kept as soon as it is measured, in place of what an older commit gave.
"""

import json
import time
from pathlib import Path
from typing import Any

from benchmarks.beam import rmse
from benchmarks.cable_world import MOTIONS, record
from benchmarks.provenance import commit
from benchmarks.side_by_side import side_by_side
from egophys_core.discrepancy.diagnose import diagnose_observed
from egophys_core.discrepancy.markers import effects_untold, observe_markers
from egophys_core.discrepancy.options import DiagnosisOptions
from egophys_core.files import write_json
from egophys_core.identification.marker_fit import build_marker_twin

RESULT = Path(__file__).parent / "results/cable.json"

SECONDS = 5.0
PLANTED: dict[str, dict[str, float]] = {
    "none": {},
    "quadratic_drag": {"drag": 3.0},
    "control_delay": {"delay": 0.05},
}
"""1/m; s."""


def measure(planted: str) -> dict[str, Any]:
    """One cable: a twin of two motions, its diagnosis on all three."""
    episodes = [record(motion, seconds=SECONDS, seed=index, **PLANTED[planted]) for index, motion in enumerate(MOTIONS)]
    began = time.perf_counter()
    twin = build_marker_twin(episodes[:2], None)
    built = time.perf_counter()
    observed = [observe_markers(twin, episode) for episode in episodes]
    finding = diagnose_observed(twin, observed, DiagnosisOptions(), without=effects_untold(twin.model.kind, observed))
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
    kept = json.loads(RESULT.read_text()) if RESULT.exists() else {"cables": {}}
    kept["held_out"] = MOTIONS[-1].name
    cables = kept["cables"]
    for name, row in side_by_side(measure, PLANTED):
        cables[name] = row
        write_json(RESULT, kept)
    return {"cables": {name: cables[name] for name in PLANTED}, "held_out": kept["held_out"]}
