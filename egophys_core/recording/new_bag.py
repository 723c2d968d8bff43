"""A bag that stands at its place whole, or not at all; for what is not recorded live: a part of it is worth nothing."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from egophys_core.errors import RecordingError
from egophys_core.files import hidden_folder


@contextmanager
def new_bag(bag: Path) -> Iterator[Path]:
    """Where to write a bag that is to stand at `bag` whole, or not at all.

    It is a folder of the bag's name, since the file in a rosbag2 folder is named after it, in a hidden one beside it.
    It is moved to its place when the block ends, and removed when that fails.

    Raises:
        RecordingError: `bag` is there already, or the folder above it cannot be made.
        OutputError: it cannot be written.
    """
    bag = Path(os.path.abspath(bag))
    if os.path.lexists(bag):
        raise RecordingError(f"{bag}: exists already and is not overwritten; choose another name or move it away")
    try:
        bag.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{bag}: cannot be written: {error.strerror or error}") from error
    hidden = hidden_folder(bag)
    try:
        yield hidden / bag.name
        os.rename(hidden / bag.name, bag)
    finally:
        shutil.rmtree(hidden, ignore_errors=True)
