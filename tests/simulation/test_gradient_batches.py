"""Gradients of many rollouts at once, of long ones, and of ones cut into windows."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from egophys_core.errors import SimulationError
from egophys_core.simulation import RolloutBatch, gradients, rollout
from egophys_core.simulation.gradients import Gradient, differentiate
from tests.simulation.differences import linear_loss
from tests.simulation.effect_terms import gust_and_tether
from tests.simulation.gradient_scenes import bars_that_collide, in_the_air, on_the_table
from tests.simulation.scenes import frame_times, idle_controls, scene

COUNT = 11
"""Two lane groups, the second only partly filled."""


def numbers_of(gradient: Gradient) -> dict[str, np.ndarray]:
    """Each [K, ...] by name."""
    return {**{name: values for name, values in vars(gradient).items() if name != "parameters"}, **gradient.parameters}


def varied(batch: RolloutBatch) -> RolloutBatch:
    """Eleven rollouts that differ from the first of `batch` in numbers, controls, contacts and substeps."""
    generator = np.random.default_rng(1)
    many = batch.rows(np.zeros(COUNT, int))
    factors = generator.uniform(0.8, 1.2, (COUNT, 1))
    faster = np.where(np.arange(COUNT)[:, None] % 4 == 2, 300.0, 1.0)
    alphas, controls = [], []
    for row, (alpha, control) in enumerate(zip(many.parameters, many.controls, strict=True)):
        share = float(factors[row, 0])
        alphas.append(
            replace(
                alpha,
                drag=share * alpha.drag,
                friction=share * alpha.friction,
                controller_stiffness=share * alpha.controller_stiffness,
                controller_neighbours=1 + row % 3,
            )
        )
        controls.append(
            replace(
                control,
                positions=control.positions + generator.normal(0, 1e-3, control.positions.shape).astype(np.float32),
                contact=np.roll(control.contact, row % 3, axis=1),
            )
        )
    return replace(
        many,
        stiffness=(factors * faster * many.stiffness).astype(np.float32),
        velocities=many.velocities + generator.normal(0, 0.02, many.velocities.shape).astype(np.float32),
        parameters=tuple(alphas),
        controls=tuple(controls),
        effects=tuple(replace(effect, numbers=np.float32(factors) * effect.numbers) for effect in many.effects),
    )


def random_loss(batch: RolloutBatch):
    shape = (len(batch.controls[0].times), *batch.positions.shape[1:])
    return linear_loss(np.random.default_rng(0).normal(0, 1, shape))


@pytest.mark.parametrize("effects", [False, True])
@pytest.mark.parametrize("windows", [1, 3])
def test_gradient_of_a_rollout_is_the_same_to_the_bit_alone_and_in_a_batch(effects, windows):
    batch = varied(in_the_air(effects=effects))
    assert len(np.unique(rollout(batch).substeps)) > 1
    together = numbers_of(differentiate(batch, random_loss(batch), windows=windows)[2])
    for row in range(COUNT):
        alone = numbers_of(differentiate(batch.rows([row]), random_loss(batch), windows=windows)[2])
        for name, values in alone.items():
            assert np.array_equal(together[name][row], values[0]), f"{name} of rollout {row}"


def test_rollout_that_diverges_has_no_gradient_and_leaves_the_others_theirs():
    good = varied(in_the_air(effects=True))
    wild = [effect.numbers.copy() for effect in good.effects]
    wild[0][4, 0] = np.inf
    bad = replace(good, effects=gust_and_tether(*wild))
    expected, loss = numbers_of(differentiate(good, random_loss(good))[2]), random_loss(bad)
    result, losses, gradient = differentiate(bad, loss)
    assert [failure is None for failure in result.failures] == [row != 4 for row in range(COUNT)]
    assert np.isnan(losses[4])
    for name, values in numbers_of(gradient).items():
        assert not values[4].any(), name
        others = np.arange(COUNT) != 4
        assert np.array_equal(values[others], expected[name][others]), name


def test_batch_that_diverges_altogether_has_no_gradient():
    batch = replace(in_the_air(), effects=gust_and_tether([[np.nan, 0, 0, 1]], [[0, 0]]))
    gradient = differentiate(batch, random_loss(batch))[2]
    assert not any(values.any() for values in numbers_of(gradient).values())


def falling_net(times: np.ndarray) -> RolloutBatch:
    """The net without hands, which lands and slides."""
    return replace(on_the_table(), controls=(idle_controls(times),))


@pytest.mark.parametrize(
    ("batch", "frames", "names"),
    [
        (on_the_table(), 12, ("stiffness", "damping", "friction", "restitution", "gravity", "contact_height")),
        # Pairs are sought anew for each frame: 3 at first, 1 once the bars have met.
        (bars_that_collide(), 7, ("stiffness", "damping", "collision_friction", "collision_restitution", "gravity")),
    ],
)
def test_many_frames_have_the_gradient_of_one_long_frame(batch, frames, names):
    # The same substeps as frames that are gone back over one by one, and as one frame that is all on the tape.
    nodes, duration = batch.positions.shape[1], frames / 60
    weights = np.random.default_rng(2).normal(0, 1, (nodes, 3))

    def gradient(times: np.ndarray) -> dict[str, np.ndarray]:
        seeds = np.zeros((len(times), nodes, 3))
        seeds[-1] = weights
        return numbers_of(differentiate(replace(batch, controls=(idle_controls(times),)), linear_loss(seeds))[2])

    many, one = gradient(frame_times(duration, 1 / 60)), gradient(np.array([0.0, duration]))
    for name in (*names, "positions", "velocities"):
        scale = np.abs(one[name]).max()
        assert scale > 0
        assert np.abs(many[name] - one[name]).max() < 1e-4 * scale, name


def test_tape_holds_the_substeps_of_one_frame(monkeypatch):
    lengths = []

    class Tape(gradients.FrameTape):
        def __init__(self, substeps: int, *shape) -> None:
            lengths.append(substeps)
            super().__init__(substeps, *shape)

    monkeypatch.setattr(gradients, "FrameTape", Tape)
    batch = falling_net(frame_times(0.5, 1 / 60))
    differentiate(batch, random_loss(batch))
    assert lengths == [10]


def test_loss_at_the_start_is_one_to_one_with_the_start():
    batch = in_the_air()
    seeds = np.zeros((6, 6, 3))
    seeds[0] = np.random.default_rng(0).normal(0, 1, (6, 3))
    gradient = differentiate(batch, linear_loss(seeds))[2]
    assert gradient.positions[0] == pytest.approx(seeds[0])
    assert not any(values.any() for name, values in numbers_of(gradient).items() if name != "positions")


def test_windows_keep_the_derivatives_within_them():
    # What three windows give is the sum over rollouts that start at each window's first frame with its state there.
    times = np.arange(8) / 64
    batch, shape = falling_net(times), (8, 6, 3)
    weights = np.random.default_rng(4).normal(0, 1, shape)
    together = numbers_of(differentiate(batch, linear_loss(weights), windows=3)[2])
    bounds = np.linspace(0, 7, 4).astype(int)
    sums = dict.fromkeys(("stiffness", "damping", "rest_lengths", "friction", "gravity", "contact_height"), 0.0)
    for first, last in pairwise(bounds):
        state = batch
        if first > 0:
            before = rollout(falling_net(times[: first + 1]))
            state = replace(batch, positions=before.positions[:, -1], velocities=before.velocities)
        part = replace(state, controls=(idle_controls(times[first : last + 1] - times[first]),))
        seeds = weights[first : last + 1].copy()
        seeds[0] = weights[0] if first == 0 else 0.0
        alone = numbers_of(differentiate(part, linear_loss(seeds))[2])
        for name in sums:
            sums[name] = sums[name] + alone[name]
        if first == 0:
            assert together["positions"] == pytest.approx(alone["positions"], rel=1e-6)
            assert together["velocities"] == pytest.approx(alone["velocities"], rel=1e-6)
    for name, values in sums.items():
        assert np.abs(values).max() > 0
        assert together[name] == pytest.approx(values, rel=1e-5, abs=1e-6 * np.abs(values).max()), name


def test_more_windows_than_frames_and_none_at_all():
    batch = in_the_air(effects=True)
    gradient = numbers_of(differentiate(batch, random_loss(batch), windows=9)[2])
    assert all(np.isfinite(values).all() for values in gradient.values())
    with pytest.raises(SimulationError, match="windows must be at least 1, got 0"):
        differentiate(batch, random_loss(batch), windows=0)


def test_object_that_nothing_moves_can_be_differentiated():
    # No springs, no controller points: arrays of no length on the tape.
    batch = scene([[0, 0, 1.0]], idle_controls(np.array([0.0, 0.1])), gravity=9.81)
    seeds = np.zeros((2, 1, 3))
    seeds[1, 0, 2] = 1.0
    gradient = differentiate(batch, linear_loss(seeds))[2]
    # z falls by g t (t + dt) / 2.
    assert gradient.parameters["gravity"][0] == pytest.approx(-0.1 * (0.1 + 1 / 600) / 2, rel=1e-5)
    assert gradient.velocities[0, 0, 2] == pytest.approx(0.1, rel=1e-5)
