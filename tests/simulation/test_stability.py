"""The bound on the fastest mode, and the number of substeps that follows from it."""

import numpy as np
import pytest

from egophys_core.errors import SimulationError
from egophys_core.simulation import ContactKind, rollout
from egophys_core.simulation.attachments import Attachments
from egophys_core.simulation.device_arrays import grip_arrays, lanes_array, spring_arrays
from egophys_core.simulation.stability import LONGEST_SUBSTEP, MARGIN, largest_eigenvalues, stable_substeps
from egophys_core.twin import connect
from tests.simulation.scenes import frame_times, idle_controls, moving_controls, scene, sheet_positions


def dense_eigenvalue(springs, weights, masses) -> float:
    """Largest eigenvalue of M^-1 L, from the dense symmetric form; nodes beyond the masses do not move."""
    count = len(masses)
    laplacian = np.zeros((count, count))
    for (i, j), weight in zip(springs, weights, strict=True):
        for one, other in ((i, j), (j, i)):
            if one < count:
                laplacian[one, one] += weight
                if other < count:
                    laplacian[one, other] -= weight
    scale = 1 / np.sqrt(masses)
    return float(np.linalg.eigvalsh(scale[:, None] * laplacian * scale[None])[-1])


def bound_of(springs, weights, masses) -> float:
    """The bound for springs of which those to nodes beyond the masses are controller springs."""
    springs = np.asarray(springs, np.int32).reshape(-1, 2)
    weights, masses = np.asarray(weights, np.float32), np.asarray(masses, np.float32)
    own = springs[:, 1] < len(masses)
    controllers = max(1, int(springs.max(initial=0)) - len(masses) + 1)
    times = frame_times(0.1, 1 / 30)
    batch = scene(
        np.zeros((len(masses), 3)),
        moving_controls(times, np.zeros((len(times), controllers, 3))),
        springs=springs[own],
        rest_lengths=np.ones(own.sum()),
    )
    held = Attachments(
        nodes=springs[~own, 0],
        controllers=springs[~own, 1] - len(masses),
        rest_lengths=np.ones((~own).sum(), np.float32),
        kinds=np.full((~own).sum(), ContactKind.HOLD, np.uint8),
    )
    # The rows are in order of their first node; pairs are given in that order.
    rows, (grips, _) = spring_arrays(batch, "cpu"), grip_arrays(batch, [held], "cpu")
    rows.damping = lanes_array(weights[own][None], "cpu")
    grips.damping = lanes_array(weights[~own][None], "cpu")
    return float(largest_eigenvalues(rows, grips, lanes_array(masses[None], "cpu"), 1, damping=True)[0])


def assert_close_upper_bound(springs, weights, masses):
    exact = dense_eigenvalue(springs, weights, masses)
    bound = bound_of(springs, weights, masses)
    assert exact * (1 - 1e-6) <= bound <= 1.10 * exact


@pytest.mark.parametrize("seed", range(30))
def test_bound_is_above_the_fastest_mode_and_within_a_tenth(seed):
    generator = np.random.default_rng(seed)
    nodes = int(generator.integers(2, 60))
    held = int(generator.integers(0, 4))
    pairs = [(i, j) for i in range(nodes) for j in range(i + 1, nodes + held) if generator.random() < 0.3]
    pairs = pairs or [(0, 1)]
    weights = 10 ** generator.uniform(0, 3, len(pairs))
    masses = generator.uniform(0.5, 2.0, nodes) * 1e-3
    assert_close_upper_bound(pairs, weights, masses.astype(np.float32))


@pytest.mark.parametrize("side", [5, 12, 14, 18])
@pytest.mark.parametrize("reach", [1.0, 1.5, 2.3])
def test_bound_holds_on_grids(side, reach):
    positions = sheet_positions(side, 0.02).astype(np.float64)
    springs = connect(positions, radius=reach * 0.021, max_neighbours=20)
    assert_close_upper_bound(springs, np.full(len(springs), 30.0), np.full(side * side, 1e-3, np.float32))


@pytest.mark.parametrize("nodes", [2, 3, 40, 300])
def test_bound_holds_on_chains_and_stars(nodes):
    masses = np.full(nodes, 1e-3, np.float32)
    assert_close_upper_bound([(i, i + 1) for i in range(nodes - 1)], np.full(nodes - 1, 5.0), masses)
    assert_close_upper_bound([(0, i) for i in range(1, nodes)], np.full(nodes - 1, 5.0), masses)


def test_one_spring_between_equal_masses_has_two_k_over_m():
    value = bound_of([[0, 1]], [3.0], [0.5, 0.5])
    assert value == pytest.approx(MARGIN * 2 * 3.0 / 0.5, rel=1e-6)


