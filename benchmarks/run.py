"""Run the benchmarks, write `results/NAME.json` and renew the tables of the README from these files."""

import json
import platform
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks import simulation, towel
from egophys_core.files import write_atomically

REPOSITORY = Path(__file__).resolve().parents[1]
RESULTS = REPOSITORY / "benchmarks/results"
BENCHMARKS: dict[str, Callable[[], dict[str, Any]]] = {"simulation": simulation.run, "towel": towel.run}


def main() -> None:
    """Run those named on the command line, or all."""
    for name in sys.argv[1:] or BENCHMARKS:
        result = {**BENCHMARKS[name](), "machine": _machine(), "commit": _commit(), "command": "make bench"}
        write_atomically(RESULTS / f"{name}.json", (json.dumps(result, indent=1) + "\n").encode())
        print(json.dumps(result, indent=1))
    renew_tables()


def renew_tables() -> None:
    """Put each result's table between its two markers in the README."""
    readme = (REPOSITORY / "README.md").read_text()
    for name, table in (("simulation", _simulation_table), ("towel", _towel_table)):
        text = table(json.loads((RESULTS / f"{name}.json").read_text()))
        before, begin, rest = readme.partition(f"<!-- benchmark {name} -->\n")
        _, end, after = rest.partition("<!-- end -->")
        readme = f"{before}{begin}{text}\n{end}{after}"
    write_atomically(REPOSITORY / "README.md", readme.encode())


def _simulation_table(result: dict[str, Any]) -> str:
    def row(name: str, rate: str) -> str:
        return f"| {name} | {result[rate] / 1e6:.0f} | {result[rate] / result['yardstick_updates_per_s']:.1f} |"

    return "\n".join(
        [
            "| 2,000 nodes, 20,000 springs | million spring updates/s | ratio |",
            "|---|---|---|",
            row("yardstick: one rollout, a spring per thread, atomic adds", "yardstick_updates_per_s"),
            row("16 rollouts, per core (CPU time)", "batched_updates_per_s_core"),
            row("16 rollouts, two cores (elapsed time)", "batched_updates_per_s_machine"),
        ]
    )


def _towel_table(result: dict[str, Any]) -> str:
    keys = ("train_chamfer_m", "test_chamfer_m", "train_track_m", "test_track_m")

    def row(name: str, scores: dict[str, Any]) -> str:
        cells = ("-" if scores[key] is None else f"{1000 * scores[key]:.1f}" for key in keys)
        return f"| {name} | {' | '.join(cells)} |"

    return "\n".join(
        [
            f"| {result['generations']} generations (mm) | train CD | test CD | train TE | test TE |",
            "|---|---|---|---|---|",
            *(row(f"twin, seed {fit['seed']}", fit) for fit in result["fits"]),
            *(row(name, scores) for name, scores in result["baselines"].items()),
        ]
    )


def _machine() -> str:
    models = re.findall(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())
    return f"{models[0] if models else platform.machine()}, {len(models)} cores"


def _commit() -> str:
    command = ["git", "describe", "--always", "--dirty"]
    return subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=True).stdout.strip()


if __name__ == "__main__":
    main()
