"""The codebook in torch, to be trained: the same features and stiffness as in the simulator, with derivatives."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import torch

from egophys_core.simulation.terms.springs import SHORTEST_LENGTH
from egophys_core.twin import Codebook
from egophys_core.twin.codebook import MOST_OFFSET
from egophys_core.twin.spring_features import FEATURES, STATIC

HIDDEN = 64
TEMPERATURE = 0.7
"""Of the softmax (paper, App. B.3)."""

FIRST_HEADS = 0.1
"""Of their usual size: an offset that means nothing makes rollouts worse from the start."""

FIRST_PROTOTYPES = 0.5
"""Prototypes begin evenly spread over offsets up to this, either way."""


class Form(StrEnum):
    """What is learned; all but the first are ablations (paper, Table 3)."""

    CODEBOOK = "codebook"
    STATIC = "static"
    """Without dynamic features and with one bank: the same stiffness in every state."""
    DIRECT = "direct"
    """Without prototypes: heads say the offset themselves."""


@dataclass(frozen=True, kw_only=True)
class FeatureRange:
    """How the features of a training set are spread; all [F]."""

    low: np.ndarray
    high: np.ndarray
    centre: np.ndarray
    scale: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Assigned:
    """What a network says of the springs of some states."""

    offset: torch.Tensor
    """[R, E] offset of the logarithm of stiffness."""
    shares: torch.Tensor | None
    """[R, E, K] weights of the prototypes; None where there are none."""


def dynamic_features(
    positions: torch.Tensor,
    velocities: torch.Tensor,
    held: torch.Tensor,
    *,
    springs: torch.Tensor,
    rest_lengths: torch.Tensor,
    contact_height: float,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Features [R, E, 6] (`DYNAMIC`) of states [R, N, 3], and which springs are at least as long as at rest [R, E].

    Args:
        held: [R, N] 1 for nodes that a hand holds.
        springs: [E, 2] nodes.
        rest_lengths: [E] metres.
        contact_height: z at which a node touches the table, metres.
    """
    first, second = springs.T
    along = positions[:, second] - positions[:, first]
    length = along.norm(dim=2).clamp_min(SHORTEST_LENGTH)
    ratio = length / rest_lengths
    approach = (along * (velocities[:, second] - velocities[:, first])).sum(dim=2)
    height = 0.5 * (positions[:, first, 2] + positions[:, second, 2]) - contact_height
    features = torch.stack(
        [
            ratio.log(),
            (ratio - 1.0).abs(),
            approach / (length * rest_lengths),
            along[:, :, 2].abs() / length,
            height,
            torch.maximum(held[:, first], held[:, second]),
        ],
        dim=2,
    )
    return features, ratio >= 1.0


class StiffnessNetwork(torch.nn.Module):
    """Features of springs to offsets of their logarithms of stiffness."""

    low: torch.Tensor
    high: torch.Tensor
    centre: torch.Tensor
    scale: torch.Tensor

    def __init__(self, form: Form, prototypes: int, spread: FeatureRange, *, seed: int) -> None:
        """Begin where every offset is nearly 0.

        Args:
            prototypes: K of a bank; without meaning for `Form.DIRECT`.
        """
        super().__init__()
        self.form = form
        generator = torch.Generator().manual_seed(seed)
        for name in ("low", "high", "centre", "scale"):
            self.register_buffer(name, torch.tensor(getattr(spread, name), dtype=torch.float32))
        outputs = 1 if form is Form.DIRECT else prototypes
        banks = 1 if form is Form.STATIC else 2

        def weights(*shape: int) -> torch.nn.Parameter:
            return torch.nn.Parameter(torch.randn(shape, generator=generator) / shape[-1] ** 0.5)

        self.hidden_weights = weights(HIDDEN, len(FEATURES))
        self.hidden_bias = torch.nn.Parameter(torch.zeros(HIDDEN))
        self.head_weights = weights(banks, outputs, HIDDEN)
        self.head_bias = torch.nn.Parameter(torch.zeros(banks, outputs))
        spaced = torch.linspace(-FIRST_PROTOTYPES, FIRST_PROTOTYPES, prototypes).repeat(banks, 1)
        self.prototypes = torch.nn.Parameter(torch.zeros(banks, 0) if form is Form.DIRECT else spaced)
        # So that prototypes begin with nearly equal shares, whose mean is 0.
        self.head_weights.data *= FIRST_HEADS

    def forward(self, static: torch.Tensor, dynamic: torch.Tensor, stretched: torch.Tensor) -> Assigned:
        """Offsets of springs with features [E, S] and [R, E, 6], of which some are stretched [R, E]."""
        count = len(STATIC)
        if self.form is Form.STATIC:
            dynamic = self.centre[count:].expand_as(dynamic)
        features = torch.cat([static.expand(len(dynamic), -1, -1), dynamic], dim=2)
        standard = (torch.clamp(features, self.low, self.high) - self.centre) / self.scale
        units = torch.relu(standard @ self.hidden_weights.T + self.hidden_bias)
        scores = torch.einsum("reh,boh->breo", units, self.head_weights) + self.head_bias[:, None, None]
        # The static form has one bank for both.
        score = torch.where(stretched[..., None], scores[0], scores[-1])
        if self.form is Form.DIRECT:
            return Assigned(offset=_limited(score[..., 0]), shares=None)
        shares = torch.softmax(score / TEMPERATURE, dim=-1)
        bank = torch.where(stretched[..., None], self.prototypes[0], self.prototypes[-1])
        return Assigned(offset=_limited((shares * bank).sum(dim=-1)), shares=shares)

    def codebook(self) -> Codebook:
        """What the simulator asks."""
        both = [2, *[1] * 2]

        def array(values: torch.Tensor) -> np.ndarray:
            return values.detach().numpy().astype(np.float32).copy()

        def of_banks(values: torch.Tensor) -> np.ndarray:
            return array(values if len(values) == 2 else values.repeat(both[: values.dim()]))

        hidden = array(self.hidden_weights)
        bias = array(self.hidden_bias)
        if self.form is Form.STATIC:
            # The centre of dynamic features, standardised, is 0.
            hidden[:, len(STATIC) :] = 0.0
        return Codebook(
            low=array(self.low),
            high=array(self.high),
            centre=array(self.centre),
            scale=array(self.scale),
            hidden_weights=hidden,
            hidden_bias=bias,
            head_weights=of_banks(self.head_weights),
            head_bias=of_banks(self.head_bias),
            prototypes=of_banks(self.prototypes),
            temperature=np.array([TEMPERATURE], np.float32),
        )


def _limited(offset: torch.Tensor) -> torch.Tensor:
    return torch.clamp(offset, -MOST_OFFSET, MOST_OFFSET)
