"""Which code a figure was measured with: revisions in the order of time, newest first."""

import json
import re
import subprocess
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from egophys_core.files import write_json

DATES = Path(__file__).parent / "results/revisions.json"
"""Dates of commits by their short hash, kept so that the tables follow from the committed files alone."""


def revisions_in(content: Any) -> set[str]:
    """All values of `commit` anywhere in a result, as they are written there."""
    if isinstance(content, Mapping):
        own = {content["commit"]} if isinstance(content.get("commit"), str) else set()
        return own.union(*(revisions_in(each) for each in content.values()))
    return set().union(*(revisions_in(each) for each in content)) if isinstance(content, list) else set()


def hashes(revision: str) -> list[str]:
    """The commits that a revision names: `94a9f90-dirty` names one, a range two."""
    return re.findall(r"\b[0-9a-f]{7,40}\b", revision)


def known_dates(revisions: Iterable[str]) -> dict[str, str]:
    """Dates by hash: those in the file, and of commits that are new to it what git says; the file is renewed."""
    dates = json.loads(DATES.read_text()) if DATES.exists() else {}
    for name in sorted({each for revision in revisions for each in hashes(revision)} - set(dates)):
        command = ["git", "show", "--no-patch", "--format=%cI", name]
        done = subprocess.run(command, cwd=DATES.parent, capture_output=True, text=True, check=True)
        dates[name] = done.stdout.strip()
    write_json(DATES, dict(sorted(dates.items(), key=lambda each: each[1])))
    return dates


def newest_first(revisions: Iterable[str], dates: Mapping[str, str]) -> list[str]:
    """Revisions by the date of the newest commit that they name; with changes that were not committed after without."""
    return sorted(set(revisions), key=lambda each: (max(dates[name] for name in hashes(each)), each), reverse=True)


def described(revision: str, dates: Mapping[str, str]) -> str:
    """`94a9f90 and changes not yet committed (2026-11-25)`."""
    day = max(dates[name] for name in hashes(revision))[:10]
    return f"{revision.removesuffix('-dirty')}{' and changes not yet committed' * revision.endswith('-dirty')} ({day})"
