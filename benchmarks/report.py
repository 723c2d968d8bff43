"""docs/results.md, made of the text in `results_page.md` and of tables from `benchmarks/results`."""

import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from benchmarks import tables, trust_tables
from benchmarks.asked_table import asked_table
from benchmarks.confusion import confusion_table
from benchmarks.prior.page import prior_table
from benchmarks.revisions import described, known_dates, revisions_in
from egophys_core.files import write_atomically

REPOSITORY = Path(__file__).resolve().parents[1]
RESULTS = REPOSITORY / "benchmarks/results"
TEXT = REPOSITORY / "benchmarks/results_page.md"
"""What each table means, what it was calibrated on, and what was looked at while designing."""
PAGE = REPOSITORY / "docs/results.md"

TABLES: dict[str, tuple[str, Callable[[dict[str, Any], Mapping[str, str]], str]]] = {
    "perception": ("perception", tables.perception_table),
    "film": ("film", tables.film_table),
    "towel": ("towel", tables.towel_table),
    "accuracy": ("physics", tables.accuracy_table),
    "diagnoses": ("diagnoses", tables.diagnoses_table),
    "injected": ("injected", confusion_table),
    "asked": ("asked", asked_table),
    "beam": ("beam", tables.beam_table),
    "cable": ("cable", tables.cable_table),
    "measured": ("measured", tables.measured_table),
    "prior": ("prior", prior_table),
    "cost": ("cost", tables.cost_table),
    "simulation": ("physics", tables.simulation_table),
    "effects": ("effects", tables.effects_table),
    "faults": ("trust", trust_tables.faults_table),
    "plans": ("trust", trust_tables.plans_table),
    "stream": ("trust", trust_tables.stream_table),
}
"""By the name in the text: the result file that a table is of, and what makes it of that file's content and of commits'
dates."""


def renew() -> None:
    """Write docs/results.md, and the dates of revisions that are new."""
    results = read_results()
    dates = known_dates(set().union(*(revisions_in(result) for result in results.values())))
    write_atomically(PAGE, page(results, dates).encode())


def read_results() -> dict[str, dict[str, Any]]:
    """What the benchmarks have measured, by the name of the file without its ending."""
    names = {result for result, _ in TABLES.values()}
    return {path.stem: json.loads(path.read_text()) for path in RESULTS.glob("*.json") if path.stem in names}


def page(results: Mapping[str, dict[str, Any]], dates: Mapping[str, str]) -> str:
    """The text of docs/results.md.

    Args:
        results: as of `read_results`.
        dates: of the commits named in them, by hash.
    """

    def filled(match: re.Match[str]) -> str:
        what, name = match.groups()
        file = name if what == "source" else TABLES[name][0]
        if file not in results:
            return f"Not measured yet: `python -m benchmarks.run {file}`."
        return _source(file, results[file], dates) if what == "source" else TABLES[name][1](results[file], dates)

    return re.sub(r"<!-- (source|table) (\w+) -->", filled, TEXT.read_text())


def _source(name: str, result: Mapping[str, Any], dates: Mapping[str, str]) -> str:
    """Where figures come from."""
    return (
        f"`benchmarks/results/{name}.json`, last run at {described(result['commit'], dates)} on {result['machine']} by "
        f"`python -m benchmarks.run {name}`."
    )
