"""Laws that hold whatever the object: free fall, drag, momentum, energy, order of the method."""

import numpy as np
import pytest

from egophys_core.simulation import rollout
from tests.simulation.scenes import frame_times, idle_controls, scene

G = 9.81
FLOAT32 = 1e-5
"""Metres: what rounding adds over some thousand steps of lengths around 1 m."""


def fall(dt: float, duration: float = 0.5) -> float:
    """Height after falling freely from z = 1 m."""
    batch = scene([[0, 0, 1.0]], idle_controls(frame_times(duration, dt)), gravity=G)
    result = rollout(batch)
    assert result.substeps.tolist() == [1]
    return float(result.positions[0, -1, 0, 2])


@pytest.mark.parametrize("dt", [1 / 600, 1 / 1500])
def test_free_fall_follows_the_parabola(dt):
    # z(t) = z0 - g t^2 / 2; semi-implicit Euler falls g t dt / 2 too far.
    duration = 0.5
    parabola = 1.0 - G * duration**2 / 2
    assert fall(dt) - parabola == pytest.approx(-G * duration * dt / 2, abs=FLOAT32)


def test_error_halves_with_the_time_step():
    exact = 1.0 - G * 0.5**2 / 2
    assert (fall(1 / 600) - exact) / (fall(1 / 1200) - exact) == pytest.approx(2.0, rel=0.01)


def test_frames_are_cut_into_substeps_of_at_most_a_600th_of_a_second():
    batch = scene([[0, 0, 1.0]], idle_controls(frame_times(0.5, 1 / 30)), gravity=G)
    result = rollout(batch)
    assert result.substeps.tolist() == [20]
    assert result.positions[0, -1, 0, 2] == pytest.approx(fall(1 / 600), abs=FLOAT32)


def test_drag_decays_the_velocity_of_any_mass_exponentially():
    # v' = -d v, v(t) = v0 exp(-d t); explicit in v, so the error is v0 d^2 t dt exp(-d t) / 2 to first order.
    drag, speed, duration, dt = 2.0, 0.5, 1.0, 1 / 600
    for mass in (0.01, 3.0):
        batch = scene(
            [[0, 0, 0]],
            idle_controls(frame_times(duration, dt)),
            drag=drag,
            mass=mass,
            velocities=[[speed, 0, 0]],
        )
        exact = speed * np.exp(-drag * duration)
        assert rollout(batch).velocities[0, 0, 0] == pytest.approx(exact, abs=exact * drag**2 * duration * dt)


def tangle(generator: np.random.Generator, nodes: int = 12):
    """Springs between random nodes, stretched and compressed, with random velocities."""
    positions = generator.uniform(-0.1, 0.1, (nodes, 3))
    pairs = np.array([(i, j) for i in range(nodes) for j in range(i + 1, nodes) if generator.random() < 0.4])
    lengths = np.linalg.norm(positions[pairs[:, 0]] - positions[pairs[:, 1]], axis=1)
    return positions, pairs, lengths * generator.uniform(0.8, 1.2, len(pairs))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("damping", [0.0, 0.05])
def test_momentum_is_conserved_without_external_force(seed, damping):
    # Sum over nodes of m v stays: spring and dashpot forces come in opposite pairs.
    generator = np.random.default_rng(seed)
    positions, pairs, rest_lengths = tangle(generator)
    velocities = generator.normal(0, 0.3, positions.shape) + [0.2, -0.1, 0.3]
    batch = scene(
        positions,
        idle_controls(frame_times(1.0, 1 / 30)),
        springs=pairs,
        stiffness=20.0,
        damping=damping,
        rest_lengths=rest_lengths,
        mass=0.01,
        velocities=velocities,
    )
    result = rollout(batch)
    assert np.abs(result.positions[0, -1] - positions).max() > 0.1
    total = batch.velocities[0].astype(np.float64).sum(axis=0)
    drift = result.velocities[0].astype(np.float64).sum(axis=0) - total
    assert np.linalg.norm(drift) < 1e-5 * np.linalg.norm(total)


def test_energy_of_a_damped_object_does_not_grow():
    # E = sum m v^2 / 2 + sum k (l - l0)^2 / 2, and with one substep a frame v_n = (x_n - x_n-1) / dt exactly.
    # Symplectic Euler keeps an energy that differs from E by a share of about omega dt / 2: E ripples by that much.
    stiffness, mass, dt = 5.0, 0.05, 1 / 2400
    positions, pairs, rest_lengths = tangle(np.random.default_rng(7))
    batch = scene(
        positions,
        idle_controls(frame_times(1.5, dt)),
        springs=pairs,
        stiffness=stiffness,
        damping=0.05,
        rest_lengths=rest_lengths,
        mass=mass,
    )
    result = rollout(batch)
    assert result.substeps.tolist() == [1]
    x = result.positions[0].astype(np.float64)
    kinetic = 0.5 * mass * (np.diff(x, axis=0) ** 2).sum(axis=(1, 2)) / dt**2
    lengths = np.linalg.norm(x[1:, pairs[:, 0]] - x[1:, pairs[:, 1]], axis=2)
    energy = kinetic + 0.5 * stiffness * ((lengths - rest_lengths) ** 2).sum(axis=1)
    fastest = np.sqrt(2 * np.bincount(pairs.ravel()).max() * stiffness / mass)
    ripple = 0.5 * fastest * dt * np.maximum.accumulate(energy[::-1])[::-1]
    assert (np.maximum.accumulate(energy[::-1])[::-1][1:] <= energy[:-1] + ripple[:-1]).all()
    assert energy[-1] < 0.5 * energy[0]
    assert kinetic[-1] < 0.02 * kinetic.max()


def test_a_scene_in_balance_stays_where_it_is_to_the_bit():
    positions = np.array([[0, 0, 0], [0.25, 0, 0]])
    batch = scene(positions, idle_controls(frame_times(1.0, 1 / 30)), springs=[(0, 1)], rest_lengths=[0.25])
    assert (rollout(batch).positions == positions.astype(np.float32)).all()
