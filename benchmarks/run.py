"""Run the benchmarks, write `results/NAME.json` and renew docs/results.md from these files.

`python -m benchmarks.run` runs all, `python -m benchmarks.run beam cost` those named, `python -m benchmarks.run report`
none: it only renews the page.
"""

import json
import sys
from collections.abc import Callable
from typing import Any

from benchmarks import (
    asked,
    beam,
    blind,
    cable,
    cost,
    effects,
    film,
    injected,
    measured,
    perception,
    physics,
    towel,
    trust,
)
from benchmarks.prior import tables as prior_tables
from benchmarks.provenance import commit, machine
from benchmarks.report import RESULTS, renew
from egophys_core.files import write_json

BENCHMARKS: dict[str, Callable[[], dict[str, Any]]] = {
    "physics": physics.run,
    "effects": effects.run,
    "towel": towel.run,
    "perception": perception.run,
    "film": film.run,
    "injected": injected.run,
    "asked": asked.run,
    "diagnoses": blind.run,
    "beam": beam.run,
    "cable": cable.run,
    "measured": measured.run,
    "prior": prior_tables.run,
    "cost": cost.run,
    "trust": trust.run,
}


def main() -> None:
    """Run those named on the command line, or all."""
    names = sys.argv[1:] or list(BENCHMARKS)
    if unknown := [name for name in names if name not in BENCHMARKS and name != "report"]:
        sys.exit(f"no benchmark is called {', '.join(unknown)}; there are {', '.join(BENCHMARKS)}, and report")
    for name in (name for name in names if name != "report"):
        command = f"python -m benchmarks.run {name}"
        result = {**BENCHMARKS[name](), "machine": machine(), "commit": commit(), "command": command}
        write_json(RESULTS / f"{name}.json", result)
        print(json.dumps(result, indent=1))
        if name == "diagnoses":
            blind.write_blind(result["cases"])
    renew()


if __name__ == "__main__":
    main()
