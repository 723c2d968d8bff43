"""Finding the packages and files of learned models, with errors that say what is missing and where it comes from."""

import importlib
import json
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from egophys_core.errors import EgophysError

PAGE = "docs/learned_models.md"
INSTALL_TORCH = "pip install -e '.[learned]' in this repository"


class LearnedModelError(EgophysError):
    """A learned model cannot be used: its package, its files or the hardware asked for are missing or do not fit."""


def require_module(name: str, install: str) -> ModuleType:
    """Import a package of a learned model.

    Args:
        name: `transformers`.
        install: the command that installs it.

    Raises:
        LearnedModelError: it cannot be imported.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise LearnedModelError(f"cannot import {name} ({error}); install it: {install}. See {PAGE}") from error


def require_file(path: Path | str, what: str) -> Path:
    """A file of weights that the user named.

    Raises:
        LearnedModelError: there is none.
    """
    path = Path(path)
    if not path.is_file():
        raise LearnedModelError(f"{path}: no such file; needed are {what}. {PAGE} says where they come from")
    return path


def require_folder(folder: Path | str, what: str, model_types: tuple[str, ...]) -> Path:
    """A folder in the layout of `save_pretrained`, of a model of one of the types.

    Args:
        folder: must hold `config.json` and weights (`*.safetensors` or `*.bin`).
        what: what it should be, for messages.
        model_types: allowed values of `model_type` in `config.json`.

    Raises:
        LearnedModelError: the folder or one of the files is missing, or it is another model.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise LearnedModelError(f"{folder}: no such folder; needed is that of {what}. {PAGE} says where it comes from")
    config = folder / "config.json"
    if not config.is_file():
        raise LearnedModelError(f"{folder}: holds no config.json; is it the folder of {what}? See {PAGE}")
    if not any((*folder.glob("*.safetensors"), *folder.glob("*.bin"))):
        raise LearnedModelError(
            f"{folder}: holds no weights (*.safetensors or *.bin) of {what}; copy all of its files. See {PAGE}"
        )
    try:
        found = json.loads(config.read_text("utf-8"))["model_type"]
    except (ValueError, KeyError, TypeError) as error:
        raise LearnedModelError(f"{config}: not readable as the configuration of a model: {error!r}") from error
    if found not in model_types:
        raise LearnedModelError(
            f"{folder}: is a model of type {found!r}, needed is {what} (type {' or '.join(model_types)}); "
            "were the folders mixed up?"
        )
    return folder


def from_folder(kind: Any, folder: Path, device: str) -> Any:
    """A model of transformers class `kind` with all of its weights, in evaluation mode on a device.

    Raises:
        LearnedModelError: a file is missing or damaged, or the weights are not those of the model.
    """
    try:
        model, report = kind.from_pretrained(folder, local_files_only=True, output_loading_info=True)
    except Exception as error:  # transformers, safetensors and torch each raise their own kinds
        raise LearnedModelError(f"{folder}: {kind.__name__} cannot be loaded: {first_line(error)}") from error
    missing = sorted(report["missing_keys"])
    if missing:
        raise LearnedModelError(
            f"{folder}: the weights lack {len(missing)} of the arrays of {kind.__name__}, as {missing[0]}; "
            "config.json and weights are not of one model. Copy both again"
        )
    return to_device(model, device).eval()


def processor_from_folder(kind: Any, folder: Path) -> Any:
    """The processor (image sizes, tokenizer) that belongs to a model.

    Raises:
        LearnedModelError: its files are missing or damaged.
    """
    try:
        return kind.from_pretrained(folder, local_files_only=True)
    except Exception as error:
        raise LearnedModelError(
            f"{folder}: {kind.__name__} cannot be loaded: {first_line(error)}; copy also the files of the tokenizer "
            "and preprocessor_config.json"
        ) from error


def to_device(model: Any, device: str) -> Any:
    """A torch module on a device, `cpu` or `cuda`.

    Raises:
        LearnedModelError: there is no such device.
    """
    try:
        return model.to(device)
    except (RuntimeError, AssertionError) as error:
        raise LearnedModelError(f"cannot use device {device!r}: {first_line(error)}; cpu always works") from error


def rgb(image: np.ndarray) -> np.ndarray:
    """[H, W, 3] uint8 RGB, contiguous, of a view's image, which is BGR; all of these models were trained on RGB."""
    return np.ascontiguousarray(image[..., ::-1])


def first_line(error: BaseException) -> str:
    """Kind and first line of an error; those of torch and transformers have pages of advice below it."""
    return f"{type(error).__name__}: {(str(error).strip().splitlines() or [''])[0]}"
