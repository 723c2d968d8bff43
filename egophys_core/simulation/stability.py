"""How many substeps a frame needs, from a bound on the fastest mode of a graph."""

import numpy as np
from scipy.sparse import coo_matrix

SAFETY = 0.9
"""Share of the stable step that is used."""

MARGIN = 1.05
"""Power iteration comes to the largest eigenvalue from below; this covers what is left after `ITERATIONS`."""

ITERATIONS = 40

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
    # Symmetric form M^-1/2 L M^-1/2 has the same eigenvalues, and its Rayleigh quotient never overshoots.
    scale = 1.0 / np.sqrt(masses.astype(np.float64))
    vector = scale * (1.0 + np.arange(count) % 7) * np.where(np.arange(count) % 2, -1.0, 1.0)
    value = 0.0
    for _ in range(ITERATIONS):
        vector /= np.linalg.norm(vector)
        scaled = scale * vector
        image = scale * (diagonal * scaled - off @ scaled)
        value = float(vector @ image)
        vector = image
    return MARGIN * value


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
