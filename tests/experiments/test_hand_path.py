"""Paths of hands: never faster than allowed, where they should be, and plans that an arm takes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from egophys_core.experiments.hand_path import ABOVE_M, ARRIVES_S, CLOSES_S, STEP_S, PathWriter, plan_of_path
from egophys_core.plan_file import PlanFile, read_plan, write_plan
from egophys_core.robot import MotionLimits, Transform, check_plan
from egophys_core.waypoint_plan import POINTING_DOWN

PLACE = np.array([0.4, 0.1, 0.02])


def speeds(path):
    return np.linalg.norm(np.diff(path.positions, axis=0), axis=1) / np.diff(path.times)


@given(
    to=st.tuples(*[st.floats(-0.3, 0.3)] * 3),
    peak=st.floats(0.05, 1.0),
)
def test_a_move_ends_where_it_should_and_keeps_to_its_speed(to, peak):
    writer = PathWriter(PLACE)
    writer.move(to, peak_speed=peak)
    path = writer.path()
    assert path.positions[-1] == pytest.approx(PLACE + to)
    moving = path.times[1:] > ARRIVES_S + CLOSES_S
    assert speeds(path)[moving].max(initial=0.0) <= 1.001 * peak
    assert (np.diff(path.times) > 0.0).all()


@given(
    amplitude=st.floats(0.01, 0.1),
    frequency=st.floats(0.5, 2.5),
    cycles=st.integers(3, 8),
)
def test_a_swing_goes_to_both_sides_and_comes_back(amplitude, frequency, cycles):
    writer = PathWriter(PLACE)
    began = writer.duration
    writer.swing(np.array([0.0, 1.0, 0.0]), amplitude=amplitude, frequency=frequency, cycles=cycles)
    path = writer.path()
    aside = path.positions[:, 1] - PLACE[1]
    assert writer.duration - began == pytest.approx(cycles / frequency)
    assert aside[-1] == pytest.approx(0.0, abs=1e-9)
    # Straight pieces of a sine cut its tops by less than a tenth at five pieces a half-turn.
    for side in (aside, -aside):
        assert 1.001 * amplitude >= side.max() >= 0.8 * amplitude
    assert np.diff(path.times).max() <= max(STEP_S, CLOSES_S, ARRIVES_S) + 1e-9


@given(to=st.floats(-2.0, 2.0), peak=st.floats(0.1, 3.0))
def test_a_turn_is_on_the_spot_and_keeps_to_its_rate(to, peak):
    writer = PathWriter(PLACE)
    writer.move([0.0, 0.0, 0.1], peak_speed=0.2)
    began = writer.duration
    writer.turn(to, peak_rate=peak)
    writer.wait(0.5)
    path = writer.path()
    turning = path.times >= began
    assert path.positions[turning] == pytest.approx(np.tile(PLACE + [0.0, 0.0, 0.1], (turning.sum(), 1)))
    assert path.turns[~turning].max(initial=0.0) == 0.0
    assert path.turns[-1] == pytest.approx(to)
    assert (np.abs(np.diff(path.turns)) / np.diff(path.times)).max() <= 1.001 * peak


def test_it_comes_from_above_holds_once_it_is_there_and_lets_go():
    writer = PathWriter(PLACE)
    writer.move([0.0, 0.0, 0.1], peak_speed=0.2)
    writer.let_go()
    writer.wait(1.0)
    path = writer.path()
    assert path.positions[0] == pytest.approx(PLACE + [0.0, 0.0, ABOVE_M])
    holding = path.times[path.holds]
    assert holding[0] == ARRIVES_S
    assert holding[-1] < path.times[-1] - 0.99


def test_its_plan_is_a_plan_file_that_an_arm_may_execute(tmp_path):
    writer = PathWriter(PLACE)
    writer.move([0.0, 0.0, 0.15], peak_speed=0.2)
    writer.swing(np.array([0.0, 1.0, 0.0]), amplitude=0.03, frequency=1.0, cycles=3)
    writer.turn(-0.5, peak_rate=0.9)
    plan = plan_of_path(writer.path(), "0123456789abcdef")
    write_plan(tmp_path / "plan.json", PlanFile(plan=plan, stamp_ns=1, tolerance=float("nan")))
    again = read_plan(tmp_path / "plan.json").plan
    np.testing.assert_array_equal(again.times, plan.times)
    check_plan(again, MotionLimits(), Transform.identity())
    np.testing.assert_array_equal(plan.quaternions[0], POINTING_DOWN)
    # What pointed along x from a tool that points down points to the right by half a radian.
    turned = Rotation.from_quat(plan.quaternions[-1])
    assert turned.apply([1.0, 0.0, 0.0]) == pytest.approx([np.cos(0.5), -np.sin(0.5), 0.0])
    assert turned.apply([0.0, 0.0, 1.0]) == pytest.approx([0.0, 0.0, -1.0])
