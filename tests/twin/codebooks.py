"""Codebooks made by hand and at random."""

from collections.abc import Sequence

import numpy as np

from egophys_core.twin import Codebook

FEATURES, LOG_STRETCH = 18, 12


def plain_codebook(*, prototypes: Sequence[Sequence[float]], slope: float) -> Codebook:
    """One hidden unit, `slope` times the log stretch; the first prototype of each bank has its value as its score."""
    banks = np.array(prototypes, np.float32)
    weights = np.zeros((1, FEATURES), np.float32)
    weights[0, LOG_STRETCH] = slope
    heads = np.zeros((*banks.shape, 1), np.float32)
    heads[:, 0] = 1.0
    return Codebook(
        low=np.full(FEATURES, -100.0, np.float32),
        high=np.full(FEATURES, 100.0, np.float32),
        centre=np.zeros(FEATURES, np.float32),
        scale=np.ones(FEATURES, np.float32),
        hidden_weights=weights,
        hidden_bias=np.zeros(1, np.float32),
        head_weights=heads,
        head_bias=np.zeros(banks.shape, np.float32),
        prototypes=banks,
        temperature=np.array([0.5], np.float32),
    )


def random_codebook(prototypes: int = 4, *, units: int = 64, size: float = 0.3, seed: int = 0) -> Codebook:
    """Random weights and limits that some features are beyond."""
    random = np.random.default_rng(seed)
    low = np.array([0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, -0.2, 0, -3, 0, 0, 0], np.float32)
    high = np.array([0.1, 100, 9, 9, 1, 1, 1, 1, 1, 1, 1, 1, 0.2, 0.2, 3, 1, 0.2, 1], np.float32)
    outputs = max(prototypes, 1)

    def normal(*shape: int) -> np.ndarray:
        return random.normal(0.0, 0.4, shape).astype(np.float32)

    return Codebook(
        low=low,
        high=high,
        centre=(low + high) / 2,
        scale=(high - low) / 4,
        hidden_weights=normal(units, FEATURES),
        hidden_bias=normal(units),
        head_weights=normal(2, outputs, units),
        head_bias=normal(2, outputs),
        prototypes=(size / 0.4 * normal(2, prototypes)).reshape(2, prototypes),
        temperature=np.array([0.7], np.float32),
    )
