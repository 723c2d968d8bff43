"""Rollouts that diverge: found where it happens, told with its likely cause, and no harm to the others."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.errors import SimulationError
from egophys_core.simulation import RolloutBatch, batch_of_models, rollout
from egophys_core.simulation.engine import Engine
from egophys_core.simulation.integrator import FASTEST
from tests.simulation.effect_terms import gust_and_tether
from tests.simulation.gradient_scenes import in_the_air
from tests.simulation.scenes import frame_times, idle_controls, moving_controls, scene
from tests.simulation.test_batches import COUNT, mixed_batch

DT = 1 / 600


def heavy_rain(gravity: float, *, count: int = 1) -> RolloutBatch:
    """Three nodes that fall with substeps of 1/600 s in frames of 1/60 s; node 1 starts at half the limit."""
    batch = scene(
        [[0, 0, 0], [1, 0, 0], [2, 0, 0]],
        idle_controls(frame_times(0.1, 1 / 60)),
        gravity=gravity,
        velocities=[[0, 0, 0], [0, 0, -FASTEST / 2], [0, 0, 0]],
        ground_height=-1e6,
    )
    return batch.rows(np.zeros(count, int))


@pytest.mark.parametrize(("substep", "time"), [(1, "0.003"), (7, "0.013"), (10, "0.018"), (43, "0.073")])
def test_first_substep_and_node_are_found_in_the_kernel(substep, time):
    # Node 1 passes the limit in the substep after which FASTEST / 2 + (substep + 1) g dt is above it, before others.
    result = rollout(heavy_rain(FASTEST / 2 / (substep + 0.5) / DT))
    frame = substep // 10
    assert np.isfinite(result.positions[0, : frame + 1]).all()
    assert np.isnan(result.positions[0, frame + 1 :]).all()
    assert f"node 1 is faster than 1000 m/s or not finite on the way to frame {frame + 1} (t={time} s)" in str(
        result.failures[0]
    )


def test_speed_below_the_limit_is_none_of_its_business():
    assert rollout(heavy_rain(0.999 * FASTEST / 2 / 60 / DT)).failures == (None,)


def test_message_gives_the_step_as_a_share_of_the_stable_one():
    # omega^2 = 2 k / m, at 5 % above which the bound stands; the frame of 1/30 s is cut by it, not by accuracy.
    stiffness, mass = 2e4, 0.01
    batch = scene(
        [[0, 0, 0], [0.1, 0, 0]],
        idle_controls(frame_times(0.1, 1 / 30)),
        springs=[(0, 1)],
        stiffness=stiffness,
        rest_lengths=[0.1],
        mass=mass,
        gravity=1e9,
        ground_height=-1e9,
    )
    omega = np.sqrt(1.05 * 2 * stiffness / mass)
    result = rollout(batch)
    assert 1.7 < omega / 30 / result.substeps[0] < 1.81
    assert f"with omega*dt = {omega / 30 / result.substeps[0]:.2f}, stable below 2" in str(result.failures[0])
    assert str(result.failures[0]).endswith("lower the stiffness, the damping or the size of extra forces")


@pytest.mark.filterwarnings("ignore:overflow encountered")
def test_controller_that_jumps_is_named():
    times = frame_times(1.0, 1 / 20)
    path = np.tile(np.float32([0.3, 0, 0]), (len(times), 1, 1))
    path[12:] = 1e38
    batch = scene(
        [[0, 0, 0], [0.29, 0, 0]],
        moving_controls(times, path),
        mass=0.01,
        controller_stiffness=10.0,
        controller_neighbours=1,
        flat=False,
    )
    result = rollout(batch)
    # The jump to frame 12 is in the central difference at frame 11 and so in the motion between 10 and 11.
    assert np.isfinite(result.positions[0, :11]).all()
    assert "node 1 is faster than 1000 m/s or not finite on the way to frame 11 (t=0.50" in str(result.failures[0])
    assert "a controller jumps there" in str(result.failures[0])
    with pytest.raises(SimulationError, match=r"rollout 0: node 1 .* on the way to frame 11 .*: check the recording"):
        result.raise_on_failure()


@pytest.mark.filterwarnings("ignore:overflow encountered")
def test_impossible_start_velocity_is_named():
    batch = scene(
        [[0, 0, 0], [0.1, 0, 0]],
        idle_controls(frame_times(0.2, 1 / 30)),
        springs=[(0, 1)],
        rest_lengths=[0.1],
        damping=100.0,
        velocities=[[0, 0, 0], [3e38, 0, 0]],
    )
    failure = str(rollout(batch).failures[0])
    assert "on the way to frame 1 " in failure
    assert "check the start velocities" in failure


@pytest.mark.filterwarnings("ignore:overflow encountered")
@pytest.mark.parametrize("collision_distance", [0.0, 0.04])
def test_rollout_that_diverges_does_not_touch_the_others(collision_distance):
    models, controls = mixed_batch(collision_distance=collision_distance)
    wild = controls[5].positions.copy()
    wild[10:] = 1e38
    spoilt = [*controls[:5], replace(controls[5], positions=wild), *controls[6:]]

    good, bad = (rollout(batch_of_models(models, each, ground_height=0.0)) for each in (controls, spoilt))
    assert [failure is None for failure in bad.failures] == [index != 5 for index in range(COUNT)]
    others = np.arange(COUNT) != 5
    assert np.array_equal(good.positions[others], bad.positions[others])
    assert np.array_equal(good.velocities[others], bad.velocities[others])


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf, 1e38])
@pytest.mark.parametrize("effect", [0, 1])
def test_numbers_of_an_effect_that_are_none_are_found_in_the_first_substeps(number, effect):
    many = replace(
        in_the_air().rows(np.zeros(3, int)),
        effects=gust_and_tether(np.tile([1.0, 2.0, 0.5, 1.0], (3, 1)), np.tile([1.0, 0.1], (3, 1))),
    )
    good = rollout(many)
    many.effects[effect].numbers[1, 1] = number
    bad = rollout(many)
    assert [failure is None for failure in bad.failures] == [True, False, True]
    assert "on the way to frame 1 (t=0.00" in str(bad.failures[1])
    assert "the size of extra forces" in str(bad.failures[1])
    assert np.array_equal(good.positions[[0, 2]], bad.positions[[0, 2]])
    assert np.isnan(bad.positions[1, 1:]).all()


def test_no_frame_is_advanced_once_every_rollout_has_diverged(monkeypatch):
    advanced = []
    advance_frame = Engine.advance_frame

    def counting(self: Engine, frame: int) -> None:
        advanced.append(frame)
        advance_frame(self, frame)

    monkeypatch.setattr(Engine, "advance_frame", counting)
    fast, slow = heavy_rain(FASTEST / 2 / 2.5 / DT), heavy_rain(FASTEST / 2 / 30.5 / DT)
    both = replace(fast.rows([0, 0]), parameters=(*fast.parameters, *slow.parameters))
    result = rollout(both)
    assert advanced == [0, 1, 2, 3]
    assert [f"frame {frame} " in str(failure) for frame, failure in zip((1, 4), result.failures, strict=True)]
    assert np.isfinite(result.positions[1, :4]).all()
    assert np.isnan(result.positions[1, 4:]).all()
