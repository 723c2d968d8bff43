"""Codebook: how a spring's stiffness follows its place in the graph and how it is deformed (paper, Sec. 3.3)."""

from dataclasses import dataclass, fields

import numpy as np

from egophys_core.errors import TwinError
from egophys_core.twin.spring_features import FEATURES

MOST_OFFSET = 1.4
"""Largest offset of a logarithm of stiffness, either way: a factor of 4, as dense refinement goes."""

MOST_UNITS, MOST_PROTOTYPES = 64, 32
"""Hidden units, and prototypes of a bank, that the simulator has room for."""

BANKS = ("tension", "compression")
"""Prototypes and heads of springs that are longer than at rest, and of those that are shorter."""


@dataclass(frozen=True, kw_only=True)
class Codebook:
    """A small network that gives each spring an offset of the logarithm of its stiffness.

    F features of a spring, each limited to the range of the training set and standardised, go through one layer of H
    rectified units; a head for each bank weighs its K prototypes by a softmax (paper, codebook assignment equation).
    Without prototypes (K = 0) a head has one output, which is the offset itself.
    """

    low: np.ndarray
    """[F] float32, least value of each feature (`spring_features.FEATURES`) that the network is asked with."""
    high: np.ndarray
    """[F] float32, the largest."""
    centre: np.ndarray
    """[F] float32, mean of each feature in the training set."""
    scale: np.ndarray
    """[F] float32, its standard deviation there."""
    hidden_weights: np.ndarray
    """[H, F] float32."""
    hidden_bias: np.ndarray
    """[H] float32."""
    head_weights: np.ndarray
    """[2, max(K, 1), H] float32, by bank (`BANKS`)."""
    head_bias: np.ndarray
    """[2, max(K, 1)] float32."""
    prototypes: np.ndarray
    """[2, K] float32, offsets of the logarithm of stiffness."""
    temperature: np.ndarray
    """[1] float32, of the softmax."""

    def __post_init__(self) -> None:
        hidden = self.hidden_weights.shape[0] if self.hidden_weights.ndim == 2 else 0
        outputs = max(self.prototypes.shape[1], 1) if self.prototypes.ndim == 2 else 0
        features = (len(FEATURES),)
        prototypes = self.prototypes.shape[-1] if self.prototypes.ndim else 0
        for name, shape in (
            # First, as the shapes of others follow from it.
            ("prototypes", (2, prototypes)),
            ("low", features),
            ("high", features),
            ("centre", features),
            ("scale", features),
            ("hidden_weights", (hidden, *features)),
            ("hidden_bias", (hidden,)),
            ("head_weights", (2, outputs, hidden)),
            ("head_bias", (2, outputs)),
            ("temperature", (1,)),
        ):
            array = getattr(self, name)
            if array.shape != shape or 0 in array.shape[:1]:
                raise TwinError(f"codebook: {name} must be {shape}, got {array.shape}")
            if not np.isfinite(array).all():
                raise TwinError(f"codebook: {name} is not finite; the checkpoint is damaged")
        if hidden > MOST_UNITS or self.size > MOST_PROTOTYPES:
            raise TwinError(
                f"codebook: {hidden} hidden units and {self.size} prototypes, at most {MOST_UNITS} and "
                f"{MOST_PROTOTYPES} can be used"
            )
        if not (self.scale > 0).all() or not self.temperature[0] > 0 or not (self.low <= self.high).all():
            raise TwinError("codebook: scale and temperature must be positive, and low at most high")

    @property
    def size(self) -> int:
        """Prototypes of a bank, K."""
        return int(self.prototypes.shape[1])

    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays by name, in a fixed order."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def same_as(self, other: "Codebook | None") -> bool:
        """Whether another gives the same stiffness everywhere."""
        return other is self or (
            other is not None
            and all(np.array_equal(mine, other.arrays()[name]) for name, mine in self.arrays().items())
        )
