"""The state of a coarse search on disk: all that CMA-ES asked for and was told.

With the seed that is the whole search. Resuming repeats it: CMA-ES asks again, what it asks for must be what is
stored, and it is told the stored losses. So the file needs no pickle, and one that cannot be repeated is noticed.
"""

import dataclasses
import hashlib
import io
import json
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from egophys_core import __version__
from egophys_core.errors import OutputError, TwinError
from egophys_core.files import FileKind, write_atomically
from egophys_core.identification.options import FitOptions
from egophys_core.kinds import kind_named
from egophys_core.kinds.kind import RestShape
from egophys_core.kinds.rest_shape import surface_model
from egophys_core.observation.problem import FitProblem
from egophys_core.twin import Codebook

FORMAT_VERSION = 1
"""Raised when a reader of the previous version would misread the file."""

SEARCH_FILE = FileKind(name="the state of a search", head=rb"PK\x03\x04.{26}header\.npy.*\"identity\"")
"""As a twin, an archive that begins with a header."""

START_ANEW = "name another file, or remove this one to start anew"


AFTER_SEARCH = ("generations", "dense_steps", "dense_rate", "stiffness", "prior")
"""Options that do not change the generations of a search."""


@dataclass(frozen=True, kw_only=True)
class SearchState:
    """The finished generations of one search."""

    identity: dict[str, Any]
    """What the search is of, from `search_identity`."""
    populations: tuple[np.ndarray, ...] = ()
    """Per generation [K, D] float64: the normalised coordinates that CMA-ES asked for."""
    losses: tuple[np.ndarray, ...] = ()
    """Per generation [K] float64, metres; infinite for a candidate that diverged."""

    @property
    def generations(self) -> int:
        """Number of finished generations."""
        return len(self.losses)

    def followed_by(self, population: np.ndarray, losses: np.ndarray) -> "SearchState":
        """The state after one more generation of coordinates [K, D] and losses [K]."""
        return dataclasses.replace(
            self, populations=(*self.populations, population), losses=(*self.losses, losses.copy())
        )

    def best(self) -> tuple[np.ndarray, float] | None:
        """Coordinates [D] and loss of the first best candidate; None if none survived."""
        if not self.losses or not np.isfinite(losses := np.stack(self.losses)).any():
            return None
        generation, row = np.unravel_index(np.argmin(losses), losses.shape)
        return self.populations[generation][row], float(losses[generation, row])


def search_identity(
    problems: Sequence[FitProblem],
    shape: RestShape,
    options: FitOptions,
    *,
    seed: int,
    codebook: Codebook | None = None,
) -> dict[str, Any]:
    """All that decides how a search goes, by name, as JSON types.

    How many generations it has is left out: a search that was to be short may go on. So is what comes after it.
    """
    settings = {
        f"option {name}": value
        for name, value in options.settings(at_markers=False).items()
        if name not in AFTER_SEARCH
    }
    return {
        "episodes": [f"{each.episode.name} {_digest(each)}" for each in problems],
        "object at rest": _digest(shape),
        "seed": seed,
        **settings,
        "searched numbers": _digest(surface_model(kind_named(shape.kind)).numbers(shape)),
        **({} if codebook is None else {"codebook": _digest(codebook)}),
        "code version": __version__,
    }


def load_search(path: Path, identity: dict[str, Any]) -> SearchState:
    """The state in a file, to go on with; one without generations if the file does not exist.

    Raises:
        TwinError: unreadable, cut, or the state of another search; says what differs.
    """
    if not path.exists():
        return SearchState(identity=identity)
    state = _decode(path)
    differing = [
        f"{name} ({state.identity.get(name, 'absent')} there, {identity.get(name, 'absent')} here)"
        for name in {**identity, **state.identity}
        if state.identity.get(name) != identity.get(name)
    ]
    if differing:
        raise TwinError(f"search state {path} is of another fit: {'; '.join(differing)}; {START_ANEW}")
    return state


def save_search(state: SearchState, path: Path) -> None:
    """Write a state atomically; equal states give equal bytes.

    Raises:
        OutputError: the file cannot be written.
    """
    header = json.dumps({"format_version": FORMAT_VERSION, "identity": state.identity})
    stream = io.BytesIO()
    np.savez(
        stream,
        header=np.frombuffer(header.encode(), dtype=np.uint8),
        populations=np.stack(state.populations),
        losses=np.stack(state.losses),
    )
    try:
        write_atomically(path, stream.getvalue())
    except OSError as error:
        raise OutputError(f"cannot write search state {path}: {error.strerror}") from error


def _decode(path: Path) -> SearchState:
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as archive:
            header = json.loads(archive["header"].tobytes())
            populations, losses = archive["populations"], archive["losses"]
        version, identity = header["format_version"], dict(header["identity"])
    # What NumPy and zipfile raise for damage: cut, no archive, a changed name, size, flag or checksum.
    except (ValueError, TypeError, LookupError, OSError, EOFError, RuntimeError, zipfile.BadZipFile) as error:
        raise _unreadable(path, error) from error
    if version != FORMAT_VERSION:
        raise TwinError(f"search state {path} has format {version}, this version reads {FORMAT_VERSION}; {START_ANEW}")
    if populations.ndim != 3 or losses.shape != populations.shape[:2]:
        raise _unreadable(path, f"populations are {populations.shape}, losses {losses.shape}")
    return SearchState(identity=identity, populations=tuple(populations), losses=tuple(losses))


def _unreadable(path: Path, reason: object) -> TwinError:
    return TwinError(f"{path} is not the state of a search, or it is damaged ({reason}); {START_ANEW}")


def _digest(value: Any) -> str:
    """First 16 digits of the SHA-256 of nested dataclasses, sequences, arrays and plain values."""
    digest = hashlib.sha256()
    _feed(digest, value)
    return digest.hexdigest()[:16]


def _feed(digest: Any, value: Any) -> None:
    if dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            digest.update(field.name.encode())
            _feed(digest, getattr(value, field.name))
    elif isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, list | tuple):
        digest.update(f"{len(value)}".encode())
        for each in value:
            _feed(digest, each)
    else:
        digest.update(repr(value).encode())
