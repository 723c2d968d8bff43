"""The demo with a small budget: every step works, and the log it leaves replays."""

import subprocess
import sys
from pathlib import Path

import pytest

from egophys_core.replay import ReplayOutcome, replay_log

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.ros
def test_demo_runs_to_its_end_and_leaves_a_log_that_replays(tmp_path):
    out = tmp_path / "demo"
    command = [sys.executable, "examples/demo.py", "--out", str(out), "--generations", "2"]
    ended = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, timeout=800)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    for text in (
        "perceived against measured points",
        "last observed shape stays",
        "moves with nearest controller",
        "after execution",
        str(out / "log"),
    ):
        assert text in ended.stdout.replace("\n", "")
    assert (out / "shapes.png").read_bytes().startswith(b"\x89PNG")
    replay = replay_log(out / "log")
    assert {each.outcome for each in replay.steps} == {ReplayOutcome.SAME}
    assert replay.lost == ()
