"""Innovations: what is new in each block of time, given the one before.

Where a twin folds otherwise than the real thing, it stays off for seconds. Counted as they are, such offsets drown
what moves; as an autoregressive process of first order, each error is counted once, when it comes.
"""

import numpy as np

PERSISTENCE = 0.8
"""Correlation of a patch's mean offset with that of the block before, as twins without an effect leave it."""


def innovations(means: np.ndarray) -> np.ndarray:
    """Block means [K, B, Q, 3] with what each patch's last seen block leads to expect taken off, and the same spread.

    Where nothing came before, the mean itself; NaN where a block is not seen, in none of the K rows.
    Source: Prais & Winsten, Trend Estimators and Serial Correlation (1954).
    """
    seen = np.isfinite(means).all(axis=3).any(axis=0)
    found = np.full_like(means, np.nan)
    for patch in range(seen.shape[1]):
        blocks = np.flatnonzero(seen[:, patch])
        found[:, blocks[:1], patch] = means[:, blocks[:1], patch]
        share = PERSISTENCE ** np.diff(blocks)[:, None]
        left = means[:, blocks[1:], patch] - share * means[:, blocks[:-1], patch]
        found[:, blocks[1:], patch] = left / np.sqrt(1.0 - share**2)
    return found
