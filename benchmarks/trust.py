"""Whether the robot graph is to be trusted: hostile plans, what goes wrong, an hour of streaming.

`python -m benchmarks.run trust` measures what `results/trust.json` lacks, `python -m benchmarks.trust plans` that part.
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from benchmarks import faults, streaming, unsafe
from benchmarks.fault_rig import loopback_addresses
from benchmarks.kept import kept_in
from benchmarks.provenance import commit
from benchmarks.report import RESULTS
from egophys_core.files import write_json

PLANS, HOURS = 10_000, 1.0
PLANS_AT_ONCE = 500
"""Against one emulator; its wire is looked at after them."""
FILE = RESULTS / "trust.json"


def _plans() -> Iterator[dict[str, Any]]:
    address, outcomes, examples = loopback_addresses(), Counter[str](), list[dict[str, Any]]()
    while outcomes.total() < PLANS:
        found = unsafe.measure(PLANS_AT_ONCE, address())
        outcomes.update(found["outcomes"])
        examples += found["unsafe"]
        yield {
            "plans_tried": outcomes.total(),
            "plan_outcomes": dict(outcomes),
            "unsafe_commands": len(examples),
            "unsafe_examples": examples[:5],
        }


PARTS: dict[str, Callable[[], Iterable[dict[str, Any]]]] = {
    "plans": _plans,
    "faults": lambda: [{"faults": faults.measure()}],
    "stream": lambda: [streaming.measure(HOURS)],
}
"""What each has measured so far, again and again."""


def run() -> dict[str, Any]:
    """The keys of `results/trust.json`; parts that an earlier run has measured are kept."""
    missing = set(PARTS) - set(kept_in(FILE, {}).get("measured", {}))
    for part in PARTS:
        if part in missing:
            measure(part)
    return kept_in(FILE, {})


def measure(part: str) -> None:
    """Measure one part and write it down, with the commit it was measured at."""
    began_at = {"commit": commit()}
    for found in PARTS[part]():
        kept = kept_in(FILE, {})  # read late: parts may be measured side by side
        write_json(FILE, {**kept, **found, "measured": {**kept.get("measured", {}), part: began_at}})


if __name__ == "__main__":
    for name in sys.argv[1:]:
        measure(name)
