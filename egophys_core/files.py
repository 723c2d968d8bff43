"""Writing files so that nothing half-written is ever left at a final path."""

import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from egophys_core.errors import OutputError

HEAD_BYTES = 4096
"""Of a file, by which its kind is told."""


@dataclass(frozen=True, kw_only=True)
class FileKind:
    """A kind of file that is written here, and how it is told from files of other kinds."""

    name: str
    """With its article, for messages: `a twin`."""
    head: bytes
    """Regular expression for the first bytes."""

    def fits(self, path: Path) -> bool:
        """Whether a file is of this kind; an empty one, in which nothing is lost, is of any.

        Raises:
            OSError: it cannot be read.
        """
        with path.open("rb") as stream:
            head = stream.read(HEAD_BYTES)
        return not head or re.match(self.head, head, re.DOTALL | re.MULTILINE) is not None


def write_atomically(path: Path, content: bytes) -> None:
    """Write `content` to `path` through a temporary sibling, fsync and rename.

    A process killed at any point leaves either the previous file or the new one at `path`.

    Raises:
        OSError: the folder does not exist or is not writable; nothing is left behind.
    """
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=hidden_name(path), suffix=".part")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def write_json(path: Path, content: Any) -> None:
    """Write `content` as indented JSON, as `write_atomically` does.

    Raises:
        OSError: the folder does not exist or is not writable; nothing is left behind.
        TypeError: `content` holds what JSON has no word for; nothing is written.
    """
    write_atomically(path, (json.dumps(content, indent=1) + "\n").encode())


def require_writable(path: Path, kind: FileKind, *, inputs: Iterable[Path] = ()) -> None:
    """Check that a file can be written, before the work that makes its content.

    Args:
        path: the file.
        kind: of what is written: a file that is there is replaced only by one of its kind.
        inputs: files and folders that the content is made from.

    Raises:
        OutputError: its folder does not exist or may not be written to, it is a folder itself, an input, within an
            input, or a file of another kind.
    """
    require_place(path)
    if path.is_dir():
        raise OutputError(f"cannot write {path}: it is a folder; give a file name")
    require_apart(path, inputs)
    if path.exists():
        _require_kind(path, kind)


def require_place(path: Path) -> None:
    """Check that a file or folder of this name can be made: the folder above is there and the system takes the name.

    Raises:
        OutputError: it is not, or may not be written to, or the name is too long.
    """
    above = Path(os.path.abspath(path)).parent
    if not above.is_dir():
        raise OutputError(f"cannot write {path}: folder {above} does not exist; create it first")
    if not os.access(above, os.W_OK):
        raise OutputError(f"cannot write {path}: no right to write in {above}")
    try:
        path.exists()
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}; choose another name") from error


def require_new_folder(folder: Path) -> None:
    """Check that a folder can be made, or is empty, before the work that makes what goes into it.

    Raises:
        OutputError: `folder` is a file or not empty, or the folder above it is absent or may not be written to.
    """
    require_place(folder)
    if folder.is_dir():
        if any(folder.iterdir()):
            raise OutputError(f"cannot write {folder}: the folder is not empty; choose another name or move it away")
    elif folder.exists():
        raise OutputError(f"cannot write {folder}: it is a file; give the name of a new folder")


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """A folder to write to that stands at `folder` whole when the block ends, or not at all.

    Raises:
        OutputError: as of `require_new_folder`, or the system refuses to write.
    """
    require_new_folder(folder)
    hidden = hidden_folder(folder)
    try:
        yield hidden
        hidden.rename(os.path.abspath(folder))
    except OSError as error:
        raise OutputError(f"cannot write {folder}: {error.strerror or error}") from error
    finally:
        shutil.rmtree(hidden, ignore_errors=True)


def hidden_name(path: Path) -> str:
    """How the hidden file or folder beside `path` is called in which it is made; not longer than `path` may be."""
    return f".{path.name[:40]}."


def hidden_folder(path: Path) -> Path:
    """Make a hidden folder beside `path`, to be renamed to it when all is in it.

    Raises:
        OutputError: it cannot be made.
    """
    final = Path(os.path.abspath(path))
    try:
        folder = Path(tempfile.mkdtemp(dir=final.parent, prefix=hidden_name(final), suffix=".part"))
        folder.chmod(0o755)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}") from error
    return folder


def require_apart(path: Path, inputs: Iterable[Path]) -> None:
    """Check that what is written is nothing that it is made from, nor within a folder of it.

    Raises:
        OutputError: it is.
    """
    final = Path(os.path.realpath(path))
    for each in inputs:
        read = Path(os.path.realpath(each))
        if final == read:
            raise OutputError(f"cannot write {path}: it is read by the same command; choose another name")
        if read in final.parents:
            raise OutputError(
                f"cannot write {path}: it is in {each}, which is read by the same command; choose a place outside"
            )


def _require_kind(path: Path, kind: FileKind) -> None:
    try:
        fits = path.is_file() and kind.fits(path)
    except OSError as error:
        raise OutputError(f"cannot write {path}: it is there and cannot be read: {error.strerror}") from error
    if not fits:
        raise OutputError(
            f"cannot write {path}: it is there already and is not {kind.name}; choose another name or move it away"
        )