def test_no_springs_have_no_rate():
    assert bound_of(np.zeros((0, 2), int), [], np.ones(3)) == 0.0
    assert bound_of([[0, 1]], [0.0], np.ones(2)) == 0.0


@pytest.mark.parametrize("stiffness_rate", [0.0, 1e3, 1e5, 1e7])
@pytest.mark.parametrize("damping_rate", [0.0, 1.0, 300.0, 1e5])
def test_substeps_keep_the_step_matrix_from_growing(stiffness_rate, damping_rate):
    # [x, v] -> [x + dt v', v'], v' = v - dt (omega^2 x + d v): all eigenvalues within the unit circle.
    duration = 1 / 30
    substeps = stable_substeps(duration, stiffness_rate, damping_rate)
    dt = duration / substeps
    assert dt <= LONGEST_SUBSTEP * (1 + 1e-9)
    row = np.array([-dt * stiffness_rate, 1 - dt * damping_rate])
    growth = np.abs(np.linalg.eigvals(np.array([np.array([1.0, 0.0]) + dt * row, row])))
    assert growth.max() <= 1 + 1e-9


def test_substeps_are_not_many_more_than_stability_needs():
    stiffness_rate, damping_rate = 1e7, 2e3
    dt = 1 / 30 / stable_substeps(1 / 30, stiffness_rate, damping_rate) / 0.85
    assert dt**2 * stiffness_rate + 2 * dt * damping_rate > 4


@pytest.mark.parametrize(("stiffness", "damping"), [(3e4, 0.0), (3e4, 5.0), (10.0, 20.0)])
def test_stiff_and_strongly_damped_objects_stay_bounded(stiffness, damping):
    positions = sheet_positions(5)
    springs = connect(positions.astype(np.float64), radius=0.08, max_neighbours=8)
    generator = np.random.default_rng(1)
    batch = scene(
        positions,
        idle_controls(frame_times(1.0, 1 / 30)),
        springs=springs,
        stiffness=stiffness,
        damping=damping,
        rest_lengths=np.linalg.norm(positions[springs[:, 0]] - positions[springs[:, 1]], axis=1),
        mass=0.004,
        velocities=generator.normal(0, 0.1, positions.shape),
    )
    result = rollout(batch)
    result.raise_on_failure()
    assert result.substeps[0] > 20
    speed = np.linalg.norm(batch.velocities[0], axis=1)
    assert np.abs(result.velocities).max() < 2 * np.sqrt((speed**2).sum())


def test_stiff_hold_counts_in_the_number_of_substeps():
    times = frame_times(0.2, 1 / 30)
    hold = np.arange(len(times))[:, None] >= 3
    batch = scene(
        [[0, 0, 0]], moving_controls(times, np.zeros((len(times), 3)), hold), mass=1e-3, controller_stiffness=1e4
    )
    # omega^2 = k / m = 1e7 asks for dt below 2 / omega.
    least = (1 / 30) / (2 / np.sqrt(1e7))
    assert least < rollout(batch).substeps[0] < 1.3 * least


def test_longest_substep_is_the_callers_choice_where_stability_allows_it():
    # A free fall of t seconds is off by g t dt / 2.
    batch = scene([[0, 0, 1.0]], idle_controls(frame_times(0.5, 1 / 30)), gravity=9.81)
    exact = 1.0 - 9.81 * 0.5**2 / 2
    for substeps in (5, 40):
        result = rollout(batch, longest_substep=1 / 30 / substeps)
        assert result.substeps.tolist() == [substeps]
        error = result.positions[0, -1, 0, 2] - exact
        assert error == pytest.approx(-9.81 * 0.5 / 30 / substeps / 2, abs=1e-5)
    stiff = scene(
        [[0, 0, 0], [0.1, 0, 0]],
        idle_controls(frame_times(0.1, 1 / 30)),
        springs=[(0, 1)],
        stiffness=1e4,
        rest_lengths=[0.1],
        mass=1e-3,
    )
    assert rollout(stiff, longest_substep=1.0).substeps == rollout(stiff).substeps > 20


def test_object_too_stiff_to_simulate_is_refused_with_its_numbers():
    batch = scene(
        [[0, 0, 0], [0.1, 0, 0]],
        idle_controls(frame_times(0.1, 1 / 30)),
        springs=[(0, 1)],
        stiffness=1e12,
        rest_lengths=[0.1],
        mass=1e-3,
    )
    with pytest.raises(SimulationError, match=r"rollout 0 needs \d+ substeps a second, at most 500000"):
        rollout(batch)
