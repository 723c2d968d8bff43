"""A rod that bends: against Euler and Bernoulli's beam, alone and in pieces of unequal lengths."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.errors import SimulationError
from egophys_core.kinds import node_masses
from egophys_core.simulation import ContactKind, Controls, RolloutBatch, batch_of_models, rollout
from egophys_core.simulation.gradients import differentiate
from egophys_core.simulation.terms.rod_bending import rod_bending
from egophys_core.twin import ObjectModel, SpringGraph, chain
from tests.simulation.scenes import FAR_BELOW, frame_times, parameters
from tests.simulation.substep_path import advance_by_launches

LENGTH, MASS = 0.5, 0.02
"""Metres beyond the clamp; kg of all, the clamped piece as well."""

RIGIDITY = 0.01
"""N m^2."""

FIRST_MODE = 1.8751
"""Root of cos(x) cosh(x) = -1: of a beam clamped at one end (Rao, Mechanical Vibrations, sec. 8.5)."""

PIECE = LENGTH / 20
EVEN = PIECE * np.arange(-1, 21)
UNEVEN = np.concatenate([EVEN[:5], np.linspace(EVEN[4], EVEN[15], 15)[1:], EVEN[16:]])
"""Metres along the rod of its nodes, the first two of which are clamped."""


def rod(arc_lengths: np.ndarray, **changes: float) -> ObjectModel:
    """Along x, with what is clamped in front of the origin."""
    lengths = np.diff(arc_lengths)
    positions = np.stack([arc_lengths, *np.zeros((2, len(arc_lengths)))], axis=1).astype(np.float32)
    stiffness = (200.0 / lengths).astype(np.float32)
    return ObjectModel(
        kind="rod",
        graph=SpringGraph(
            positions=positions,
            springs=chain(len(arc_lengths)),
            kinds=np.zeros(len(lengths), np.uint8),
            rest_lengths=lengths.astype(np.float32),
            surface=np.ones(len(arc_lengths), bool),
        ),
        parameters=parameters(
            total_mass=MASS,
            flexural_rigidity=RIGIDITY,
            controller_stiffness=1e5,
            controller_radius=1e-3,
            controller_neighbours=1,
            **changes,
        ),
        stiffness=stiffness,
    )


def clamp(arc_lengths: np.ndarray, times: np.ndarray) -> Controls:
    """The first two nodes held where they are."""
    held = np.zeros((len(times), 2, 3), np.float32)
    held[:, :, 0] = arc_lengths[:2]
    contact = np.full(held.shape[:2], ContactKind.HOLD, np.uint8)
    return Controls(times=times, positions=held, contact=contact)


def thrown(model: ObjectModel, controls: Controls, start: np.ndarray, velocities: np.ndarray) -> RolloutBatch:
    """One rollout that begins with velocities [N, 3], m/s."""
    batch = batch_of_models([model], [controls], starts=[start], ground_height=FAR_BELOW)
    return replace(batch, velocities=velocities[None].astype(np.float32))


def first_mode(arc_lengths: np.ndarray) -> tuple[np.ndarray, float]:
    """[N] the shape of the first mode, 1 at the tip, and its rate in rad/s.

    At the clamp's inner node the rod turns over half a piece on either side, so it bends from half a piece before on.
    """
    length = LENGTH + PIECE / 2
    at = FIRST_MODE * np.clip(arc_lengths + PIECE / 2, 0.0, None) / length
    at[:2] = 0.0
    ratio = (np.cosh(FIRST_MODE) + np.cos(FIRST_MODE)) / (np.sinh(FIRST_MODE) + np.sin(FIRST_MODE))
    shape = np.cosh(at) - np.cos(at) - ratio * (np.sinh(at) - np.sin(at))
    per_length = MASS / np.ptp(arc_lengths)
    return shape / shape[-1], float((FIRST_MODE / length) ** 2 * np.sqrt(RIGIDITY / per_length))


@pytest.mark.parametrize("arc_lengths", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("retardation_time", [0.0, 0.01])
def test_first_mode_of_a_cantilever_swings_and_fades_as_a_beam(
    arc_lengths: np.ndarray, retardation_time: float
) -> None:
    """y = v / w' exp(-b t) sin(w' t), b = time w^2 / 2: a beam of Kelvin and Voigt's material."""
    shape, rate = first_mode(arc_lengths)
    times = frame_times(2 * np.pi / rate, 0.005)
    model = rod(arc_lengths, retardation_time=retardation_time)
    velocities = np.outer(0.05 * shape, [0.0, 0.0, 1.0])
    result = rollout(thrown(model, clamp(arc_lengths, times), model.graph.positions, velocities))
    fading = retardation_time * rate**2 / 2
    damped = np.sqrt(rate**2 - fading**2)
    expected = 0.05 / damped * np.exp(-fading * times) * np.sin(damped * times)
    assert np.abs(result.positions[0, :, -1, 2] - expected).max() < 0.02 * np.abs(expected).max()


