"""Injected added mass: air that a sheet of the rehearsal world carries along its normal."""

from collections.abc import Mapping

import numpy as np

from egophys_core.rehearsal.bodies import SoftBody
from egophys_core.rehearsal.state import ForceTerm, StepState

FOLLOWS = 0.3
"""Of the change of a vertex's acceleration that the air's follows in a step: at once, it would turn over from step to
step where the air is heavier than the sheet."""


def added_mass(values: Mapping[str, float], body: SoftBody) -> ForceTerm:
    """F = -r m n (n a), a the acceleration of a vertex and n the normal of the triangles around it; of sheets alone."""
    before: np.ndarray | None = None
    carried = np.zeros(len(body.vertices))

    def add(state: StepState, forces: np.ndarray) -> None:
        nonlocal before
        normals = _normals(state.positions, body.surface)
        if before is not None:
            accelerations = (state.velocities - before) / state.duration
            carried[:] += FOLLOWS * (np.einsum("vd,vd->v", accelerations, normals) - carried)
        before = state.velocities.copy()
        forces -= (values["ratio"] * state.masses * carried)[:, None] * normals

    def add_nothing(state: StepState, forces: np.ndarray) -> None:
        pass

    return add if body.is_sheet else add_nothing


def _normals(positions: np.ndarray, surface: np.ndarray) -> np.ndarray:
    """[V, 3] of length 1: mean of the normals of the triangles [F, 3] around each vertex, by their areas."""
    corners = positions[surface]
    of_faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.stack([np.bincount(surface.ravel(), np.repeat(each, 3), len(positions)) for each in of_faces.T], axis=1)
    return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12))
