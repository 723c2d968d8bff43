"""Diagnoses of the recorded cases: those that declare what they hold, and the blind ones, which do not."""

import json
import time
from pathlib import Path
from typing import Any

from benchmarks.side_by_side import side_by_side
from egophys_core.discrepancy.diagnose import diagnose
from egophys_core.discrepancy.options import DiagnosisOptions
from egophys_core.files import write_json
from egophys_core.identification import FitOptions, build_twin
from egophys_core.recording import read_episode

DATA = Path(__file__).resolve().parents[2] / "shared/data"
BLIND = Path(__file__).parent / "blind/diagnoses.json"
"""The blind cases alone, by name: what is judged against a key that is kept apart."""

RESULT = Path(__file__).parent / "results/diagnoses.json"

FITTED = {"open": 3, "blind": 2}
"""So many of a case's four episodes its twin is built of, by folder. Of an open case the fourth has to bear out what is
named, as always; a blind case may be known by its first two alone, so the others have no part in the diagnosis."""

FIT = FitOptions(generations=25, dense_steps=0)


def measure(folder: Path) -> dict[str, Any]:
    """The diagnosis of one case, as in `diagnosis.json`."""
    kind = folder.parent.name
    episodes = [read_episode(folder / f"episode_{index}.mcap") for index in range(4)]
    started = time.monotonic()
    twin = build_twin(episodes[: FITTED[kind]], FIT, seed=0)
    building = time.monotonic() - started
    given, reported = (episodes[:2], episodes[2:]) if kind == "blind" else (episodes, [])
    found = diagnose(twin, given, DiagnosisOptions(), report_on=reported).diagnosis
    return {**found.as_dict(), "build_seconds": building}


def run() -> dict[str, Any]:
    """Diagnose every case; results are kept after each, and a run goes on where the last one stopped."""
    kept = json.loads(RESULT.read_text()) if RESULT.exists() else {"cases": {}}
    cases = kept["cases"]
    folders = [*sorted((DATA / "open").iterdir()), *sorted((DATA / "blind").iterdir())]
    missing = [folder for folder in folders if folder.name not in cases]
    for folder, case in side_by_side(measure, missing):
        cases[folder.name] = case
        write_json(RESULT, kept)
    return {"cases": cases}


def write_blind(cases: dict[str, Any]) -> None:
    """The blind cases of a result, on their own."""
    names = {folder.name for folder in (DATA / "blind").iterdir()}
    BLIND.parent.mkdir(exist_ok=True)
    write_json(BLIND, {name: case for name, case in sorted(cases.items()) if name in names})
