"""Injected material laws: extra tensions along the edges of the mesh, some with a memory."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from egophys_core.errors import OptionsError
from egophys_core.rehearsal.bodies import SoftBody
from egophys_core.rehearsal.state import ForceTerm, StepState

LARGEST_STRAIN = 0.25
"""Strain beyond which a law goes on as at this strain: it keeps a cubic law within what the step can follow."""

LARGEST_PLASTIC_STRAIN = 0.3
"""A rest length changes by this share at most."""


@dataclass(frozen=True, kw_only=True)
class Edges:
    """The edges of a mesh. Their share of the material makes them springs of a comparable stiffness."""

    ends: np.ndarray
    """[E, 2] vertex indices."""
    lengths: np.ndarray
    """[E] metres, unstrained."""
    directions: np.ndarray
    """[E, 3] unit vectors, unstrained."""
    stretch_stiffness: np.ndarray
    """[E] N: EA, Young's modulus times an edge's share of the volume over its length."""
    dimensions: int
    """In which the edges point: 2 of a sheet, 3 of a solid."""

    def mean_cosine(self, power: int) -> float:
        """Mean over all directions of an even power of the cosine with one of them.

        Edges of stiffness EA, pulled along one direction by a strain e that each takes up as e cos^2, resist as
        E e mean_cosine(4) would. Parameters are over the material's modulus E, so laws of edges are over this.
        """
        if self.dimensions == 3:
            return 1.0 / (power + 1.0)
        return float(np.prod([(odd - 1.0) / odd for odd in range(2, power + 1, 2)]))


Law = Callable[[np.ndarray, float], np.ndarray]
"""From strains [E] and the step's duration in seconds to tensions over EA, [E]."""


def make_edges(body: SoftBody, ends: np.ndarray) -> Edges:
    """The edges `ends` [E, 2] of a body's elements."""
    spans = body.vertices[ends[:, 1]] - body.vertices[ends[:, 0]]
    lengths = np.linalg.norm(spans, axis=1)
    corners = body.vertices[body.elements]
    sides = corners[:, 1:] - corners[:, :1]
    if body.is_sheet:
        volumes = 0.5 * body.thickness * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    else:
        volumes = np.abs(np.linalg.det(sides)) / 6.0
    first, second = np.triu_indices(body.elements.shape[1], 1)
    pairs = np.sort(np.stack([body.elements[:, first], body.elements[:, second]], axis=-1), axis=-1)
    count = len(body.vertices)
    of_each = np.repeat(volumes * body.stiffness_shares / len(first), len(first))
    shares = np.bincount((pairs[..., 0] * count + pairs[..., 1]).ravel(), of_each, count * count)
    keys = np.sort(ends, axis=1)
    share = shares[keys[:, 0] * count + keys[:, 1]]
    return Edges(
        ends=ends,
        lengths=lengths,
        directions=spans / lengths[:, None],
        stretch_stiffness=body.young * share / lengths,
        dimensions=2 if body.is_sheet else 3,
    )


def edge_tensions(edges: Edges, laws: list[Law], vertices: int) -> ForceTerm:
    """The force of several laws on a mesh of so many vertices."""
    index = np.arange(len(edges.lengths))
    rows = np.concatenate([edges.ends[:, 0], edges.ends[:, 1]])
    signs = np.repeat([1.0, -1.0], len(index))
    gather = csr_array((signs, (rows, np.concatenate([index, index]))), shape=(vertices, len(index)))

    def add(state: StepState, forces: np.ndarray) -> None:
        spans = state.positions[edges.ends[:, 1]] - state.positions[edges.ends[:, 0]]
        lengths = np.linalg.norm(spans, axis=1)
        strains = np.clip(lengths / edges.lengths - 1.0, -LARGEST_STRAIN, LARGEST_STRAIN)
        tensions = edges.stretch_stiffness * sum(law(strains, state.duration) for law in laws)
        forces += gather @ ((tensions / np.maximum(lengths, 1e-9))[:, None] * spans)

    return add


def strain_stiffening(values: Mapping[str, float], edges: Edges) -> Law:
    """The cubic term of a stress-strain curve, in tension and in compression."""
    coefficient = values["coefficient"] / edges.mean_cosine(8)
    return lambda strains, duration: coefficient * strains**3


