"""Twin: the model of an object, and where it came from."""

import hashlib
import json
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from egophys_core.errors import TwinError
from egophys_core.json_numbers import finite_number
from egophys_core.twin.graph import SpringGraph
from egophys_core.twin.model import ObjectModel
from egophys_core.twin.parameters import with_former_names

CODEBOOK = "codebook."
"""Begins the names of a codebook's arrays."""


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """What made a twin; enough to make it again."""

    episodes: tuple[dict[str, str], ...]
    """Per training episode: name and sha256 of its points."""
    settings: dict[str, Any]
    """The options of the fit, as in a YAML file."""
    seed: int
    code_version: str
    parent_id: str = ""
    """Twin this one was derived from; empty for a first fit."""
    scores: dict[str, float]
    """train/test errors in metres on the first training episode, by the names of `evaluation.Scores`."""


@dataclass(frozen=True, kw_only=True)
class Twin:
    """The physical twin of one object: a model to simulate, and where it came from."""

    model: ObjectModel
    grasp: np.ndarray
    """[C, 3] float32, metres, world: controller points of the first hand when it took hold of the object
    at rest; a planner grasps there unless told otherwise. [0, 3] if no hand ever did."""
    ground_height: float
    """World z of the table in the first training episode, metres."""
    provenance: Provenance

    def __post_init__(self) -> None:
        if self.grasp.ndim != 2 or self.grasp.shape[1] != 3:
            raise TwinError(f"twin grasp must be [C, 3] in metres, got {self.grasp.shape}")
        if self.grasp.dtype.kind != "f" or not np.isfinite(self.grasp).all():
            raise TwinError(
                f"twin grasp must be finite floating-point numbers in metres, got {self.grasp.tolist()[:1]}"
            )
        if finite_number(self.ground_height) is None:
            raise TwinError(f"ground_height must be a finite number in metres, got {self.ground_height!r}")

    @cached_property
    def twin_id(self) -> str:
        """First 16 hexadecimal digits of the SHA-256 of all that the twin is; equal twins have equal ids.

        Parameters go in by the names that they had first, so a twin keeps the id by which earlier logs name it.
        """
        digest = hashlib.sha256()
        for array in self.arrays().values():
            digest.update(np.ascontiguousarray(array).tobytes())
        header = self.header()
        header["parameters"] = with_former_names(header["parameters"])
        digest.update(json.dumps(header, sort_keys=True).encode())
        return digest.hexdigest()[:16]

    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays of the twin by name, in a fixed order."""
        graph = {field.name: getattr(self.model.graph, field.name) for field in fields(SpringGraph)}
        uneven, codebook = self.model.intrinsic_curvature, self.model.codebook
        learned = {} if codebook is None else codebook.arrays()
        return {
            **graph,
            "stiffness": self.model.stiffness,
            "grasp": self.grasp,
            **({} if uneven is None else {"intrinsic_curvature": uneven}),
            **{CODEBOOK + name: values for name, values in learned.items()},
        }

    def header(self) -> dict[str, Any]:
        """All that is not an array, as JSON types."""
        effects = [asdict(effect) for effect in self.model.effects]
        return {
            **({"effects": effects} if effects else {}),
            "kind": self.model.kind,
            "parameters": asdict(self.model.parameters),
            "ground_height": self.ground_height,
            "provenance": asdict(self.provenance),
        }
