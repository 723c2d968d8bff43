"""Springs and dashpots against the closed forms of one and two masses."""

import numpy as np
import pytest
from scipy.optimize import brentq

from egophys_core.simulation import rollout
from tests.simulation.scenes import frame_times, idle_controls, moving_controls, scene

G = 9.81


def extension(dt: float, duration: float, *, stiffness: float, damping: float, mass: float, start: float) -> np.ndarray:
    """[F] metres: extension of a spring of rest length 0.5 m between two equal masses, let go stretched."""
    batch = scene(
        [[0, 0, 0], [0.3 * (0.5 + start), 0.4 * (0.5 + start), np.sqrt(0.75) * (0.5 + start)]],
        idle_controls(frame_times(duration, dt)),
        springs=[(0, 1)],
        stiffness=stiffness,
        damping=damping,
        rest_lengths=[0.5],
        mass=mass,
    )
    result = rollout(batch)
    assert result.substeps.tolist() == [1]
    x = result.positions[0].astype(np.float64)
    return np.linalg.norm(x[:, 1] - x[:, 0], axis=1) - 0.5


def test_undamped_spring_swings_at_its_frequency():
    # Reduced mass m / 2: x(t) = A cos(omega t), omega = sqrt(2 k / m). Semi-implicit Euler is of first order in
    # position (half a step of phase, A omega dt / 2) and of second in frequency (omega^3 dt^2 t / 24).
    stiffness, mass, amplitude, dt, duration = 40.0, 0.2, 0.05, 1 / 2000, 1.5
    omega = np.sqrt(2 * stiffness / mass)
    times = frame_times(duration, dt)
    moved = extension(dt, duration, stiffness=stiffness, damping=0.0, mass=mass, start=amplitude)
    tolerance = amplitude * (omega * dt / 2 + omega**3 * dt**2 * duration / 24) + 1e-5
    assert tolerance < 0.02 * amplitude
    assert np.abs(moved - amplitude * np.cos(omega * times)).max() < tolerance


