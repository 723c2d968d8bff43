"""How many substeps a frame needs, from a bound on the fastest mode of a graph."""

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from egophys_core.lanes import Lanes, unpack
from egophys_core.simulation.power_iteration import iterate_power
from egophys_core.simulation.terms.springs import SpringArrays

SAFETY = 0.9
"""Share of the stable step that is used."""

ITERATIONS = 60
MARGIN = 1.05
"""Power iteration comes to the largest eigenvalue from below; after `ITERATIONS` this covers what is missing."""

LONGEST_SUBSTEP = 1.0 / 600.0
"""Seconds. Semi-implicit Euler is of first order: a free fall of t seconds is off by g t dt / 2."""


def largest_eigenvalues(
    springs: SpringArrays, grips: SpringArrays, masses: wp.array, rollouts: int, *, damping: bool
) -> np.ndarray:
    """[K] largest eigenvalue of M^-1 L, 1/s^2, or with `damping` 1/s; L is the graph's Laplacian.

    With stiffness as weights it bounds the largest omega^2 of the mass-spring system in any configuration with
    springs at rest or stretched, since k d d^T + k (1 - l0/l) (I - d d^T) <= k I there. With dashpots as
    weights it is the largest damping rate.

    Args:
        masses: [G, N] kg, `Lanes`.
        rollouts: K.
    """
    groups, nodes = masses.shape
    # A fixed start keeps the number of substeps the same in every run. It must not be regular: on a grid a
    # regular vector can be orthogonal to the fastest mode.
    start = np.random.default_rng(0).standard_normal(nodes).astype(np.float32)
    scale = 1.0 / np.sqrt((masses.numpy() * start[:, None] ** 2).sum(axis=1, keepdims=True))
    vector = wp.array(np.ascontiguousarray(start[:, None] * scale, np.float32), dtype=Lanes, device=masses.device)
    product = wp.zeros((groups, nodes), dtype=Lanes, device=masses.device)
    largest = wp.zeros(groups, dtype=Lanes, device=masses.device)
    wp.launch(
        iterate_power,
        dim=groups,
        inputs=[ITERATIONS, damping, springs, grips, masses, vector, product, largest],
        device=masses.device,
    )
    return MARGIN * unpack(largest.numpy(), rollouts).astype(np.float64)


def stable_substeps(
    frame_duration: ArrayLike,
    stiffness_rate: ArrayLike,
    damping_rate: ArrayLike,
    *,
    longest_substep: float = LONGEST_SUBSTEP,
) -> np.ndarray:
    """[K] int substeps per frame for which semi-implicit Euler is stable, with margin, and accurate.

    A mode x'' = -omega^2 x - d x' advanced by v += dt (-omega^2 x - d v), x += dt v is stable for
    dt^2 omega^2 + 2 dt d < 4 (Jury's criterion on its two-by-two step matrix).

    Args:
        frame_duration: [K] or one for all, seconds.
        stiffness_rate: [K] largest omega^2, 1/s^2.
        damping_rate: [K] largest d, 1/s.
        longest_substep: seconds, for accuracy.
    """
    # Inverse of the positive root of dt^2 omega^2 + 2 dt d = 4, written without cancellation.
    damping = np.asarray(damping_rate, np.float64)
    fewest_per_second = (damping + np.sqrt(damping**2 + 4.0 * np.asarray(stiffness_rate))) / 4.0
    per_second = np.maximum(fewest_per_second / SAFETY, 1.0 / longest_substep)
    return np.ceil(frame_duration * per_second * (1.0 - 1.0e-9)).astype(int)
