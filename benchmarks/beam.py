"""A measured silicone beam: what an elastic twin of it lacks, trained on two loads and reported on a third."""

import time
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.accuracy import DATA
from egophys_core.diagnosis.diagnose import diagnose
from egophys_core.diagnosis.evidence.marker_observations import observe_markers
from egophys_core.diagnosis.evidence.residuals import track_offsets
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.identification import FitOptions, build
from egophys_core.recording import read_episode
from egophys_core.twin import ObjectModel

TEMPLATE = "box:0.1x0.03x0.03"
DENSITY = 1070.0
LOADS = {"gravity.mcap": 0.0, "load52.mcap": 0.510, "load101.mcap": 1.001}
"""N at the tip."""

HELD_OUT = "load101.mcap"


def run() -> dict[str, Any]:
    """Build on two episodes, diagnose on them, report on all; the keys of `results/beam.json`."""
    began = time.perf_counter()
    episodes = {name: read_episode(DATA / "measured/beam" / name) for name in LOADS}
    fitted = [episode for name, episode in episodes.items() if name != HELD_OUT]
    twin = build(
        fitted, FitOptions(template=TEMPLATE, density=DENSITY), loads={each.name: LOADS[each.name] for each in fitted}
    )
    built = time.perf_counter()
    observed = {name: observe_markers(twin, episode, load=LOADS[name]) for name, episode in episodes.items()}
    finding = diagnose(twin, fitted, DiagnosisOptions(), loads=LOADS, report_on=[episodes[HELD_OUT]])
    diagnosis = finding.diagnosis.as_dict()
    models = {
        "elastic": replace(twin.model, parameters=replace(twin.model.parameters, damping=0.0, drag=0.0)),
        "built": twin.model,
        "before": finding.before,
        "after": finding.twin.model,
    }
    return {
        "template": TEMPLATE,
        "density_kg_m3": DENSITY,
        "loads_n": LOADS,
        "fitted": [name for name in LOADS if name != HELD_OUT],
        "held_out": HELD_OUT,
        "assumed": twin.provenance.settings["assumed"],
        "twin": _numbers(twin.model),
        "outcome": diagnosis["outcome"],
        "reason": diagnosis["reason"],
        "effects": diagnosis["effects"],
        "candidates": diagnosis["candidates"],
        "error": diagnosis["error"],
        "rmse_m": {
            name: {label: rmse(each, model) for label, model in models.items()} for name, each in observed.items()
        },
        "swing_rmse_m": {
            name: {label: swing_rmse(each, model) for label, model in models.items()} for name, each in observed.items()
        },
        "improved": _numbers(finding.twin.model),
        "build_seconds": built - began,
        "diagnose_seconds": diagnosis["seconds"],
    }


def rmse(observation: TrackedEpisode, model: ObjectModel) -> float:
    """Metres: root mean square distance of the markers over a free rollout of the whole record."""
    return _root_mean_square(track_offsets(observation, [model])[0][0])


def swing_rmse(observation: TrackedEpisode, model: ObjectModel) -> float:
    """As `rmse`, without each marker's mean offset, which is of how the record was mounted as well."""
    offsets = track_offsets(observation, [model])[0][0]
    return _root_mean_square(offsets - np.nanmean(offsets, axis=0))


def _root_mean_square(offsets: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean((offsets**2).sum(axis=-1))))


def _numbers(model: ObjectModel) -> dict[str, float]:
    """What was fitted."""
    parameters = model.parameters
    return {
        "nodes": len(model.graph.positions),
        "springs": len(model.graph.springs),
        "stiffness_n_m": float(np.median(model.stiffness)),
        "damping_n_s_m": parameters.damping,
        "drag_1_s": parameters.drag,
        "controller_stiffness_n_m": parameters.controller_stiffness,
        "mass_kg": parameters.total_mass,
    }
