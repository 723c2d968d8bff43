"""How many substeps a frame needs, from a bound on the fastest mode of a graph."""

import numpy as np
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import eigsh

SAFETY = 0.9
"""Share of the stable step that is used."""

MARGIN = 1.02
"""The Lanczos method comes to the largest eigenvalue from below; this covers what its tolerance leaves."""

TOLERANCE = 1.0e-3

LARGEST_DENSE = 32
"""Nodes up to which all eigenvalues are computed; the Lanczos method needs a few more than it looks for."""

LONGEST_SUBSTEP = 1.0 / 600.0
"""Seconds. Semi-implicit Euler is of first order: a free fall of t seconds is off by g t dt / 2."""


def largest_eigenvalue(springs: np.ndarray, weights: np.ndarray, masses: np.ndarray) -> float:
    """Largest eigenvalue of M^-1 L, L the graph's Laplacian with a weight per spring.

    With stiffness as weights it bounds the largest omega^2 of the mass-spring system in any configuration with
    springs at rest or stretched, since k d d^T + k (1 - l0/l) (I - d d^T) <= k I there. With dashpots as
    weights it is the largest damping rate.

    Args:
        springs: [E, 2] nodes; a node index >= len(masses) is a controller point, which does not move.
        weights: [E], N/m or N s/m.
        masses: [N], kg.
    """
    if len(springs) == 0 or not weights.any():
        return 0.0
    count = len(masses)
    i, j, weights = springs[:, 0], springs[:, 1], weights.astype(np.float64)
    free = (i < count) & (j < count)
    diagonal = np.bincount(i, weights, minlength=count)[:count] + np.bincount(j, weights, minlength=count)[:count]
    off = coo_matrix((weights[free], (i[free], j[free])), shape=(count, count)).tocsr()
    off = off + off.T
    # The symmetric form M^-1/2 L M^-1/2 has the same eigenvalues.
    scale = 1.0 / np.sqrt(masses.astype(np.float64))
    symmetric = diags(scale) @ (diags(diagonal) - off) @ diags(scale)
    if count <= LARGEST_DENSE:
        return MARGIN * float(np.linalg.eigvalsh(symmetric.toarray())[-1])
    # A fixed start keeps the number of substeps the same in every run. It must not be regular: on a grid a
    # regular vector can be orthogonal to the fastest mode.
    start = np.random.default_rng(0).standard_normal(count)
    return MARGIN * float(eigsh(symmetric, k=1, which="LA", tol=TOLERANCE, v0=start, return_eigenvectors=False)[0])


def stable_substeps(frame_duration: float, stiffness_rate: float, damping_rate: float) -> int:
    """Substeps per frame for which semi-implicit Euler is stable, with margin, and accurate.

    A mode x'' = -omega^2 x - d x' advanced by v += dt (-omega^2 x - d v), x += dt v is stable for
    dt^2 omega^2 + 2 dt d < 4 (Jury's criterion on its two-by-two step matrix).

    Args:
        frame_duration: seconds.
        stiffness_rate: largest omega^2, 1/s^2.
        damping_rate: largest d, 1/s.
    """
    # Inverse of the positive root of dt^2 omega^2 + 2 dt d = 4, written without cancellation.
    fewest_per_second = (damping_rate + np.sqrt(damping_rate**2 + 4.0 * stiffness_rate)) / 4.0
    per_second = max(fewest_per_second / SAFETY, 1.0 / LONGEST_SUBSTEP)
    return int(np.ceil(frame_duration * per_second * (1.0 - 1.0e-9)))
