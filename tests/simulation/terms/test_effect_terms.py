"""Forces that are composed into the simulator: against closed forms, alone and together, on every path of the code."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.errors import SimulationError
from egophys_core.simulation import RolloutBatch, rollout
from egophys_core.simulation.effect_arrays import effect_terms, first_columns
from egophys_core.simulation.step import frame_kernel
from egophys_core.simulation.substep import forces_kernel
from egophys_core.simulation.terms.effects import EffectTerms
from tests.reference.simulator import simulate
from tests.simulation.effect_terms import GUST, TETHER, add_gust, add_tether, extra_force, gust_and_tether, of_toy
from tests.simulation.gradient_scenes import in_the_air
from tests.simulation.scenes import frame_times, idle_controls, scene
from tests.simulation.substep_path import advance_by_launches

DT = 1 / 600


def free_nodes(times: np.ndarray, *, mass: float = 1.0, velocity=(0.0, 0.0, 0.0)) -> RolloutBatch:
    """Two nodes 0.1 m from the origin, without springs."""
    return scene([[0.1, 0, 0], [0, 0.1, 0]], idle_controls(times), mass=mass, velocities=[velocity] * 2)


def of_rollouts(batch: RolloutBatch, gusts, tethers) -> RolloutBatch:
    """As many equal rollouts as there are rows of numbers, with both effects."""
    return replace(batch.rows(np.zeros(len(gusts), int)), effects=gust_and_tether(gusts, tethers))


NO_GUST, NO_TETHER = [0.0, 0, 0, 0], [0.0, 0]
G, T = (GUST.name, add_gust), (TETHER.name, add_tether)


def test_force_that_depends_on_time_acts_as_long_as_it_should_with_the_numbers_of_each_rollout():
    # a = j t until T: v = j T^2 / 2, x = j T^3 / 6 + v (t - T), each off by at most one substep of j T.
    duration, ends = 0.5, np.array([0.2, 0.4, 9.0])
    jerks = np.array([[2.0, 0, 0], [0, -4.0, 1.0], [1.0, 1.0, 1.0]])
    batch = of_rollouts(free_nodes(frame_times(duration, 1 / 30)), np.column_stack([jerks, ends]), [NO_TETHER] * 3)
    result = rollout(batch)
    for row, (jerk, end) in enumerate(zip(jerks, np.minimum(ends, duration), strict=True)):
        speed = jerk * end**2 / 2
        displacement = jerk * end**3 / 6 + speed * (duration - end)
        tolerance = np.abs(jerk).max() * end * DT
        assert result.velocities[row] == pytest.approx(np.tile(speed, (2, 1)), abs=tolerance)
        moved = result.positions[row, -1] - result.positions[row, 0]
        assert moved == pytest.approx(np.tile(displacement, (2, 1)), abs=tolerance * duration)


def test_force_that_depends_on_position_and_velocity_swings_each_rollout_at_its_own_rate():
    # m x'' = -k x - c x', from rest: x0 exp(-b t) (cos w t + b / w sin w t), b = c / 2 m, w^2 = k / m - b^2.
    mass, times = 0.5, frame_times(0.6, DT)
    tethers = np.array([[20.0, 0.0], [30.0, 1.0], [50.0, 2.0]])
    batch = of_rollouts(free_nodes(times, mass=mass), [NO_GUST] * 3, tethers)
    positions = rollout(batch).positions
    for row, (stiffness, damping) in enumerate(tethers):
        rate = damping / (2 * mass)
        omega = np.sqrt(stiffness / mass - rate**2)
        oscillation = 0.1 * np.exp(-rate * times) * (np.cos(omega * times) + rate / omega * np.sin(omega * times))
        assert np.abs(positions[row, :, 0, 0] - oscillation).max() < 0.1 * omega * DT
        assert np.abs(positions[row, :, 1, 1] - oscillation).max() < 0.1 * omega * DT


def test_time_is_counted_from_the_start_of_the_rollout():
    # Frames of 1/64 s, which floating point has exactly also 1024 s later.
    times = np.arange(20) / 64
    gust = [[1.0, 0, 0, 0.2]]
    early, late = (rollout(of_rollouts(free_nodes(at), gust, [NO_TETHER])) for at in (times, times + 1024))
    assert np.array_equal(early.positions, late.positions)
    assert np.abs(early.velocities).max() > 0.01


@pytest.mark.parametrize("numbers", [([40.0, -60, 20, 0.0475], [1.5, 0.05]), ([90.0, 0, 0, 1.0], [0.0, 0.2])])
def test_two_effects_with_everything_else_agree_with_the_reference(numbers):
    batch = of_rollouts(in_the_air(), *([each] for each in numbers))
    result = rollout(batch)
    exact = simulate(batch, 0, substeps=[6, 12, 6, 12, 15], extra=extra_force(batch, 0))
    assert np.abs(result.positions[0] - exact).max() < 2e-6
    assert np.abs(rollout(in_the_air()).positions[0] - exact).max() > 1e-3


def test_each_effect_reads_its_numbers_from_its_own_column():
    batch = in_the_air(effects=True)
    assert first_columns(batch) == {GUST.name: 0, TETHER.name: 4}
    swapped = replace(batch, effects=batch.effects[::-1])
    assert first_columns(swapped) == {TETHER.name: 0, GUST.name: 2}
    # The sum of forces is rounded in another order.
    assert np.abs(rollout(batch).positions - rollout(swapped).positions).max() < 1e-6


def test_kernels_of_a_substep_do_what_the_kernel_of_a_frame_does():
    gusts, tethers = [[9.0, 9, 9, 0.04], [1.0, 0, 0, 1], [0.0] * 4], [[1.0, 0.1], [0.5, 0], [3.0, 0.2]]
    batch = of_rollouts(in_the_air(), gusts, tethers)
    assert np.array_equal(rollout(batch).positions, advance_by_launches(batch)[0])


def test_a_lane_group_skips_the_effects_that_none_of_its_rollouts_has():
    """Whatever numbers these would read."""
    gusts, tethers = np.tile([[9.0, 9, 9, 0.04]], (16, 1)), np.tile([[1.0, 0.1]], (16, 1))
    batch = of_rollouts(in_the_air(), gusts, tethers)
    only_first = np.arange(16) < 8
    absent = replace(batch, effects=(replace(batch.effects[0], present=only_first), batch.effects[1]))
    tethered = of_rollouts(in_the_air(), 0 * gusts[:1], tethers[:1])
    found = advance_by_launches(absent)[0]
    assert np.array_equal(found[:8], advance_by_launches(batch)[0][:8])
    assert np.array_equal(found[8:], np.repeat(rollout(tethered).positions, 8, axis=0))


def test_batch_without_effects_runs_the_kernel_without_them():
    assert effect_terms(in_the_air()) is None
    with_effects = effect_terms(in_the_air(effects=True))
    assert [name for name, _ in with_effects.forces] == [GUST.name, TETHER.name]
    assert frame_kernel(with_effects) is frame_kernel(effect_terms(in_the_air(effects=True)))
    assert frame_kernel(with_effects) is not frame_kernel(None)


def test_each_choice_of_functions_has_kernels_of_its_own():
    # Warp reuses a kernel with the same hash: it must see every function in it.
    choices = [EffectTerms(forces=forces, laws=()) for forces in ((), (G,), (T,), (G, T), (T, G), (G, G), (G, T, G))]
    for kernel_of in (frame_kernel, forces_kernel):
        assert len({kernel_of(choice).module.name for choice in choices}) == len(choices)


def test_an_effect_acts_once():
    effect = of_toy(GUST, [[0.0] * 4])
    with pytest.raises(SimulationError, match="an effect can act once in a batch, got toy gust, toy gust"):
        replace(in_the_air(), effects=(effect, effect))


def test_effects_of_no_size_leave_the_rollout_as_it_is_to_the_bit():
    without, idle = in_the_air(), of_rollouts(in_the_air(), [NO_GUST], [NO_TETHER])
    assert np.array_equal(rollout(without).positions, rollout(idle).positions)


@pytest.mark.parametrize("shape", [(2, 1), (1,), (3, 2)])
def test_numbers_must_have_a_row_for_each_rollout(shape):
    with pytest.raises(SimulationError, match=r"the numbers of toy gust must be \[1, P\], got"):
        replace(in_the_air(), effects=(of_toy(GUST, np.zeros(shape)),))
