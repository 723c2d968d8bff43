"""The pages that people read, and the commands in them: blocks without a language are for a shell."""

import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from glob import glob
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
PAGES = [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").glob("*.md"))]


@dataclass(frozen=True, kw_only=True)
class Command:
    """One line of a block, continuation lines joined."""

    page: str
    text: str

    @property
    def words(self) -> list[str]:
        """Without the comment."""
        return shlex.split(self.text, comments=True)


def blocks(page: Path, language: str = "") -> list[str]:
    """Contents of the fenced blocks of a language."""
    fenced = re.findall(r"^```(\w*)\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)
    return [content for each, content in fenced if each == language]


def commands(page: Path) -> list[Command]:
    """All commands for a shell, in order."""
    lines = "".join(blocks(page)).replace("\\\n", " ").splitlines()
    return [Command(page=page.name, text=line.strip()) for line in lines if line.strip()]


def all_commands(start: str) -> list[Command]:
    """Those of all pages that begin so."""
    found = [each for page in PAGES for each in commands(page) if each.text.startswith(start)]
    assert found, f"no page shows {start}"
    return found


def run_egophys(words: Sequence[str], folder: Path, *, good: Sequence[int] = (0,)) -> str:
    """Run `egophys ...` in a folder, with the files that a shell would put for a pattern; what it printed."""
    given = [path for word in words[1:] for path in (sorted(glob(word, root_dir=folder)) if "*" in word else [word])]
    program = [sys.executable, "-m", "egophys_core.cli.main", *given]
    done = subprocess.run(program, cwd=folder, capture_output=True, text=True, timeout=900, check=False)
    assert done.returncode in good, f"{' '.join(words)}\n{done.stdout}{done.stderr}"
    return done.stdout
