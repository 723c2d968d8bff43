"""Giving a model the prior: its springs follow a codebook from then on, no step of refinement."""

from dataclasses import replace

import numpy as np

from egophys_core.twin import Codebook, ObjectModel, static_features
from egophys_core.twin.spring_features import STATIC

OUTSIDE = 0.05
"""Share of springs with a feature outside the training range beyond which that is said."""


def with_prior(model: ObjectModel, codebook: Codebook) -> tuple[ObjectModel, tuple[str, ...]]:
    """A model, anchored at its own stiffness, with a codebook; and in which features it is unlike the training set.

    Features outside the training range are asked for at its end.

    Raises:
        TwinError: a feature is not finite.
    """
    return replace(model, codebook=codebook), outside_range(model, codebook)


def outside_range(model: ObjectModel, codebook: Codebook) -> tuple[str, ...]:
    """Of which static features the springs of a model lie outside what a codebook was trained with, as sentences."""
    features = static_features(model.graph)
    low, high = codebook.low[: len(STATIC)], codebook.high[: len(STATIC)]
    outside = ((features < low) | (features > high)).mean(axis=0)
    return tuple(
        f"the stiffness prior was trained with a {name} of {low[index]:.3g} to {high[index]:.3g}; "
        f"{outside[index]:.0%} of these springs lie outside it, as far as "
        f"{_farthest(features[:, index], low[index], high[index]):.3g}"
        for index, name in enumerate(STATIC)
        if outside[index] > OUTSIDE
    )


def _farthest(values: np.ndarray, low: float, high: float) -> float:
    """The value that is farthest outside the range."""
    return float(values[np.argmax(np.maximum(low - values, values - high))])
