"""Checkpoints of the stiffness prior: a codebook as a safetensors file."""

import json
from functools import cache
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from egophys_core.errors import OutputError, TwinError
from egophys_core.files import write_atomically
from egophys_core.twin import Codebook
from egophys_core.twin.spring_features import FEATURES

FORMAT_VERSION = "1"

DEFAULT = Path(__file__).with_name("default.safetensors")
"""The checkpoint that ships with the project; docs/prior.md says what it was trained on and what it does."""


def save_codebook(codebook: Codebook, path: Path, *, notes: dict[str, str] | None = None) -> None:
    """Write a codebook atomically; equal codebooks with equal notes give equal bytes.

    Args:
        notes: what made it, kept in the file.

    Raises:
        OutputError: the file cannot be written.
    """
    header = {"format_version": FORMAT_VERSION, "features": json.dumps(FEATURES), **(notes or {})}
    arrays = {name: np.ascontiguousarray(values, np.float32) for name, values in codebook.arrays().items()}
    try:
        write_atomically(path, save(arrays, metadata=header))
    except OSError as error:
        raise OutputError(f"cannot write checkpoint {path}: {error.strerror}") from error


def load_codebook(path: Path) -> Codebook:
    """Read a codebook.

    Raises:
        TwinError: absent, damaged, of another format or other features, or of wrong shapes; says which.
    """
    if not path.is_file():
        raise TwinError(f"checkpoint {path} does not exist; name a file that `python -m benchmarks.prior train` made")
    try:
        with safe_open(path, framework="numpy") as file:
            header = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, ValueError, TypeError) as error:
        # A TypeError is of numbers that NumPy has not, as bfloat16.
        raise TwinError(f"{path} is no checkpoint, or it is damaged ({error}); copy it again") from error
    version, features = header.get("format_version"), header.get("features")
    if version != FORMAT_VERSION:
        raise TwinError(f"checkpoint {path} has format {version}, this version reads {FORMAT_VERSION}; train it again")
    if features != json.dumps(FEATURES):
        raise TwinError(f"checkpoint {path} reads features {features}, here they are {FEATURES}; train it again")
    try:
        return Codebook(**arrays)
    except TypeError as error:
        raise TwinError(f"checkpoint {path} lacks or has unknown arrays ({error}); train it again") from error
    except TwinError as error:
        raise TwinError(f"checkpoint {path}: {error}") from error


@cache
def default_codebook() -> Codebook:
    """The prior that ships with the project."""
    return load_codebook(DEFAULT)
