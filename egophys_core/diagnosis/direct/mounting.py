"""Mounting: what markers say once it is set aside where they, and the clamp, were fixed.

Markers are measured to hundredths of a millimetre, and every record is mounted anew: half a degree at a clamp moves
the tip of a beam by a millimetre, all the time. A twin that is bent to make up for that moves otherwise than the real
thing.
"""

import numpy as np

SHARE = 0.2
"""Share of a marker's mean offset over a record that counts: enough to keep a twin from hanging elsewhere."""


def beside_mounting(means: np.ndarray) -> np.ndarray:
    """Block means [K, B, Q, 3] of offsets with most of each marker's mean over the record taken off; NaN stays."""
    seen = np.isfinite(means)
    total = np.where(seen, means, 0.0).sum(axis=1, keepdims=True)
    return np.asarray(means - (1.0 - SHARE) * total / np.maximum(seen.sum(axis=1, keepdims=True), 1))
