"""Node positions of a deformed object from its tracked points (docs/notes/present_state.md).

They minimise, over x [N, 3],

    sum_i c_i |W_i x - y_i|^2  +  sum_(j,k) s_jk |x_j - x_k - R_jk (p_j - p_k)|^2

with points i seen at y_i and the springs (j, k) of the twin, stiff as s_jk: as rigid as possible (Sorkine and Alexa,
Symposium on Geometry Processing 2007, 109), where p are the nodes at rest and R_jk is the mean of the rotations about
both nodes.
Nodes that no seen point tells of are carried along, and none is below the table.
"""

import numpy as np
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import splu

from egophys_core.geometry import nearest_rotation
from egophys_core.twin import SpringGraph, SpringKind

STIFFNESS = 0.03
"""Of a structural spring, beside a point that is seen, which has 1."""
BENDING_STIFFNESS = 0.003
"""Of a bending spring: what is hidden under a fold is bent more sharply than the springs are long."""

ITERATIONS = 40

FIRST_OUTLIER, OUTLIER = 0.3, 0.01
"""Metres: a point this far from where the shape has it counts a quarter (Geman and McClure's weights). In the first
half of the iterations it falls from the one to the other: before the shape has formed no point is an outlier."""


def nodes_from_points(graph: SpringGraph, weights: csr_matrix, points: np.ndarray, *, floor: float) -> np.ndarray:
    """[N, 3] float32 metres: where the nodes are.

    Args:
        graph: of the twin.
        weights: [P, N], which mean of nodes each point that is seen is.
        points: [P, 3] metres, where they are seen.
        floor: height below which no node can be, metres.
    """
    rest, seen, edges = graph.positions.astype(np.float64), points.astype(np.float64), graph.springs
    count, springs = len(rest), len(edges)
    ends = np.repeat(np.arange(springs), 2)
    difference = csr_matrix((np.tile([1.0, -1.0], springs), (ends, edges.ravel())), shape=(springs, count))
    touching = abs(difference).T.tocsr()
    stiffness = np.where(graph.kinds == SpringKind.BENDING, BENDING_STIFFNESS, STIFFNESS)[:, None]
    lengths = rest[edges[:, 0]] - rest[edges[:, 1]]
    elastic = difference.T @ diags(stiffness[:, 0]) @ difference
    turned, trust = lengths, np.ones(len(seen))
    for outlier in np.geomspace(FIRST_OUTLIER, OUTLIER, ITERATIONS // 2).tolist() + ITERATIONS // 2 * [OUTLIER]:
        system = weights.T @ diags(trust) @ weights + elastic
        pull = weights.T @ (trust[:, None] * seen) + difference.T @ (stiffness * turned)
        nodes = splu(system.tocsc()).solve(pull)
        nodes[:, 2] = np.maximum(nodes[:, 2], floor)
        products = (difference @ nodes)[:, :, None] * (stiffness * lengths)[:, None, :]
        turns = nearest_rotation((touching @ products.reshape(springs, 9)).reshape(count, 3, 3))
        turned = np.einsum("eij,ej->ei", 0.5 * (turns[edges[:, 0]] + turns[edges[:, 1]]), lengths)
        apart = np.linalg.norm(weights @ nodes - seen, axis=1)
        trust = 1.0 / (1.0 + (apart / outlier) ** 2) ** 2
    return np.asarray(nodes, np.float32)
