"""Whether the robot graph is to be trusted: hostile plans, what goes wrong, an hour of streaming.

`python -m benchmarks.run trust` measures what `results/trust.json` lacks, `python -m benchmarks.trust plans` that part.
"""

import sys
from collections.abc import Callable
from typing import Any

from benchmarks import faults, streaming, unsafe
from benchmarks.fault_rig import loopback_addresses
from benchmarks.kept import kept_in
from benchmarks.provenance import commit
from benchmarks.report import RESULTS
from egophys_core.files import write_json

PLANS, HOURS = 10_000, 1.0
FILE = RESULTS / "trust.json"


def _plans() -> dict[str, Any]:
    found = unsafe.measure(PLANS, loopback_addresses()())
    return {
        "plans_tried": sum(found["outcomes"].values()),
        "plan_outcomes": found["outcomes"],
        "unsafe_commands": len(found["unsafe"]),
        "unsafe_examples": found["unsafe"][:5],
    }


def _faults() -> dict[str, Any]:
    return {"faults": faults.measure()}


PARTS: dict[str, Callable[[], dict[str, Any]]] = {
    "plans": _plans,
    "faults": _faults,
    "stream": lambda: streaming.measure(HOURS),
}


def run() -> dict[str, Any]:
    """The keys of `results/trust.json`; parts that an earlier run has measured are kept."""
    missing = set(PARTS) - set(kept_in(FILE, {}).get("measured", {}))
    for part in PARTS:
        if part in missing:
            measure(part)
    return kept_in(FILE, {})


def measure(part: str) -> None:
    """Measure one part and write it down, with the commit it was measured at."""
    found = PARTS[part]()
    kept = kept_in(FILE, {})  # read late: parts may be measured side by side
    write_json(FILE, {**kept, **found, "measured": {**kept.get("measured", {}), part: {"commit": commit()}}})


if __name__ == "__main__":
    for name in sys.argv[1:]:
        measure(name)
