"""Run the commands of docs/tutorial.md in their order and put what each prints below it."""

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

REPOSITORY = Path(__file__).resolve().parents[1]
PAGE = REPOSITORY / "docs/tutorial.md"
COMMAND = re.compile(r"^```\n(?P<command>egophys .*?)\n```\n(?:\n```text\n.*?```\n)?", re.MULTILINE | re.DOTALL)
"""A block with one command, and what it printed."""


def main() -> int:
    """Renew the page."""
    with TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "examples").symlink_to(REPOSITORY / "examples")
        PAGE.write_text(renewed(PAGE.read_text(), lambda command: run(command, folder)))
    return 0


def renewed(text: str, run_command: Callable[[str], str]) -> str:
    """The page with the output of each command, which are run in their order."""

    def with_output(match: re.Match[str]) -> str:
        printed = run_command(match["command"]).rstrip()
        return f"```\n{match['command']}\n```\n" + (f"\n```text\n{printed}\n```\n" if printed else "")

    return COMMAND.sub(with_output, text)


def run(command: str, folder: Path) -> str:
    """What a command prints to the standard output, run in a folder.

    Raises:
        RuntimeError: it fails; `egophys diagnose` may end with 1, a finding.
    """
    words = shlex.split(command.replace("\\\n", " "))
    done = subprocess.run(
        [sys.executable, "-m", "egophys_core.cli.main", *words[1:]],
        cwd=folder,
        env={**os.environ, "COLUMNS": "100", "PYTHONPATH": f"{REPOSITORY}:{os.environ.get('PYTHONPATH', '')}"},
        capture_output=True,
        text=True,
        timeout=1200,
        check=False,
    )
    if done.returncode not in ((0, 1) if words[1] == "diagnose" else (0,)):
        raise RuntimeError(f"{command} ended with {done.returncode}:\n{done.stdout}{done.stderr}")
    return "\n".join(line.rstrip() for line in done.stdout.splitlines())


if __name__ == "__main__":
    sys.exit(main())