def tension_compression_asymmetry(values: Mapping[str, float], edges: Edges) -> Law:
    """Edges that act in compression only, or, where compression shall be softer, in tension only.

    The material is then stiffer than without in tension, and `change` is relative to that.

    Raises:
        OptionsError: nothing would resist compression.
    """
    change = values["change"]
    if change <= -1.0:
        raise OptionsError(f"tension_compression_asymmetry: change must be above -1, got {change}")
    share = edges.mean_cosine(4)
    if change >= 0.0:
        return lambda strains, duration: change / share * np.minimum(strains, 0.0)
    return lambda strains, duration: -change / (1.0 + change) / share * np.maximum(strains, 0.0)


def anisotropy(values: Mapping[str, float], edges: Edges) -> Law:
    """Fibres in one horizontal direction, which is the stiffest: tensions of ratio EA strain cos^4 of the angle to it.

    They make the modulus E (1 + ratio (a + b cos 2 angle)) but for a small cos 4 angle, angle from the fibres: its mean
    and swing come from those of cos^4(t) cos^4(t - angle) over all directions t.

    Raises:
        OptionsError: more than fibres can do.
    """
    a, b = (9.0 / 64.0, 1.0 / 8.0) if edges.dimensions == 2 else (2.0 / 35.0, 16.0 / 315.0)
    swing, angle = np.hypot(values["cosine"], values["sine"]), 0.5 * np.arctan2(values["sine"], values["cosine"])
    if a * swing >= b:
        raise OptionsError(f"anisotropy: cosine and sine must be smaller than {b / a:.2f} together, got {swing:.2f}")
    fibre = np.array([np.cos(angle), np.sin(angle), 0.0])
    share = swing / (b - a * swing) * (edges.directions @ fibre) ** 4
    return lambda strains, duration: share * strains


def viscoelasticity(values: Mapping[str, float], edges: Edges) -> Law:
    """A spring and a dashpot in series, integrated exactly over a step of constant strain rate (Maxwell)."""
    ratio = values["ratio"] / edges.mean_cosine(4)
    tension = np.zeros(len(edges.lengths))
    changes = _changes()

    def law(strains: np.ndarray, duration: float) -> np.ndarray:
        nonlocal tension
        change = changes(strains)
        decay = np.exp(-duration / values["time"])
        tension = decay * tension + ratio * change * (1.0 - decay) * values["time"] / duration
        return tension

    return law


def hysteresis(values: Mapping[str, float], edges: Edges) -> Law:
    """Bouc-Wen with n = 1 and beta = gamma = 1/2 (Wen 1976): |z| stays within 1."""
    strength = values["strength"] / edges.mean_cosine(4)
    z = np.zeros(len(edges.lengths))
    changes = _changes()

    def law(strains: np.ndarray, duration: float) -> np.ndarray:
        nonlocal z
        change = changes(strains)
        z = np.clip(z + (1.0 - np.abs(z) * 0.5 * (np.sign(z * change) + 1.0)) * change / values["strain"], -1.0, 1.0)
        return strength * values["strain"] * z

    return law


def _changes() -> Callable[[np.ndarray], np.ndarray]:
    """What tells how strains [E] have changed since it was last asked; not at all at first."""
    last: np.ndarray | None = None

    def change(strains: np.ndarray) -> np.ndarray:
        nonlocal last
        before, last = strains if last is None else last, strains
        return strains - before

    return change


def plasticity(values: Mapping[str, float], edges: Edges, rest_lengths: np.ndarray) -> ForceTerm:
    """No force: it moves the engine's `rest_lengths` [E] (overstress flow, Perzyna 1966)."""

    def add(state: StepState, forces: np.ndarray) -> None:
        lengths = np.linalg.norm(state.positions[edges.ends[:, 1]] - state.positions[edges.ends[:, 0]], axis=1)
        strains = lengths / rest_lengths - 1.0
        excess = np.sign(strains) * np.maximum(np.abs(strains) - values["yield_strain"], 0.0)
        flowed = rest_lengths * (1.0 + excess * state.duration * values["flow"])
        rest_lengths[:] = np.clip(
            flowed, (1.0 - LARGEST_PLASTIC_STRAIN) * edges.lengths, (1.0 + LARGEST_PLASTIC_STRAIN) * edges.lengths
        )

    return add
