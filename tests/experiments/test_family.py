"""The family of motions: held where hands can hold, within what they can do."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.errors import PlanningError
from egophys_core.experiments import PERSON, HandLimits, arm_hands, motions_for
from egophys_core.experiments.family import LONGEST_S
from egophys_core.experiments.hand_path import plan_of_path
from egophys_core.experiments.places import places_to_hold
from egophys_core.robot import MotionLimits, Transform, check_plan
from tests.effects.situations import sheet, solid
from tests.experiments.twins import twin_of

NOWHERE = np.zeros((0, 3))

ARM = HandLimits(hands=1, fastest_m_s=0.25, fastest_turn_rad_s=1.0, highest_m=0.45)


@pytest.mark.parametrize("body", [sheet, solid])
@pytest.mark.parametrize("limits", [PERSON, ARM])
def test_no_hand_is_faster_or_higher_than_allowed_nor_below_the_table(body, limits):
    motions = motions_for(twin_of(body()), limits)
    assert len({each.name for each in motions}) == len(motions) >= 5
    for motion in motions:
        assert len(motion.paths) <= limits.hands
        assert motion.duration <= LONGEST_S
        for path in motion.paths:
            np.testing.assert_array_equal(path.times, motion.paths[0].times)
            speed = np.linalg.norm(np.diff(path.positions, axis=0), axis=1) / np.diff(path.times)
            assert speed.max() <= 1.001 * limits.fastest_m_s, motion.name
            rate = np.abs(np.diff(path.turns)) / np.diff(path.times)
            assert rate.max() <= 1.001 * limits.fastest_turn_rad_s
            assert (np.ptp(path.turns) > 1.5) == ("turn the wrist" in motion.name)
            assert path.positions[:, 2].max() <= limits.highest_m + 0.1
            assert path.positions[:, 2].min() >= 0.0
            assert path.holds.any()


@pytest.mark.parametrize("body", [sheet, solid])
def test_an_arm_may_execute_all_that_is_written_for_it(body):
    model = body()
    nodes = model.graph.positions + np.float32([0.42, 0.0, 0.0])
    reached = replace(model, graph=replace(model.graph, positions=nodes))
    own = MotionLimits()
    for motion in motions_for(twin_of(reached), arm_hands(own)):
        check_plan(plan_of_path(motion.paths[0], ""), own, Transform.identity())


def test_a_sheet_is_held_at_two_corners_of_a_long_side():
    model = sheet()
    nodes = model.graph.positions
    longer = replace(model, graph=replace(model.graph, positions=(nodes * [1.5, 1.0, 1.0]).astype(np.float32)))
    first, second = places_to_hold(longer, 2, NOWHERE)
    low, high = longer.graph.positions.min(axis=0), longer.graph.positions.max(axis=0)
    assert abs(first[0] - second[0]) > 0.8 * (high - low)[0]
    assert first[1] == pytest.approx(second[1], abs=0.01)
    for place in (first, second):
        assert (low[:2] <= place[:2]).all()
        assert (place[:2] <= high[:2]).all()


def test_a_solid_is_held_from_above_and_well_below_its_top():
    """A hand at its skin is a pivot."""
    model = solid()
    top, bottom = model.graph.positions[:, 2].max(), model.graph.positions[:, 2].min()
    for place in places_to_hold(model, 2, NOWHERE):
        assert (top + bottom) / 2.0 - 1e-6 <= place[2] <= top - min(0.015, 0.3 * (top - bottom))


@pytest.mark.parametrize("end", [0, 1])
def test_one_hand_holds_a_solid_where_none_did_before(end):
    """An added mass shows in how it hangs from one end and from the other."""
    model = solid()
    both = places_to_hold(model, 2, NOWHERE)
    (place,) = places_to_hold(model, 1, both[[end]] + 0.01)
    np.testing.assert_allclose(place, both[1 - end])
    for motion in motions_for(twin_of(model, grasp=both[[end]]), ARM):
        assert "not held before" in motion.sentence
        np.testing.assert_allclose(motion.paths[0].positions[:, :2].mean(axis=0), place[:2], atol=0.1)


def test_what_was_held_at_both_ends_is_held_at_one_of_them():
    model = solid()
    both = places_to_hold(model, 2, NOWHERE)
    assert "hold one end" in motions_for(twin_of(model, grasp=both), ARM)[0].sentence


@pytest.mark.parametrize("corner", [0, 1])
def test_a_sheet_is_held_at_the_same_corner_wherever_it_was_held(corner):
    both = places_to_hold(sheet(), 2, NOWHERE)
    np.testing.assert_array_equal(places_to_hold(sheet(), 1, both[[corner]]), both[:1])


def test_a_cable_is_told_what_to_do_instead():
    with pytest.raises(PlanningError, match="record another load"):
        places_to_hold(replace(sheet(), kind="rod"), 1, NOWHERE)


@pytest.mark.parametrize(("body", "hands", "falls"), [(sheet, 1, False), (sheet, 2, True), (solid, 1, True)])
def test_what_hangs_ends_by_a_drop_but_for_a_sheet_in_one_hand(body, hands, falls):
    motions = [each for each in motions_for(twin_of(body()), PERSON) if len(each.paths) == hands]
    swung = [each for each in motions if each.name.startswith(("hang and swing", "hang still"))]
    assert len(swung) >= 3
    for motion in swung:
        assert ("let go of it" in motion.sentence) == falls
        for path in motion.paths:
            (let_go,) = np.flatnonzero(path.holds[:-1] & ~path.holds[1:]) + 1 if falls else (-1,)
            assert path.holds[-1] != falls
            # From as high as hands may, held still before that, and watched until it has landed.
            still = path.times >= path.times[let_go] - 0.9
            assert not falls or path.positions[let_go, 2] == pytest.approx(PERSON.highest_m, abs=0.05)
            assert np.ptp(path.positions[still], axis=0).max() < 1e-9
            assert not falls or path.times[-1] - path.times[let_go] > 0.3


def test_what_nobody_lets_go_of_is_not_dropped_when_there_is_no_time():
    slow = replace(ARM, fastest_m_s=0.12)
    motions = motions_for(twin_of(solid()), slow)
    assert any(each.name.startswith("hang still, ") for each in motions)


@pytest.mark.parametrize("body", [sheet, solid])
def test_what_is_dragged_comes_behind_the_hand(body):
    model = body()
    middle = model.graph.positions.mean(axis=0)[:2]
    dragged = [each for each in motions_for(twin_of(model), PERSON) if each.name.startswith("drag")]
    alone = [each for each in dragged if len(each.paths) == 1]
    assert len(alone) == 2
    for motion in alone:
        path = motion.paths[0].positions[:, :2]
        from_start = np.linalg.norm(path - path[0], axis=1)
        assert (path[from_start.argmax()] - path[0]) @ (path[0] - middle) > 0.0
        ways = np.count_nonzero(np.diff((from_start > 0.5 * from_start.max()).astype(int)) > 0)
        assert ways == (2 if " twice" in motion.sentence else 1)
