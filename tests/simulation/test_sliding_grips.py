"""Grips that slip: along their pull, as long as they hold, and what a loss owes to it."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from egophys_core.effects import LIBRARY
from egophys_core.simulation import Controls, batch_of_models, effect_gradients, rollout
from egophys_core.simulation.engine import Engine
from egophys_core.simulation.gradients import differentiate
from egophys_core.simulation.rollout import advance_all
from tests.effects.situations import lifted, sheet, with_effect
from tests.simulation.differences import linear_loss
from tests.simulation.scenes import FAR_BELOW, frame_times, moving_controls, scene

SPEED = 0.05
ALONG = partial(LIBRARY["grasp_slip"].slide, {"x": 0.0, "y": 0.0, "z": -SPEED, "onset": 0.2})


def beads(controls: Controls, *, gravity: float = 9.81, drag: float = 0.0, ground_height: float = FAR_BELOW):
    """A bead in each hand from the start on; what is in the first rollout slips, what is in the second does not."""
    batch = scene(
        controls.positions[0],
        controls,
        mass=0.1,
        controller_stiffness=400.0,
        controller_radius=0.01,
        damping=12.0,
        gravity=gravity,
        drag=drag,
        ground_height=ground_height,
        flat=False,
    ).rows(np.array([0, 0]))
    return replace(batch, slides=((ALONG,), ()))


def slid(batch) -> np.ndarray:
    """[F, N, 3] metres by which the beads that slip are off those that do not."""
    positions = rollout(batch).positions.astype(np.float64)
    return positions[0] - positions[1]


def still(duration: float = 1.0, hold=None) -> Controls:
    times = frame_times(duration, 1 / 30)
    return moving_controls(times, np.tile([0.0, 0.0, 1.0], (len(times), 1)), hold)


def test_what_hangs_slides_down_from_the_onset_on():
    controls = still()
    since = np.maximum(controls.times - 0.2, 0.0)
    assert slid(beads(controls))[:, 0] == pytest.approx(since[:, None] * [0.0, 0.0, -SPEED], abs=0.003)


def test_what_drags_behind_slides_back():
    times = frame_times(1.0, 1 / 30)
    controls = moving_controls(times, times[:, None] * [0.3, 0.0, 0.0])
    back = slid(beads(controls, gravity=1e-6, drag=30.0))[:, 0]
    assert back[-1] == pytest.approx([-0.8 * SPEED, 0.0, 0.0], abs=0.003)


def test_each_hand_slips_by_its_own_pull():
    times = frame_times(1.0, 1 / 30)
    hands = np.array([[-0.5, 0, 0], [0.5, 0, 0]]) + times[:, None, None] * np.array([[0.3, 0, 0], [0, -0.3, 0]])
    end = slid(beads(moving_controls(times, hands), gravity=1e-6, drag=30.0))[-1]
    assert end == pytest.approx(0.8 * SPEED * np.array([[-1.0, 0, 0], [0, 1.0, 0]]), abs=0.003)


def test_nothing_slides_where_nothing_pulls():
    assert np.abs(slid(beads(still(), gravity=1.0, ground_height=1.0))).max() < 1e-6


def test_a_hold_that_ends_takes_its_slip_with_it():
    controls = still(hold=np.repeat([True, False, True], [15, 4, 12])[:, None])
    engine = Engine(beads(controls), "cpu")
    advance_all(engine)
    before = engine.sliding.before[0, :, 0, 2]
    assert before[14] == pytest.approx(-SPEED * (14 / 30 - 0.2), rel=0.05)
    assert (before[15:20] == 0.0).all()
    # In the first frame of a hold nothing pulls yet.
    assert before[-1] == pytest.approx(-SPEED * 10 / 30, rel=0.05)
    assert (engine.sliding.before[1] == 0.0).all()


def test_a_loss_is_differentiated_by_a_slip():
    model = sheet(controller_stiffness=200.0, drag=2.0, stiffness=100.0, gravity=9.81)
    values = {"x": 0.01, "y": 0.0, "z": -0.04, "onset": 0.31}
    controls = lifted(duration=1.2, height=0.3)
    weights = np.zeros((len(controls.times), len(model.graph.positions), 3))
    weights[-1] = [0.3, 0.2, 1.0]
    weights[20] = [1.0, 0.0, -0.5]

    def batch_at(**changes: float):
        slips = with_effect(model, "grasp_slip", **{**values, **changes})
        return batch_of_models([slips], [controls], ground_height=FAR_BELOW), slips

    batch, slips = batch_at()
    gradient = differentiate(batch, linear_loss(weights))[2]
    found = effect_gradients([slips], [controls], gradient, ground_height=FAR_BELOW)[0]["grasp_slip"]
    for name, by in (("x", 0.004), ("z", 0.004), ("onset", 0.02)):
        ends = [rollout(batch_at(**{name: values[name] + sign * by})[0]).positions[0] for sign in (1, -1)]
        change = float((weights * (ends[0].astype(float) - ends[1])).sum()) / (2 * by)
        assert found[name] == pytest.approx(change, rel=0.05), name
