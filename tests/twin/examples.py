"""A twin made by hand, for tests that need any good one."""

from typing import Any

import numpy as np

from egophys_core.twin import ObjectModel, Provenance, Twin
from tests.simulation.scenes import sheet_model


def make_twin(model: ObjectModel | None = None, **changes: Any) -> Twin:
    """A sheet held at one corner by two points."""
    model = model or sheet_model()
    corner = model.graph.positions[-1]
    fields = {
        "model": model,
        "grasp": (corner + np.array([[0.01, 0, 0.01], [-0.01, 0, 0.01]])).astype(np.float32),
        "ground_height": -0.003,
        "provenance": Provenance(
            episodes=({"name": "towel", "sha256": "ab" * 32}, {"name": "tuch", "sha256": "cd" * 32}),
            settings={"generations": 3, "kind": "auto"},
            seed=2**40,
            code_version="0.1.0",
            parent_id="",
            scores={"train_chamfer_m": 0.001, "test_track_m": float("nan")},
        ),
    }
    return Twin(**{**fields, **changes})