def zero_crossings(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Times at which a sampled curve passes 0, between samples on a straight line."""
    at = np.flatnonzero(values[:-1] * values[1:] < 0)
    return times[at] - values[at] * (times[at + 1] - times[at]) / (values[at + 1] - values[at])


@pytest.mark.parametrize(("stiffness", "mass"), [(40.0, 0.2), (5.0, 0.2), (300.0, 1.0)])
def test_frequency_of_a_spring_is_right_to_a_thousandth(stiffness, mass):
    # Half a period between crossings, pi / sqrt(2 k / m), with steps of 1/600 s: semi-implicit Euler is off by
    # (omega dt)^2 / 24, here at most 7e-5.
    duration = 5.0
    times = frame_times(duration, 1 / 600)
    moved = extension(1 / 600, duration, stiffness=stiffness, damping=0.0, mass=mass, start=0.05)
    crossings = zero_crossings(times, moved)
    half_period = (crossings[-1] - crossings[0]) / (len(crossings) - 1)
    assert half_period == pytest.approx(np.pi / np.sqrt(2 * stiffness / mass), rel=1e-3)


@pytest.mark.parametrize(("stiffness", "damping", "mass"), [(40.0, 0.3, 0.2), (40.0, 0.05, 0.2), (300.0, 2.0, 1.0)])
def test_decay_of_a_damped_spring_is_right_to_a_hundredth(stiffness, damping, mass):
    # Peaks half a period apart shrink by exp(-gamma / m T / 2) each, T / 2 = pi / sqrt(2 k / m - (gamma / m)^2). With
    # steps of 1/600 s the rate itself is off by about gamma dt / m, up to 0.4 %.
    rate = damping / mass
    omega = np.sqrt(2 * stiffness / mass - rate**2)
    moved = np.abs(extension(1 / 600, 2.0, stiffness=stiffness, damping=damping, mass=mass, start=0.05))
    inner = moved[1:-1]
    peaks = inner[(inner > moved[:-2]) & (inner >= moved[2:])]
    swings = min(len(peaks), 1 + int(1.5 * omega / np.pi))
    measured = -np.log(peaks[swings - 1] / peaks[0]) / (swings - 1) / (np.pi / omega)
    assert measured == pytest.approx(rate, rel=1e-2)


def damped_closed_form(times, *, stiffness, damping, mass, start):
    """x'' = -(2 k / m) x - (2 gamma / m) x', x(0) = A, x'(0) = 0."""
    rate, omega0 = damping / mass, np.sqrt(2 * stiffness / mass)
    omega = np.sqrt(omega0**2 - rate**2)
    return start * np.exp(-rate * times) * (np.cos(omega * times) + rate / omega * np.sin(omega * times))


def test_damped_spring_decays_at_its_rate():
    scene_of = {"stiffness": 40.0, "damping": 0.3, "mass": 0.2, "start": 0.05}
    dt, duration = 1 / 2000, 1.5
    exact = damped_closed_form(frame_times(duration, dt), **scene_of)
    omega = np.sqrt(2 * scene_of["stiffness"] / scene_of["mass"])
    assert np.abs(extension(dt, duration, **scene_of) - exact).max() < scene_of["start"] * omega * dt


def test_error_of_a_damped_spring_halves_with_the_time_step():
    scene_of = {"stiffness": 40.0, "damping": 0.3, "mass": 0.2, "start": 0.05}
    errors = []
    for dt in (1 / 750, 1 / 1500):
        exact = damped_closed_form(frame_times(0.6, dt), **scene_of)
        errors.append(np.abs(extension(dt, 0.6, **scene_of) - exact).max())
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.15)


def test_dashpot_brings_nodes_to_their_common_velocity():
    # The dashpot acts on the whole relative velocity: v1 - v2 decays as exp(-2 gamma t / m), sideways too.
    damping, mass, duration, dt = 0.3, 0.2, 0.5, 1 / 2400
    batch = scene(
        [[0, 0, 0], [10.0, 0, 0]],
        idle_controls(frame_times(duration, dt)),
        springs=[(0, 1)],
        stiffness=1e-6,
        damping=damping,
        rest_lengths=[10.0],
        mass=mass,
        velocities=[[0, 0.1, 0.4], [0, 0.3, 0]],
    )
    velocities = rollout(batch).velocities[0]
    rate = 2 * damping / mass
    decayed = np.exp(-rate * duration)
    assert velocities.mean(axis=0) == pytest.approx([0, 0.2, 0.2], abs=1e-5)
    tolerance = 0.4 * decayed * rate**2 * duration * dt
    assert velocities[0] - velocities[1] == pytest.approx(np.array([0, -0.2, 0.4]) * decayed, abs=tolerance)


def test_hanging_mass_comes_to_rest_where_weight_and_spring_balance():
    # k (l - l0) = m g: a node held from above sinks by m g / k.
    mass, stiffness = 0.05, 20.0
    times = frame_times(3.0, 1 / 60)
    batch = scene(
        [[0, 0, 0.3]],
        moving_controls(times, np.tile([0, 0, 0.32], (len(times), 1))),
        mass=mass,
        damping=0.3,
        controller_stiffness=stiffness,
        gravity=G,
    )
    result = rollout(batch)
    assert result.positions[0, -1, 0] == pytest.approx([0, 0, 0.3 - mass * G / stiffness], abs=1e-5)
    assert np.abs(result.velocities).max() < 1e-4


def test_each_spring_of_a_hanging_chain_carries_what_hangs_below_it():
    # Node i of n from the top: k (l_i - l0) = (n - i) m g.
    count, mass, stiffness, length = 4, 0.02, 30.0, 0.1
    times = frame_times(4.0, 1 / 60)
    heights = 1.0 - length * np.arange(count)
    batch = scene(
        np.stack([np.zeros(count), np.zeros(count), heights], axis=1),
        moving_controls(times, np.tile([0, 0, 1.01], (len(times), 1))),
        springs=[(i, i + 1) for i in range(count - 1)],
        stiffness=stiffness,
        rest_lengths=[length] * (count - 1),
        mass=mass,
        damping=1.0,
        controller_stiffness=stiffness,
        controller_neighbours=1,
        gravity=G,
    )
    z = rollout(batch).positions[0, -1, :, 2]
    below = np.arange(count, 0, -1) * mass * G / stiffness
    assert 1.0 - z[0] == pytest.approx(below[0], abs=1e-4)
    assert -np.diff(z) - length == pytest.approx(below[1:], abs=1e-4)


def test_chain_between_two_hands_hangs_as_a_catenary():
    # y = a cosh((x - x0) / a) + c through the ends, with the chain's length: sinh(w / 2 a) = sqrt(L^2 - h^2) / 2 a.
    # Nodes of a chain of links l lie on it but for l^2 / 8 a, the sagitta of a link, and its stretch.
    count, link, mass, stiffness = 25, 0.04, 0.001, 400.0
    times = frame_times(6.0, 1 / 30)
    arc = np.linspace(0, np.pi, count)
    start = np.stack([-0.3 * np.cos(arc), 0 * arc, 0.5 - 0.35 * np.sin(arc) + 0.03 * arc], axis=1)
    hands = np.tile(start[[0, -1]] + [[-0.001, 0, 0], [0.001, 0, 0]], (len(times), 1, 1))
    batch = scene(
        start,
        moving_controls(times, hands),
        springs=[(i, i + 1) for i in range(count - 1)],
        stiffness=stiffness,
        damping=0.05,
        rest_lengths=[link] * (count - 1),
        mass=mass,
        drag=4.0,
        controller_stiffness=stiffness,
        controller_neighbours=1,
        gravity=G,
    )
    result = rollout(batch)
    assert np.abs(result.velocities).max() < 1e-3
    chain = result.positions[0, -1].astype(np.float64)
    links = np.linalg.norm(np.diff(chain, axis=0), axis=1)
    assert links == pytest.approx(link, rel=0.01)
    x, z = chain[:, 0], chain[:, 2]
    width, rise = x[-1] - x[0], z[-1] - z[0]
    straight = np.sqrt(links.sum() ** 2 - rise**2)
    a = brentq(lambda a: 2 * a * np.sinh(width / (2 * a)) - straight, 0.02, 10.0)
    x0 = (x[0] + x[-1]) / 2 - a * np.arcsinh(rise / (2 * a * np.sinh(width / (2 * a))))
    catenary = a * (np.cosh((x - x0) / a) - np.cosh((x[0] - x0) / a)) + z[0]
    assert np.ptp(z) > 0.3
    assert np.abs(z - catenary).max() < link**2 / (8 * a)


@pytest.mark.parametrize("length", [0.4, 1.0, 1.2, 1.3, 2.0, 5.0])
def test_pull_of_a_structural_spring_is_capped_at_the_strain_limit(length):
    # One substep from rest: m v / dt = k min(l - l0, eps l0); compression is not softened.
    stiffness, limit, mass, dt = 7.0, 0.3, 0.5, 1 / 1000
    batch = scene(
        [[0, 0, 0], [length, 0, 0]],
        idle_controls(np.array([0.0, dt])),
        springs=[(0, 1)],
        stiffness=stiffness,
        rest_lengths=[1.0],
        mass=mass,
        strain_limit=limit,
    )
    velocities = rollout(batch).velocities[0]
    force = stiffness * min(length - 1.0, limit * 1.0)
    assert velocities[0] == pytest.approx([dt * force / mass, 0, 0], rel=1e-4, abs=1e-7)
    assert (velocities[1] == -velocities[0]).all()


@pytest.mark.parametrize(("length", "share"), [(0.4, 0.25), (0.9, 0.25), (1.2, 1.0)])
def test_a_pressed_spring_has_a_share_of_its_stiffness(length, share):
    stiffness, mass, dt = 7.0, 0.5, 1 / 1000
    batch = scene(
        [[0, 0, 0], [length, 0, 0]],
        idle_controls(np.array([0.0, dt])),
        springs=[(0, 1)],
        stiffness=stiffness,
        rest_lengths=[1.0],
        mass=mass,
        compression_ratio=0.25,
    )
    velocities = rollout(batch).velocities[0]
    assert velocities[0] == pytest.approx([dt * share * stiffness * (length - 1.0) / mass, 0, 0], rel=1e-4, abs=1e-7)
    assert (velocities[1] == -velocities[0]).all()


def test_controller_springs_never_soften():
    # From rest length 0.01 m to 1.01 m, far beyond the limit: m dv / dt = k * 1 m.
    stiffness, mass, dt = 7.0, 0.5, 1 / 1000
    times = np.array([0.0, dt, 2 * dt])
    path = [[0.01, 0, 0], [1.01, 0, 0], [1.01, 0, 0]]
    batch = scene(
        [[0, 0, 0]], moving_controls(times, path), mass=mass, strain_limit=0.1, controller_stiffness=stiffness
    )
    # In the first frame the controller has not moved yet when forces are gathered, in the second it has.
    assert rollout(batch).velocities[0, 0] == pytest.approx([dt * stiffness * 1.0 / mass, 0, 0], rel=1e-3)


def test_nodes_at_one_place_push_each_other_nowhere():
    batch = scene(
        [[0, 0, 0], [0, 0, 0]],
        idle_controls(frame_times(0.1, 1 / 30)),
        springs=[(0, 1)],
        stiffness=10.0,
        rest_lengths=[0.1],
    )
    assert (rollout(batch).positions == 0).all()
