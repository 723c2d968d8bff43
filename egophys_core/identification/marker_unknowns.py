"""What is unknown of an object that is seen at a few markers, and the model that such numbers make of its body."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import TypeVar

import numpy as np

from egophys_core.kinds.rods import axial_stiffness
from egophys_core.kinds.template import stiffness_of_modulus
from egophys_core.observation.markers import MarkerBody, turned
from egophys_core.simulation import longest_retardation
from egophys_core.twin import GRAVITY, ObjectKind, ObjectModel, PhysicalParameters, per_kind

FloatOrArray = TypeVar("FloatOrArray", float, np.ndarray)

MODULI = np.geomspace(3e3, 1e7, 32)
"""Young's moduli in Pa, from a sponge to rubber, at which the sag is looked at."""

BENDING_LENGTHS = np.geomspace(0.02, 0.6, 24)
"""(EI / weight per length)^(1/3) over the length of a rod, from a chain to a bar, at which the sag is looked at."""

SWING_GONE = 20.0
"""1/s, a drag that leaves a sag and no swing."""

SOME_DRAG = 1.0
"""1/s, first guess."""

DRAGS_OF_A_ROD = (0.0, SOME_DRAG, 3.0, SWING_GONE)
"""1/s, at which a rod's sag is looked at: hands move it, and without a swing it would follow them otherwise. With 1 and
20 alone a cable that met a drag was taken for one 10 times as stiff, and one of early hands for 65 times."""

GRIP = 5.0
"""Stiffness with which a clamped node is held over that of a spring; more asks for more substeps."""

GRIP_RADIUS = 0.3
"""Of a clamped point, in cells: it holds its own node."""

DAMPING_S = 1e-5
"""Seconds, first guess of dashpot over spring. Dashpots act on all relative motion, so a slender body's turning too."""

DAMPING_RATIO = 0.02
"""First guess of how a rod's first mode between two clamps is damped."""

NATURAL_TURN = 0.1
"""Rad by which a rod turns from one end to the other by nature: first step."""

FIRST_MODE = 22.4
"""Rate in rad/s of that mode, of a rod of 1 m and 1 m^4/s^2 (Rao, Mechanical Vibrations, sec. 8.5)."""


@dataclass(frozen=True, kw_only=True)
class Unknowns:
    """Numbers [D] that are searched: logarithms of stiffness and of damping, a drag (1/s), and what else there is."""

    steps: np.ndarray
    """[D] first steps of a refinement."""
    sags: np.ndarray
    """[K, D] from where to look for a sag."""
    low: np.ndarray
    """[D] least numbers."""
    swing: np.ndarray
    """[D] first guess of what swings; NaN where the sag tells it."""
    model: Callable[[np.ndarray], tuple[MarkerBody, ObjectModel]]
    """From numbers [D] to the body, placed as they say, and its model."""

    def about(self, numbers: np.ndarray, stiffer: np.ndarray) -> np.ndarray:
        """[K, D] first guesses of the swing, of stiffnesses [K] times that of some numbers [D]."""
        around = np.tile(np.where(np.isnan(self.swing), numbers, self.swing), (len(stiffer), 1))
        around[:, 0] += np.log(stiffer)
        return around


def unknowns_of(body: MarkerBody, known: int, density: float) -> Unknowns:
    """What is unknown of a body with so many recorded points, kg/m^3."""
    return rod_unknowns(body, density) if body.kind == ObjectKind.ROD else lattice_unknowns(body, known, density)


def lattice_unknowns(body: MarkerBody, known: int, density: float) -> Unknowns:
    """One stiffness over node mass, 1/s^2, and dashpot over stiffness, s; and the pitch and yaw of its clamp, rad."""
    node_mass = density * body.spacing**3
    rates = np.log(stiffness_of_modulus(MODULI, body.spacing) / node_mass)

    def model(numbers: np.ndarray) -> tuple[MarkerBody, ObjectModel]:
        rate, time, drag, pitch, yaw = (float(number) for number in numbers)
        placed = turned(body, known, pitch=pitch, yaw=yaw)
        stiffness = float(np.exp(rate)) * node_mass
        damping = float(np.exp(time)) * stiffness
        return placed, marker_model(placed, density=density, stiffness=stiffness, damping=damping, drag=drag)

    return Unknowns(
        steps=np.array([0.05, 0.7, 1.0, 0.005, 0.005]),
        low=np.array([-np.inf, -np.inf, 0.0, -np.inf, -np.inf]),
        sags=np.array([[rate, np.log(DAMPING_S), SWING_GONE, 0.0, 0.0] for rate in rates]),
        swing=np.array([np.nan, np.log(DAMPING_S), SOME_DRAG, 0.0, 0.0]),
        model=model,
    )


