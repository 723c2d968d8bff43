"""Twins without a history."""

import numpy as np

from egophys_core.twin import ObjectModel, Provenance, Twin


def twin_of(model: ObjectModel, *, grasp: np.ndarray | None = None, ground_height: float = 0.0) -> Twin:
    """A twin of a model; held nowhere unless said."""
    provenance = Provenance(episodes=(), settings={}, seed=0, code_version="", scores={})
    points = np.zeros((0, 3)) if grasp is None else grasp
    return Twin(model=model, grasp=points.astype(np.float32), ground_height=ground_height, provenance=provenance)
