"""The rollout loss of the coarse fit: geometry plus motion discrepancy (paper, coarse-fit objective)."""

import numpy as np

from egophys_core.evaluation import chamfer_per_frame, track_error_per_frame


def rollout_loss(predicted: np.ndarray, surface: np.ndarray, bound: np.ndarray, observed: np.ndarray) -> float:
    """Mean over frames of the one-way Chamfer distance plus the track error, metres.

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
    geometry = chamfer_per_frame(visible, observed)
    motion = track_error_per_frame(visible, observed, bound)
    return float(np.nanmean(geometry) + np.nanmean(motion))
