"""A twin as one file: a NumPy archive of its arrays and a JSON header, never pickle."""

import io
import json
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from egophys_core.effects import TwinEffect, effect_named
from egophys_core.errors import EgophysError, TwinError
from egophys_core.files import FileKind, write_atomically
from egophys_core.json_numbers import finite_number
from egophys_core.twin.codebook import Codebook
from egophys_core.twin.graph import SpringGraph
from egophys_core.twin.model import ObjectModel
from egophys_core.twin.parameters import PhysicalParameters, with_present_names
from egophys_core.twin.twin import CODEBOOK, Provenance, Twin

FORMAT_VERSION = 2
"""Raised when a reader of the previous version would misread the file. 2 added effects."""

READABLE = (1, 2)

TWIN_FILE = FileKind(name="a twin", head=rb"PK\x03\x04.{26}header\.npy.*\"ground_height\"")
"""An archive whose first member is the header of a twin."""


def encode_twin(twin: Twin) -> bytes:
    """The twin's file content; equal twins give equal bytes."""
    header = json.dumps({"format_version": FORMAT_VERSION, **twin.header()}, sort_keys=True)
    stream = io.BytesIO()
    np.savez(stream, header=np.frombuffer(header.encode(), dtype=np.uint8), **twin.arrays())
    return stream.getvalue()


def decode_twin(content: bytes, *, name: str) -> Twin:
    """The twin in a file's content.

    Raises:
        TwinError: not a twin, cut, of a newer format, or inconsistent; `name` says which file.
    """
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as archive:
            arrays = {key: archive[key] for key in archive.files}
        header: dict[str, Any] = json.loads(arrays.pop("header").tobytes())
        version = header["format_version"]
    except (ValueError, TypeError, KeyError, OSError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise TwinError(
            f"{name} is not a twin file, or it is cut ({error}); build it again with egophys build"
        ) from error
    if version not in READABLE:
        newer = isinstance(version, int) and version > READABLE[-1]
        raise TwinError(
            f"{name} has twin format {version}, this version reads up to {READABLE[-1]}; "
            f"{'update egophys' if newer else 'build it again'}"
        )
    try:
        stiffness, grasp = arrays.pop("stiffness"), arrays.pop("grasp")
        uneven = arrays.pop("intrinsic_curvature", None)
        learned = {key: arrays.pop(key) for key in list(arrays) if key.startswith(CODEBOOK)}
        provenance = header["provenance"]
        return Twin(
            model=ObjectModel(
                kind=str(header["kind"]),
                graph=SpringGraph(**arrays),
                parameters=PhysicalParameters(**with_present_names(header["parameters"])),
                stiffness=stiffness,
                codebook=Codebook(**{key.removeprefix(CODEBOOK): each for key, each in learned.items()})
                if learned
                else None,
                intrinsic_curvature=uneven,
                effects=tuple(_effect(each) for each in header.get("effects", [])),
            ),
            grasp=grasp,
            ground_height=header["ground_height"],
            provenance=Provenance(**{**provenance, "episodes": tuple(provenance["episodes"])}),
        )
    except TwinError as error:
        raise TwinError(f"{name}: {error}; build it again") from error
    except (TypeError, KeyError, ValueError, AttributeError) as error:
        raise TwinError(f"{name} lacks or has unknown twin fields ({error}); build it again") from error
    except EgophysError as error:
        raise TwinError(f"{name}: {error}; build it again") from error


def _effect(content: dict[str, Any]) -> TwinEffect:
    """An effect with exactly the parameters that the library knows."""
    name, values = content["name"], {key: finite_number(each) for key, each in content["values"].items()}
    known = {parameter.name for parameter in effect_named(name).parameters}
    if set(values) != known:
        raise ValueError(f"effect {name} has parameters {sorted(values)}, not {sorted(known)}")
    finite = {key: each for key, each in values.items() if each is not None}
    if len(finite) < len(values):
        raise ValueError(f"effect {name} has parameters that are not finite numbers, {content['values']!r:.200}")
    return TwinEffect(name=name, values=finite)


def save_twin(twin: Twin, path: Path) -> None:
    """Write a twin to `path` atomically.

    Raises:
        TwinError: the folder does not exist or cannot be written.
    """
    try:
        write_atomically(path, encode_twin(twin))
    except OSError as error:
        raise TwinError(f"cannot write twin {path}: {error.strerror}; check that its folder exists") from error


def load_twin(path: Path) -> Twin:
    """Read a twin from `path`.

    Raises:
        TwinError: absent, unreadable, not a twin, cut or of another format.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise TwinError(f"cannot read twin {path}: {error.strerror}") from error
    return decode_twin(content, name=str(path))
