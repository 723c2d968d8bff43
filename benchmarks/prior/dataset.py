"""Making and reading the set: a bag an episode, in a folder for each split, with checksums of what is in them.

The set is not in the repository; `make_set` makes it again from the seeds of `sequences.py`. Checksums of the points as
they are read are: `checksums.json`. On another machine, or with another MuJoCo, floating point may round otherwise, so
a different checksum is worth a warning and no more.
"""

import hashlib
import json
import shutil
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.prior.objects import make_object
from benchmarks.prior.sequences import SEQUENCES, Sequence, Split
from benchmarks.side_by_side import side_by_side
from egophys_core.episode import Episode, EpisodeWarning
from egophys_core.errors import EgophysError
from egophys_core.files import write_json
from egophys_core.recording import read_episode, write_episode
from egophys_core.rehearsal import RehearsalOptions, rehearse_body

FOLDER = Path(__file__).resolve().parents[2] / "out/prior/data"
CHECKSUMS = Path(__file__).parent / "checksums.json"
MADE_HERE = "checksums.json"
"""In the folder of the set: what this machine made."""

OPTIONS = RehearsalOptions()
"""How every object is observed: as by `egophys rehearse`."""


class ChecksumWarning(UserWarning):
    """An episode is not, to the last bit, the one whose checksum is in the repository."""


def make_set(
    folder: Path = FOLDER,
    sequences: tuple[Sequence, ...] = SEQUENCES,
    *,
    workers: int = 1,
    report: Callable[[str, int, int], None] = lambda name, done, of: None,
) -> dict[str, str]:
    """Make what is missing in a folder; an episode that is there and is what was made is kept.

    Args:
        folder: of the set; made if it does not exist. After a change of objects or motions, delete it.
        sequences: which ones.
        workers: processes side by side.
        report: told after each new episode its name, how many there are now, and of how many.

    Returns:
        The checksum of each episode, by the name of its sequence.

    Raises:
        SimulationError: an object diverged; it needs another place in the list of `sequences.py`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    noted = folder / MADE_HERE
    checksums: dict[str, str] = json.loads(noted.read_text()) if noted.exists() else {}
    missing = [each for each in sequences if not _is_there(each, folder, checksums.get(each.name))]
    done = len(sequences) - len(missing)
    for sequence, made in side_by_side(partial(make_episode, folder=folder), missing, workers=workers):
        checksums[sequence.name] = made
        write_json(noted, dict(sorted(checksums.items())))
        done += 1
        report(sequence.name, done, len(sequences))
    return {each.name: checksums[each.name] for each in sequences}


def rehearse_sequence(sequence: Sequence) -> Episode:
    """The episode of a sequence, which is the same every time."""
    body = make_object(sequence.shape, sequence.variation, sequence.object_seed, points=OPTIONS.points)
    seeds = (sequence.seed, sequence.object_seed)
    return rehearse_body(body, OPTIONS, sequence.motion, name=sequence.name, seeds=seeds)


def make_episode(sequence: Sequence, folder: Path) -> str:
    """Rehearse a sequence and write its bag, all of it or nothing; returns the checksum of what is read back."""
    path = place(sequence, folder)
    making = path.with_name(f".{path.name}.part")
    path.parent.mkdir(parents=True, exist_ok=True)
    for each in (making, path):
        shutil.rmtree(each, ignore_errors=True)
    write_episode(rehearse_sequence(sequence), making)
    making.rename(path)
    return checksum(read_episode(path))


def read_set(folder: Path, split: Split, *, paper: bool = False) -> list[Episode]:
    """The episodes of a split, in the order of the list.

    Args:
        folder: where `make_set` made them.
        split: which part.
        paper: only those that stand for the paper's.

    Raises:
        RecordingError: one is not there.
    """
    chosen = [each for each in SEQUENCES if each.split is split and (each.paper or not paper)]
    return [read_episode(place(each, folder)) for each in chosen]


def place(sequence: Sequence, folder: Path) -> Path:
    """Where the bag of a sequence is."""
    return folder / sequence.split / sequence.name


def checksum(episode: Episode) -> str:
    """SHA-256 of the points of the object and of the hands, with their numbers."""
    digest = hashlib.sha256()
    for array in (episode.point_ids, np.nan_to_num(episode.points, nan=-1.0), episode.controllers):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def warn_of_others(checksums: dict[str, str]) -> None:
    """Compare checksums, by name, with those of the repository."""
    known: dict[str, str] = json.loads(CHECKSUMS.read_text())
    others = [name for name, value in checksums.items() if known.get(name) != value]
    if others:
        warnings.warn(
            f"{len(others)} of {len(checksums)} episodes are not those of {CHECKSUMS.name}, as {others[0]}: "
            "made on another machine, with another MuJoCo or from another list?",
            ChecksumWarning,
            stacklevel=2,
        )


def _is_there(sequence: Sequence, folder: Path, expected: str | None) -> bool:
    """Whether a bag is what was made here."""
    path = place(sequence, folder)
    if expected is None or not path.is_dir():
        return False
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", EpisodeWarning)
            return checksum(read_episode(path)) == expected
    except EgophysError:
        return False
