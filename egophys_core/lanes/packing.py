"""Lanes: the innermost axis of all simulation state, one lane per rollout.

A thread advances the same node of `LANES` rollouts at once. The compiler turns every operation on `Lanes`
into vector instructions, and lanes never mix, so a rollout does not depend on its neighbours
(docs/notes/simulation.md has the measurements behind the width).
"""

import numpy as np
import warp as wp

from egophys_core.lanes import warp_setup as warp_setup

LANES = 8

Lanes = wp.types.vector(length=LANES, dtype=wp.float32)


def group_count(rollouts: int) -> int:
    """Number of lane groups that hold `rollouts` rollouts."""
    return -(-rollouts // LANES)


def pack(values: np.ndarray) -> np.ndarray:
    """[K, ...] per rollout -> [G, ..., LANES] float32; the last group is filled up with its last rollout."""
    groups = group_count(len(values))
    if len(values) != groups * LANES:
        values = values[np.minimum(np.arange(groups * LANES), len(values) - 1)]
    lanes = values.reshape(groups, LANES, *values.shape[1:])
    return np.ascontiguousarray(lanes.transpose(0, *range(2, lanes.ndim), 1), dtype=np.float32)


def unpack(packed: np.ndarray, rollouts: int) -> np.ndarray:
    """Inverse of `pack`: [G, ..., LANES] -> [K, ...]."""
    values = packed.transpose(0, packed.ndim - 1, *range(1, packed.ndim - 1))
    return values.reshape(values.shape[0] * LANES, *values.shape[2:])[:rollouts]