def test_what_is_bent_and_carried_round_is_not_damped() -> None:
    """An arc that turns in its plane as one piece, with a damping that would stop it within a frame."""
    angles = np.linspace(0.0, 1.0, 41)
    arc = 0.5 * np.stack([np.sin(angles), np.cos(angles), np.zeros(41)], axis=1)
    spin = 1.0
    model = rod(0.5 * angles)
    weak = replace(model, parameters=replace(model.parameters, flexural_rigidity=1e-9, retardation_time=1e4))
    times = frame_times(0.05, 0.01)
    controls = Controls(
        times=times,
        positions=np.full((len(times), 1, 3), 9.0, np.float32),
        contact=np.zeros((len(times), 1), np.uint8),
    )
    result = rollout(thrown(weak, controls, arc, spin * np.cross([0.0, 0.0, 1.0], arc)))
    expected = spin * np.cross([0.0, 0.0, 1.0], result.positions[0, -1])
    # Nothing but the springs' pull bends it as it goes: of second order in the time.
    assert np.abs(result.velocities[0] - expected).max() < 0.06 * spin * 0.5


def test_kernels_of_a_substep_do_what_the_kernel_of_a_frame_does() -> None:
    shape, _ = first_mode(UNEVEN)
    times = frame_times(0.02, 0.01)
    velocities = np.outer(shape, [0.0, 0.3, 1.0])
    model = rod(UNEVEN, retardation_time=0.01)
    batch = thrown(model, clamp(UNEVEN, times), model.graph.positions, velocities)
    assert np.array_equal(rollout(batch).positions, advance_by_launches(batch)[0])


def test_rates_bound_the_substeps_of_a_rod_of_equal_pieces() -> None:
    """16 EI / (h^3 m) is the largest omega^2 of a long chain of pieces of length h and nodes of mass m."""
    pieces = np.full((1, 60), 0.01)
    stiff = parameters(flexural_rigidity=1e-3, retardation_time=0.02)
    rods = rod_bending([stiff], pieces, np.full((1, 61), 1e-3), np.eye(3)[:1], np.array([False]), np.zeros((1, 61, 2)))
    fastest = 16 * 1e-3 / (0.01**3 * 1e-3)
    assert rods.rates == pytest.approx(np.array([[fastest, 0.02 * fastest]]), rel=0.02)


def test_rods_are_refused_where_derivatives_are_asked_for() -> None:
    batch = thrown(rod(EVEN), clamp(EVEN, frame_times(0.02, 0.01)), rod(EVEN).graph.positions, np.zeros((22, 3)))
    with pytest.raises(SimulationError, match="rods have no derivatives"):
        differentiate(batch, lambda positions: (np.zeros(len(positions)), np.zeros_like(positions)))


def test_nodes_weigh_as_much_as_their_length() -> None:
    masses = node_masses(rod(UNEVEN))
    assert masses.sum() == pytest.approx(MASS, rel=1e-6)
    assert masses[10] / masses[2] == pytest.approx((UNEVEN[11] - UNEVEN[9]) / (UNEVEN[3] - UNEVEN[1]), rel=1e-5)
