"""Static deformations of a spring graph."""

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, identity
from scipy.sparse.linalg import splu

from egophys_core.twin import ObjectModel, SpringGraph

REGULAR = 1e-9
"""Share of the largest stiffness added to the diagonal: what no spring holds stays where it is."""

FOOT = 0.05
"""Of a spring's length: height above the lowest node up to which nodes stand on the table. Nodes that do not touch it
carry no weight: with 0.3 a plush ellipsoid fell over by 40 degrees within a second (docs/notes/unseen_side.md)."""

FEWEST_OF_FOOT = 4
"""Nodes that an object stands on at least."""

SHORTEST_TO_LONGEST = (0.5, 1.5)
"""Of its length as seen: rest lengths that a spring may have."""

INCREMENTS = 6
"""Parts in which a deformation is applied; springs turn with it from one to the next."""

CORRECTIONS = 3
"""Gauss-Newton steps after each part."""


def stiffness_matrix(positions: np.ndarray, springs: np.ndarray, stiffness: np.ndarray) -> csc_matrix:
    """[3N, 3N] N/m: the forces that hold small displacements of springs [E, 2] with stiffness [E], N/m.

    A spring along the unit vector d resists with k d d^T, each block positive on its ends and negative between them.
    """
    along = _directions(positions, springs)[0]
    blocks = stiffness[:, None, None] * along[:, :, None] * along[:, None, :]
    axis, other = np.meshgrid(np.arange(3), np.arange(3), indexing="ij")
    rows, columns, values = [], [], []
    for one, two, sign in ((0, 0, 1.0), (1, 1, 1.0), (0, 1, -1.0), (1, 0, -1.0)):
        rows.append((3 * springs[:, one, None, None] + axis).ravel())
        columns.append((3 * springs[:, two, None, None] + other).ravel())
        values.append((sign * blocks).ravel())
    size = 3 * len(positions)
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return coo_matrix(entries, shape=(size, size)).tocsc()


def with_weight_carried(model: ObjectModel, masses: np.ndarray) -> ObjectModel:
    """The model with springs that carry its weight where it lies: it was seen under gravity, and would sag once more.

    The elongations e of the linear problem K u = f, with f the weight and the foot held, are those that carry it; rest
    lengths are what is seen less e (Hsu et al., "A general two-stage initialization for sag-free deformable
    simulations", ACM Transactions on Graphics 41(4), 2022, for springs of given stiffness).

    Args:
        masses: [N] kg, of its nodes.
    """
    weights = model.parameters.gravity * masses
    graph = model.graph
    elongation = elongation_by_weight(graph.positions, graph.springs, model.stiffness.astype(np.float64), weights)
    return replace(model, graph=with_elongation(graph, elongation))


def with_elongation(graph: SpringGraph, elongation: np.ndarray) -> SpringGraph:
    """The graph with springs that are longer than at rest by [E] metres where it lies, negative if they are shorter."""
    lengths = _directions(graph.positions.astype(np.float64), graph.springs)[1]
    rest_lengths = np.clip(lengths - elongation, *(np.array(SHORTEST_TO_LONGEST)[:, None] * lengths))
    return replace(graph, rest_lengths=rest_lengths.astype(np.float32))


def elongation_by_weight(
    nodes: np.ndarray, springs: np.ndarray, stiffness: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """[E] metres by which weights [N], N, on nodes [N, 3] that stand on a foot make springs [E, 2] longer.

    Inversely proportional to the stiffness [E], N/m.
    """
    positions = nodes.astype(np.float64)
    along, lengths = _directions(positions, springs)
    low = positions[:, 2] - positions[:, 2].min()
    foot = low <= max(FOOT * float(np.median(lengths)), float(np.sort(low)[min(FEWEST_OF_FOOT, len(low)) - 1]))
    weight = np.zeros_like(positions)
    weight[:, 2] = -weights
    matrix = stiffness_matrix(positions, springs, stiffness)
    free = np.repeat(~foot, 3)
    moved = np.zeros_like(positions)
    if free.any():
        moved.ravel()[free] = _solution(matrix[free][:, free], weight.ravel()[free])
    return np.asarray(((moved[springs[:, 1]] - moved[springs[:, 0]]) * along).sum(axis=1))


def equilibrium(
    positions: np.ndarray,
    springs: np.ndarray,
    stiffness: np.ndarray,
    *,
    fixed: np.ndarray,
    displacement: np.ndarray,
    forces: np.ndarray,
) -> np.ndarray:
    """[N, 3] metres: where nodes at rest [N, 3] go when some are displaced and forces act on the others.

    Args:
        springs: [E, 2], at rest at `positions`.
        stiffness: [E] N/m.
        fixed: [N] bool, nodes put where `displacement` [N, 3] metres says.
        forces: [N, 3] N.
    """
    free = np.repeat(~fixed, 3)
    rest_lengths = _directions(positions, springs)[1]
    here = positions.astype(np.float64).copy()
    for share in np.arange(1, INCREMENTS + 1) / INCREMENTS:
        goal = positions + share * displacement
        for _ in range(CORRECTIONS):
            step = np.where(fixed[:, None], goal - here, 0.0)
            along, lengths = _directions(here, springs)
            pull = (stiffness * (lengths - rest_lengths))[:, None] * along
            acting = share * forces
            np.add.at(acting, springs[:, 0], pull)
            np.add.at(acting, springs[:, 1], -pull)
            matrix = stiffness_matrix(here, springs, stiffness)
            asked = acting.ravel()[free] - matrix[free][:, ~free] @ step.ravel()[~free]
            moved = step.ravel()
            moved[free] = _solution(matrix[free][:, free], asked)
            here = here + moved.reshape(-1, 3)
    return here


def _solution(matrix: csc_matrix, forces: np.ndarray) -> np.ndarray:
    """[M] metres: the displacements under forces [M], N, of what a stiffness matrix [M, M] holds."""
    regular = matrix + REGULAR * matrix.diagonal().max() * identity(matrix.shape[0], format="csc")
    return np.asarray(splu(regular.tocsc()).solve(forces))


def _directions(positions: np.ndarray, springs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors [E, 3] from the first to the second end, and lengths [E] in metres."""
    along = positions[springs[:, 1]].astype(np.float64) - positions[springs[:, 0]]
    lengths = np.linalg.norm(along, axis=1)
    return along / lengths[:, None], lengths