def rod_unknowns(body: MarkerBody, density: float) -> Unknowns:
    """Flexural rigidity over mass per length, m^4/s^2, and damping ratio of the first mode between two clamps; and how
    the rod is bent by nature, 1/m to its level left and up.

    How a rod points is told by the curve that it is seen on. If hands move it, it swings whatever its drag is.
    """
    rigidities = np.log(rigidity_of(BENDING_LENGTHS * body.length))

    def model(numbers: np.ndarray) -> tuple[MarkerBody, ObjectModel]:
        rigidity, ratio = (float(number) for number in np.exp(numbers[:2]))
        time = retardation_of(rigidity, body.length, ratio)
        drag, level, up = (float(number) for number in numbers[2:])
        rod = rod_model(body, density=density, rigidity=rigidity, retardation_time=time, drag=drag)
        return body, replace(rod, parameters=replace(rod.parameters, natural_bend_level=level, natural_bend_up=up))

    return Unknowns(
        steps=np.array([0.1, 0.7, 0.3, *[NATURAL_TURN / body.length] * 2]),
        low=np.array([-np.inf, -np.inf, 0.0, -np.inf, -np.inf]),
        sags=np.array(
            [[each, np.log(DAMPING_RATIO), drag, 0.0, 0.0] for drag, each in product(DRAGS_OF_A_ROD, rigidities)]
        ),
        swing=np.full(5, np.nan),
        model=model,
    )


def rigidity_of(bending_length: FloatOrArray) -> FloatOrArray:
    """Flexural rigidity over mass per length, m^4/s^2, of a rod that bends under its weight over a length in metres."""
    return GRAVITY * bending_length**3


def retardation_of(rigidity: float, length: float, ratio: float) -> float:
    """Seconds, the retardation time at which a rod's first mode between two clamps has a damping ratio.

    Args:
        rigidity: flexural rigidity over mass per length, m^4/s^2.
        length: metres.
    """
    return 2.0 * ratio / (FIRST_MODE * np.sqrt(rigidity) / length**2)


def marker_model(body: MarkerBody, *, density: float, stiffness: float, damping: float, drag: float) -> ObjectModel:
    """The model of a lattice with one stiffness, N/m, one dashpot, N s/m, and a drag, 1/s; clamped as stiffly."""
    return ObjectModel(
        kind=ObjectKind.SOLID,
        graph=body.graph,
        parameters=_parameters(body, density=density, stiffness=stiffness, damping=damping, drag=drag),
        stiffness=per_kind(body.graph, stiffness, 1.0),
    )


def rod_model(
    body: MarkerBody, *, density: float, rigidity: float, retardation_time: float, drag: float
) -> ObjectModel:
    """The model of a rod with a flexural rigidity over mass per length, m^4/s^2, and a drag, 1/s.

    Args:
        retardation_time: seconds, taken to be as long as can be afforded at most.
    """
    lengths = body.graph.rest_lengths.astype(np.float64)
    per_length = density * body.volume / lengths.sum()
    axial = axial_stiffness(per_length, body.length)
    model = ObjectModel(
        kind=ObjectKind.ROD,
        graph=body.graph,
        parameters=_parameters(body, density=density, stiffness=axial / body.spacing, damping=0.0, drag=drag),
        stiffness=(axial / lengths).astype(np.float32),
    )
    return with_bending(model, rigidity=rigidity, retardation_time=retardation_time)


def with_bending(model: ObjectModel, *, rigidity: float, retardation_time: float) -> ObjectModel:
    """A rod that bends otherwise.

    Args:
        rigidity: flexural rigidity over mass per length, m^4/s^2.
        retardation_time: seconds, taken to be as long as can be afforded at most.
    """
    lengths = model.graph.rest_lengths.astype(np.float64)
    flexural = rigidity * model.parameters.total_mass / lengths.sum()
    time = min(retardation_time, longest_retardation(flexural, lengths, model.node_masses))
    return replace(model, parameters=replace(model.parameters, flexural_rigidity=flexural, retardation_time=time))


def _parameters(
    body: MarkerBody, *, density: float, stiffness: float, damping: float, drag: float
) -> PhysicalParameters:
    """Of springs of one stiffness, N/m, and dashpot, N s/m, and of clamps, each point of which holds its own node."""
    return PhysicalParameters(
        total_mass=density * body.volume,
        stiffness=stiffness,
        damping=damping,
        drag=drag,
        strain_limit=1e6,
        controller_stiffness=GRIP * stiffness,
        controller_radius=GRIP_RADIUS * body.spacing,
        controller_neighbours=1,
    )
