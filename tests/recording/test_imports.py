"""The room stays light: no ROS, no Warp, no torch."""

import subprocess
import sys
from pathlib import Path

import egophys_core

HEAVY = ("rclpy", "warp", "torch", "matplotlib", "scipy")


def test_importing_recording_loads_nothing_heavy():
    script = f"import sys, egophys_core.recording; print([m for m in {HEAVY!r} if m in sys.modules])"
    repository = Path(egophys_core.__file__).parents[1]
    done = subprocess.run([sys.executable, "-c", script], cwd=repository, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_public_names_exist():
    import egophys_core.recording as recording

    assert all(hasattr(recording, name) for name in recording.__all__)
