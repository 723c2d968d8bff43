"""Where a tracked point lies on a twin: between nodes, with weights that move it as they move."""

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

NEIGHBOURS = 6
"""Nodes between which a track lies."""


def track_weights(tracks: np.ndarray, nodes: np.ndarray, surface: np.ndarray) -> csr_matrix:
    """[P, N]: least-norm affine weights of the nearest nodes that give a track's place as nearly as they can.

    Args:
        tracks: [P, 3] metres.
        nodes: [N, 3] metres, where they are when the tracks are seen there.
        surface: [S] indices of the nodes between which tracks may lie.

    Returns:
        Rows sum to 1.
    """
    count = min(NEIGHBOURS, len(surface))
    near = surface[cKDTree(nodes[surface]).query(tracks, k=count)[1].reshape(len(tracks), count)]
    values = np.empty(near.shape)
    for row, (track, around) in enumerate(zip(tracks, nodes[near], strict=True)):
        offsets = around - track
        scale = max(float(np.linalg.norm(offsets, axis=1).mean()), 1e-6)
        # The first equation, that weights sum to 1, counts far more than the others: offsets of a flat or straight
        # patch leave a direction that no weights can reach.
        equations = np.concatenate([np.full((1, count), 1e3), (offsets / scale).T])
        values[row] = np.linalg.lstsq(equations, np.array([1e3, 0, 0, 0]), rcond=1e-5)[0]
        values[row] /= values[row].sum()
    rows = np.repeat(np.arange(len(tracks)), count)
    return csr_matrix((values.ravel(), (rows, near.ravel())), shape=(len(tracks), len(nodes)))
