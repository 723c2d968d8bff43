"""Diagnoses of the recorded cases: those that declare what they hold, and the blind ones, which do not."""

import time
from pathlib import Path
from typing import Any

from benchmarks.kept import fill, kept_in
from benchmarks.provenance import commit
from egophys_core.diagnosis.diagnose import diagnose, fitted_and_validation
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.files import write_json
from egophys_core.identification import FitOptions, build
from egophys_core.recording import read_episode

DATA = Path(__file__).resolve().parents[2] / "shared/data"
BLIND = Path(__file__).parent / "blind/diagnoses.json"
"""The blind cases alone, by name: what is judged against a key that is kept apart."""

RESULT = Path(__file__).parent / "results/diagnoses.json"

TOLD = {"open": 4, "blind": 2}
"""So many of a case's four episodes its diagnosis is told of, by folder. A blind case may be known by its first two,
so the others have no part in it: errors are reported on them."""

FIT = FitOptions(generations=25, dense_steps=0)


def measure(folder: Path) -> dict[str, Any]:
    """The diagnosis of one case, as in `diagnosis.json`, and the commit it was made with."""
    episodes = [read_episode(folder / f"episode_{index}.mcap") for index in range(4)]
    told = TOLD[folder.parent.name]
    fitted, _ = fitted_and_validation(episodes[:told])
    started = time.monotonic()
    twin = build(fitted, FIT, seed=0)
    building = time.monotonic() - started
    found = diagnose(twin, episodes[:told], DiagnosisOptions(), report_on=episodes[told:]).diagnosis
    return {**found.as_dict(), "build_seconds": building, "commit": commit()}


def run() -> dict[str, Any]:
    """Diagnose every case; results are kept after each, and a run goes on where the last one stopped."""
    kept = kept_in(RESULT, {"cases": {}})
    folders = [*sorted((DATA / "open").iterdir()), *sorted((DATA / "blind").iterdir())]
    fill(RESULT, kept, kept["cases"], measure, {folder.name: folder for folder in folders})
    return {"cases": kept["cases"]}


def write_blind(cases: dict[str, Any]) -> None:
    """The blind cases of a result, on their own."""
    names = {folder.name for folder in (DATA / "blind").iterdir()}
    BLIND.parent.mkdir(exist_ok=True)
    write_json(BLIND, {name: case for name, case in sorted(cases.items()) if name in names})
