"""The rollout loss of the coarse fit: geometry plus motion discrepancy (paper, coarse-fit objective)."""

import numpy as np

from egophys_core.evaluation import chamfer_per_frame, track_error_per_frame

TAIL_SHARE = 0.25
"""Share of the frames, the last ones, that counts twice.

The twin is to predict what comes after the fitted frames. Among candidates of nearly equal loss the error on the
last frames tells the held-out error (correlation 0.43), the error on all frames does not (docs/notes/coarse_fit.md).
"""


def rollout_loss(predicted: np.ndarray, surface: np.ndarray, bound: np.ndarray, observed: np.ndarray) -> float:
    """One-way Chamfer distance plus track error, metres: mean of that over all frames and over the last ones.

    Args:
        predicted: [F, V, 3] metres, nodes.
        surface: [V] bool, nodes that can be seen.
        bound: [N] surface node of each track, -1 for none.
        observed: [F, N, 3] metres, NaN where unseen.

    Returns:
        Infinity if the prediction is not finite.
    """
    visible = predicted[:, surface]
    if not np.isfinite(visible).all():
        return float("inf")
    tail = int((1.0 - TAIL_SHARE) * len(visible))
    errors = (chamfer_per_frame(visible, observed), track_error_per_frame(visible, observed, bound))
    return float(sum(np.nanmean(error) + np.nanmean(error[tail:]) for error in errors) / 2)
