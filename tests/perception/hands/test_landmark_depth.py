"""Grip and depth of a hand by its landmarks: exact for exact ones, refused where they tell nothing."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from egophys_core.perception.hands.landmark_depth import acting_landmarks, landmark_grip
from egophys_core.perception.stages import HandLandmarks
from tests.perception.hands.drawn_hand import MATRIX, flat_hand, in_camera, pinching_hand, seen_hand, turned

PLACES = [(258.0, 250.0), (60.0, 80.0), (470.0, 300.0)]
TURNS = [(0.0, 0.0, 0.0), (0.0, 0.0, 2.5), (0.9, 0.0, 0.3), (-0.4, 0.8, -1.2)]


@pytest.mark.parametrize("pixel", PLACES)
@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("depth", [0.25, 0.6, 1.4])
def test_exact_landmarks_give_the_grip_and_its_depth(pixel, turn, depth):
    metric = turned(pinching_hand(), *turn)
    hand = seen_hand(metric, pixel, depth)
    grip = landmark_grip(hand, MATRIX)
    assert grip is not None
    between = in_camera(metric, pixel, depth)[[4, 8]].mean(axis=0)
    assert grip.depth == pytest.approx(between[2], abs=1e-4)
    place = MATRIX @ between
    # The middle of two pixels is that of the places but for the perspective of 16 mm.
    np.testing.assert_allclose(grip.pixel, place[:2] / place[2], atol=1)


def test_a_flat_hand_pushes_with_its_foremost_tip():
    for turn in TURNS:
        metric = turned(flat_hand(), *turn)
        assert acting_landmarks(metric) == [12]
        hand = seen_hand(metric, PLACES[0], 0.5)
        grip = landmark_grip(hand, MATRIX)
        assert grip is not None
        np.testing.assert_allclose(grip.pixel, hand.pixels[12])
        assert grip.depth == pytest.approx(in_camera(metric, PLACES[0], 0.5)[12, 2], abs=1e-4)


def test_a_hand_that_points_pushes_with_its_index_finger_and_one_that_holds_with_thumb_and_index():
    pointing = flat_hand()
    for finger in (9, 13, 17):  # folded back to the palm
        pointing[finger + 3] = pointing[finger] + [0, 0.03, -0.03]
    assert acting_landmarks(pointing) == [8]
    assert acting_landmarks(pinching_hand()) == [4, 8]


def test_the_middle_of_the_metric_landmarks_does_not_matter():
    hand = seen_hand(pinching_hand(), PLACES[1], 0.5)
    moved = landmark_grip(replace(hand, metric=hand.metric + [0.03, -0.02, 0.05]), MATRIX)
    grip = landmark_grip(hand, MATRIX)
    assert grip is not None
    assert moved is not None
    assert moved.depth == pytest.approx(grip.depth)


def test_larger_hands_are_deeper():
    hand = seen_hand(flat_hand(), PLACES[0], 0.5)
    larger = landmark_grip(replace(hand, metric=1.1 * hand.metric), MATRIX)
    assert larger is not None
    # The tip is in the plane of a hand that is seen straight: all scales.
    assert larger.depth == pytest.approx(0.55, rel=1e-3)


def test_metric_landmarks_that_are_turned_by_mistake_are_turned_back():
    truth = turned(pinching_hand(), 0.6, 0.2, 0.4)
    hand = replace(seen_hand(truth, PLACES[2], 0.5), metric=turned(truth, 0.15, -0.1, 0.1))
    grip = landmark_grip(hand, MATRIX)
    assert grip is not None
    assert grip.depth == pytest.approx(in_camera(truth, PLACES[2], 0.5)[[4, 8], 2].mean(), rel=0.01)


def test_a_few_wrong_landmarks_do_not_count():
    hand = seen_hand(pinching_hand(), PLACES[1], 0.5)
    pixels = hand.pixels.copy()
    pixels[[11, 12, 16, 19]] += [[90, -40], [60, 80], [-70, 30], [40, 90]]
    right, wrong = landmark_grip(hand, MATRIX), landmark_grip(replace(hand, pixels=pixels), MATRIX)
    assert right is not None
    assert wrong is not None
    assert wrong.depth == pytest.approx(right.depth, rel=0.02)


def test_the_depth_is_off_by_about_what_it_says():
    rng = np.random.default_rng(4)
    size, said, off = 0.06, [], []
    for _ in range(60):
        metric = turned(pinching_hand(), *rng.normal(0, 0.4, 3))
        exact = seen_hand(metric, PLACES[0], 0.5)
        hand = replace(
            exact,
            pixels=exact.pixels + rng.normal(0, 2.5, (21, 2)),
            metric=metric / (1 + size * rng.normal()) + rng.normal(0, 0.004, (21, 3)),
        )
        grip = landmark_grip(hand, MATRIX)
        assert grip is not None
        said.append(grip.sigma)
        off.append(grip.depth - in_camera(metric, PLACES[0], 0.5)[[4, 8], 2].mean())
    assert 0.7 < np.sqrt(np.mean(np.square(off)) / np.mean(np.square(said))) < 1.4


def test_what_is_not_known_of_a_finger_is_left_out():
    hand = seen_hand(pinching_hand(), PLACES[1], 0.5)
    pixels, metric = hand.pixels.copy(), hand.metric.copy()
    pixels[[10, 11]], metric[18] = np.nan, np.nan
    whole, partial = landmark_grip(hand, MATRIX), landmark_grip(replace(hand, pixels=pixels, metric=metric), MATRIX)
    assert whole is not None
    assert partial is not None
    assert partial.depth == pytest.approx(whole.depth, abs=1e-3)
    np.testing.assert_array_equal(partial.pixel, whole.pixel)


def test_landmarks_that_tell_nothing_are_refused():
    hand = seen_hand(pinching_hand(), PLACES[0], 0.5)
    few, thumb = hand.pixels.copy(), hand.pixels.copy()
    few[5:] = np.nan
    thumb[4] = np.nan
    rng = np.random.default_rng(1)
    reaching = flat_hand()
    reaching[12, 2] -= 0.24
    reaching = replace(seen_hand(flat_hand(), PLACES[0], 0.2), metric=reaching)
    behind = in_camera(hand.metric, PLACES[0], -0.5) @ MATRIX.T
    for spoiled in (
        reaching,
        replace(hand, pixels=few),
        replace(hand, pixels=thumb),
        replace(hand, pixels=np.full((21, 2), 100.0)),
        replace(hand, metric=np.zeros((21, 3))),
        replace(hand, pixels=rng.uniform(0, 518, (21, 2))),
        replace(hand, pixels=behind[:, :2] / behind[:, 2:]),
    ):
        assert landmark_grip(spoiled, MATRIX) is None


WILD = st.one_of(st.floats(width=64), st.floats(-600, 600), st.floats(-0.2, 0.2))


@settings(max_examples=30, deadline=None)
@given(pixels=arrays(float, (21, 2), elements=WILD), metric=arrays(float, (21, 3), elements=WILD))
def test_any_numbers_give_none_or_a_place_in_front_of_the_camera(pixels, metric):
    grip = landmark_grip(HandLandmarks(pixels=pixels, metric=metric, right=0.5, score=0.5), MATRIX)
    if grip is not None:
        assert np.isfinite(grip.pixel).all()
        assert 0 < grip.depth < np.inf
        assert 0 < grip.sigma < np.inf


@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_a_hand_of_which_some_numbers_are_wild_gives_none_or_a_place_in_front_of_the_camera(data):
    hand = seen_hand(pinching_hand(), PLACES[2], 0.4)
    pixels, metric = hand.pixels.copy(), hand.metric.copy()
    for numbers in (pixels, metric):
        which = data.draw(st.lists(st.integers(0, numbers.size - 1), max_size=12))
        numbers.flat[which] = data.draw(arrays(float, len(which), elements=WILD))
    grip = landmark_grip(replace(hand, pixels=pixels, metric=metric), MATRIX)
    if grip is not None:
        assert np.isfinite(grip.pixel).all()
        assert 0 < grip.depth < np.inf
        assert 0 < grip.sigma < np.inf
