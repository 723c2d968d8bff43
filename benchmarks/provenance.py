"""Where a figure comes from: the machine and the commit it was measured on."""

import platform
import re
import subprocess
from pathlib import Path


def machine() -> str:
    """The processor and how many cores of it there are."""
    models = re.findall(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())
    return f"{models[0] if models else platform.machine()}, {len(models)} cores"


def commit() -> str:
    """The commit of this code, marked if files differ from it."""
    command = ["git", "describe", "--always", "--dirty"]
    return subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True, check=True).stdout.strip()
