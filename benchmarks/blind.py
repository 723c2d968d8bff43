"""Diagnoses of the recorded cases whose effects are not declared, and of those whose effects are."""

import json
import time
from pathlib import Path
from typing import Any

from egophys_core.discrepancy.diagnose import diagnose
from egophys_core.discrepancy.options import DiagnosisOptions
from egophys_core.files import write_atomically
from egophys_core.identification import FitOptions, build_twin
from egophys_core.recording import read_episode

DATA = Path(__file__).resolve().parents[2] / "shared/data"
RESULT = Path(__file__).parent / "blind/diagnoses.json"
FITTED, REPORTED = (0, 1), (2, 3)
"""Episodes that are fitted and selected on, and those the error is reported on."""

FIT = FitOptions(generations=25, dense_steps=0)


def measure(folder: Path) -> dict[str, Any]:
    """The diagnosis of one case, as in `diagnosis.json`."""
    fitted, reported = (
        [read_episode(folder / f"episode_{index}.mcap") for index in indices] for indices in (FITTED, REPORTED)
    )
    started = time.monotonic()
    twin = build_twin(fitted, FIT, seed=0)
    building = time.monotonic() - started
    found = diagnose(twin, fitted, DiagnosisOptions(), report_on=reported).diagnosis
    return {**found.as_dict(), "build_seconds": building}


def run() -> dict[str, Any]:
    """Diagnose every case; results are kept after each, and a run goes on where the last one stopped."""
    results = json.loads(RESULT.read_text()) if RESULT.exists() else {}
    RESULT.parent.mkdir(exist_ok=True)
    for folder in [*sorted((DATA / "open").iterdir()), *sorted((DATA / "blind").iterdir())]:
        if folder.name not in results:
            results[folder.name] = measure(folder)
            write_atomically(RESULT, (json.dumps(results, indent=1) + "\n").encode())
    return {"cases": results}
