"""Writing files so that nothing half-written is ever left at a final path."""

import json
import os
import tempfile
from pathlib import Path
from typing import Any

from egophys_core.errors import OutputError


def write_atomically(path: Path, content: bytes) -> None:
    """Write `content` to `path` through a temporary sibling, fsync and rename.

    A process killed at any point leaves either the previous file or the new one at `path`.

    Raises:
        OSError: the folder does not exist or is not writable; nothing is left behind.
    """
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
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


def require_writable(path: Path) -> None:
    """Check that a file can be written, before the work that makes its content.

    Raises:
        OutputError: its folder does not exist or may not be written to, or it is a folder itself.
    """
    if not path.parent.is_dir():
        raise OutputError(f"cannot write {path}: folder {path.parent} does not exist; create it first")
    if not os.access(path.parent, os.W_OK):
        raise OutputError(f"cannot write {path}: no right to write in {path.parent}")
    if not path.name or path.is_dir():
        raise OutputError(f"cannot write {path}: it is a folder; give a file name")
