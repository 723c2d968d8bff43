"""The stiffness of springs by a codebook, slowly, in float64."""

import numpy as np

from egophys_core.twin import Codebook

FARTHEST = 1.4


def dynamic_of(
    positions: np.ndarray,
    velocities: np.ndarray,
    held: np.ndarray,
    springs: np.ndarray,
    rest_lengths: np.ndarray,
    contact_height: float,
) -> np.ndarray:
    """[E, 6] dynamic features of one state [N, 3], spring by spring."""
    rows = []
    for (i, j), rest in zip(springs, rest_lengths, strict=True):
        along, relative = positions[j] - positions[i], velocities[j] - velocities[i]
        length = np.linalg.norm(along)
        direction = along / length
        rows.append(
            [
                np.log(length / rest),
                abs(length / rest - 1.0),
                relative @ direction / rest,
                abs(direction[2]),
                (positions[i, 2] + positions[j, 2]) / 2.0 - contact_height,
                float(held[i] or held[j]),
            ]
        )
    return np.array(rows)


def factors(codebook: Codebook, static: np.ndarray, dynamic: np.ndarray) -> np.ndarray:
    """[E] by how much springs with these features are stiffer than their anchors."""
    found = []
    for features in np.concatenate([static, dynamic], axis=1).astype(np.float64):
        standard = (np.clip(features, codebook.low, codebook.high) - codebook.centre) / codebook.scale
        units = np.maximum(codebook.hidden_weights.astype(np.float64) @ standard + codebook.hidden_bias, 0.0)
        bank = 0 if features[static.shape[1]] >= 0.0 else 1
        scores = codebook.head_weights[bank].astype(np.float64) @ units + codebook.head_bias[bank]
        if codebook.size:
            weights = np.exp(scores / codebook.temperature[0])
            offset = weights @ codebook.prototypes[bank] / weights.sum()
        else:
            offset = scores[0]
        found.append(np.exp(np.clip(offset, -FARTHEST, FARTHEST)))
    return np.array(found)
