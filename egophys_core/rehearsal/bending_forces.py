"""Injected damping of bending: moments at the hinges between neighbouring triangles of the surface."""

from collections.abc import Mapping

import numpy as np
from scipy.sparse import csr_array, diags_array

from egophys_core.errors import OptionsError
from egophys_core.rehearsal.bodies import SoftBody
from egophys_core.rehearsal.state import ForceTerm, StepState

SKIN_THICKNESS = 0.01
"""Metres: a solid's skin is damped as if it were a shell of this thickness."""

REFRESH = 0.004
"""Seconds for which the hinges' directions are kept; the surface hardly turns in that time."""

ITERATIONS = 8
"""Of the conjugate gradients."""


def bending_damping(values: Mapping[str, float], body: SoftBody) -> ForceTerm:
    """Moment -(factor - 1) t k (rate of the angle) of a discrete shell (Grinspun et al. 2003).

    Of a body whose stiffness differs from place to place, D is that of its reference stiffness everywhere.

    k = D e^2 / (A1 + A2), with which a grid of right triangles bends as the plate of stiffness D does; t is the time
    by which the material's own damping, 1 of the factor, follows its stiffness.

    Raises:
        OptionsError: a factor below 1: the engine's own damping cannot be taken away.
    """
    if values["factor"] < 1.0:
        raise OptionsError(f"bending_damping: factor must be 1 or more, got {values['factor']}")
    time = (values["factor"] - 1.0) * body.damping
    hinges = _hinges(body.surface)
    i, j, k, m = hinges.T
    thickness = body.thickness if body.is_sheet else SKIN_THICKNESS
    stiffness = body.young * thickness**3 / (12.0 * (1.0 - body.poisson**2))
    places = body.vertices
    edge = places[j] - places[i]
    doubled = [np.linalg.norm(np.cross(edge, places[tip] - places[i]), axis=1) for tip in (k, m)]
    damping = time * 2.0 * stiffness * np.sum(edge**2, axis=1) / (doubled[0] + doubled[1])
    columns = 3 * hinges[:, :, None] + np.arange(3)
    rows = np.broadcast_to(np.arange(len(hinges))[:, None, None], columns.shape)
    matrix: csr_array | None = None
    refreshed = -np.inf

    def add(state: StepState, forces: np.ndarray) -> None:
        nonlocal matrix, refreshed
        if matrix is None or not 0.0 <= state.time - refreshed < REFRESH:
            gradients = _angle_gradients(state.positions, hinges).swapaxes(0, 1)
            rates_of = csr_array(
                (gradients.ravel(), (rows.ravel(), columns.ravel())), shape=(len(hinges), state.positions.size)
            )
            matrix = csr_array(rates_of.T @ diags_array(damping) @ rates_of)
            refreshed = state.time
        change = _change_of_velocity(matrix, state)
        forces += (state.masses / state.duration)[:, None] * change.reshape(-1, 3)

    return add


def _change_of_velocity(matrix: csr_array, state: StepState) -> np.ndarray:
    """What damping by `matrix` C does to the velocities in a step, [3 V] m/s: (M + dt C) change = -dt C v.

    It acts on the velocity after the step: on that before it, thin sheets would need steps too small to wait for.
    Solved by conjugate gradients, which keep all momentum when preconditioned with the masses.
    """
    masses = np.repeat(state.masses, 3)
    change = np.zeros_like(masses)
    residual = -state.duration * (matrix @ state.velocities.ravel())
    direction = residual / masses
    energy = residual @ direction
    for _ in range(ITERATIONS):
        if energy <= 1e-24:
            break
        applied = masses * direction + state.duration * (matrix @ direction)
        length = energy / (direction @ applied)
        change += length * direction
        residual -= length * applied
        energy, last = residual @ (residual / masses), energy
        direction = residual / masses + (energy / last) * direction
    return change


def _hinges(surface: np.ndarray) -> np.ndarray:
    """[H, 4] vertices: both ends of an edge between two triangles, then the tip of each triangle."""
    sides = np.concatenate([surface[:, [0, 1, 2]], surface[:, [1, 2, 0]], surface[:, [2, 0, 1]]])
    ends = np.sort(sides[:, :2], axis=1)
    order = np.lexsort(ends.T)
    ends, tips = ends[order], sides[order, 2]
    twice = np.flatnonzero((ends[1:] == ends[:-1]).all(axis=1))
    return np.column_stack([ends[twice], tips[twice], tips[twice + 1]])


def _angle_gradients(positions: np.ndarray, hinges: np.ndarray) -> np.ndarray:
    """[4, H, 3] 1/m: by how much the angle of each hinge grows as each of its vertices moves."""
    start, end, *tips = (positions[index] for index in hinges.T)
    edge = end - start
    square = np.maximum(np.sum(edge**2, axis=1, keepdims=True), 1e-12)
    at_start, at_end, at_tips = np.zeros_like(edge), np.zeros_like(edge), []
    for tip, sign in zip(tips, (1.0, -1.0), strict=True):
        along = np.sum((tip - start) * edge, axis=1, keepdims=True) / square
        normal = sign * np.cross(edge, tip - start)
        # |normal| is edge length times height, so this is the unit normal over the height.
        slope = normal * np.sqrt(square) / np.maximum(np.sum(normal**2, axis=1, keepdims=True), 1e-18)
        at_tips.append(slope)
        at_start -= (1.0 - along) * slope
        at_end -= along * slope
    return np.stack([at_start, at_end, *at_tips])
