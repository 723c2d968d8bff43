"""TAP-Vid's measures against cases worked by hand, and against its definition counted pair by pair."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from egophys_core.errors import EpisodeError
from egophys_core.evaluation import first_visible, point_track_scores

SIZE = (256, 256)


def tracks(seed: int, frames: int, count: int):
    """Random predicted and true tracks in 256 x 256 pixels, errors from below 1 to above 16."""
    generator = np.random.default_rng(seed)
    truth = generator.uniform(0, 256, (frames, count, 2))
    predicted = truth + generator.normal(0, 1, truth.shape) * generator.uniform(0, 20, (frames, count, 1))
    said, visible = generator.random((2, frames, count)) < 0.6
    return predicted, said, truth, visible


CASES = st.builds(tracks, st.integers(0, 2**32 - 1), st.integers(1, 6), st.integers(1, 5))


def counted_by_pairs(predicted, said, truth, visible):
    """Delta_avg, AJ and OA as the paper words them, one pair after another."""
    right = pairs = 0
    within, jaccard = [], []
    for threshold in (1, 2, 4, 8, 16):
        shown = close_shown = true_positives = false_positives = right = pairs = 0
        for track in range(truth.shape[1]):
            if not visible[:, track].any():
                continue
            query = next(frame for frame in range(len(truth)) if visible[frame, track])
            for frame in range(query + 1, len(truth)):
                close = np.hypot(*(predicted[frame, track] - truth[frame, track])) < threshold
                is_shown, is_said = visible[frame, track], said[frame, track]
                pairs += 1
                right += is_shown == is_said
                shown += is_shown
                close_shown += is_shown and close
                true_positives += is_shown and is_said and close
                false_positives += is_said and (not is_shown or not close)
        within.append(close_shown / shown if shown else np.nan)
        positives = shown + false_positives
        jaccard.append(true_positives / positives if positives else np.nan)
    return np.mean(within), np.mean(jaccard), right / pairs if pairs else np.nan


def test_measures_of_one_track_by_hand():
    # Queried in frame 0. Then 0, 1.5, 3 pixels off and said to be visible; visible, 3 off, said to be hidden; hidden,
    # said to be visible.
    truth = np.zeros((6, 1, 2))
    predicted = np.zeros((6, 1, 2))
    predicted[:, 0, 0] = [99, 0, 1.5, 3, 3, 0]
    visible = np.array([1, 1, 1, 1, 1, 0], bool)[:, None]
    said = np.array([1, 1, 1, 1, 0, 1], bool)[:, None]
    scores = point_track_scores(predicted, said, truth, visible, SIZE)
    # Four visible pairs: within 1 pixel one, within 2 two, within 4 all, whatever is said.
    assert scores.within == pytest.approx([1 / 4, 2 / 4, 1, 1, 1])
    assert scores.delta_avg == pytest.approx(3.75 / 5)
    # True positives 1, 2, 3, 3, 3; false: the hidden pair, and those visible ones said that are not within, 2, 1, 0.
    assert scores.jaccard == pytest.approx([1 / 7, 2 / 6, 3 / 5, 3 / 5, 3 / 5])
    assert scores.average_jaccard == pytest.approx((1 / 7 + 1 / 3 + 9 / 5) / 5)
    assert scores.occlusion_accuracy == pytest.approx(3 / 5)


def test_frames_up_to_the_query_do_not_count():
    truth = np.zeros((4, 1, 2))
    visible = np.array([0, 1, 1, 0], bool)[:, None]
    predicted, said = truth.copy(), visible.copy()
    predicted[:2], said[:2] = 50.0, [[True], [False]]
    scores = point_track_scores(predicted, said, truth, visible, SIZE)
    assert (scores.delta_avg, scores.average_jaccard, scores.occlusion_accuracy) == (1.0, 1.0, 1.0)


def test_query_is_the_first_visible_frame():
    visible = np.array([[0, 1, 0], [1, 0, 0], [1, 1, 0]], bool)
    assert first_visible(visible).tolist() == [1, 0, 3]


def test_position_exactly_at_a_threshold_is_not_within():
    truth, visible = np.zeros((2, 1, 2)), np.ones((2, 1), bool)
    predicted = np.full((2, 1, 2), [3.0, 0])
    for distance, expected in ((4.0, [0, 0, 0, 1, 1]), (3.999, [0, 0, 1, 1, 1])):
        predicted[1, 0] = [0, distance]
        assert point_track_scores(predicted, visible, truth, visible, SIZE).within.tolist() == expected


def test_each_axis_is_scaled_to_256():
    # 512 x 1024: 7 pixels along x are 3.5, along y 1.75.
    truth, visible = np.zeros((2, 1, 2)), np.ones((2, 1), bool)
    along_x, along_y = np.full((2, 1, 2), [7.0, 0]), np.full((2, 1, 2), [0, 7.0])
    assert point_track_scores(along_x, visible, truth, visible, (512, 1024)).within.tolist() == [0, 0, 1, 1, 1]
    assert point_track_scores(along_y, visible, truth, visible, (512, 1024)).within.tolist() == [0, 1, 1, 1, 1]


def test_position_that_is_not_finite_is_wrong_and_hidden_truth_needs_none():
    truth = np.array([[[0.0, 0]], [[0, 0]], [[np.nan, np.nan]]])
    visible = np.array([1, 1, 0], bool)[:, None]
    predicted = np.array([[[0.0, 0]], [[np.inf, 0]], [[np.nan, 0]]])
    scores = point_track_scores(predicted, visible, truth, visible, SIZE)
    assert (scores.delta_avg, scores.average_jaccard, scores.occlusion_accuracy) == (0.0, 0.0, 1.0)


def test_nothing_to_judge_is_nan():
    truth = np.zeros((3, 2, 2))
    visible = np.array([[0, 0], [0, 0], [0, 1]], bool)
    scores = point_track_scores(truth, visible, truth, visible, SIZE)
    assert np.isnan([scores.delta_avg, scores.average_jaccard, scores.occlusion_accuracy]).all()


def test_bad_input_is_refused():
    truth, visible = np.zeros((2, 1, 2)), np.ones((2, 1), bool)
    with pytest.raises(EpisodeError, match=r"\[T, N, 2\]"):
        point_track_scores(truth[:1], visible, truth, visible, SIZE)
    with pytest.raises(EpisodeError, match="predicted visibility must be"):
        point_track_scores(truth, visible.astype(float), truth, visible, SIZE)
    with pytest.raises(EpisodeError, match="image size"):
        point_track_scores(truth, visible, truth, visible, (0, 256))
    truth[1] = np.nan
    with pytest.raises(EpisodeError, match="true track 0 is visible in frame 1"):
        point_track_scores(truth, visible, truth, visible, SIZE)


@given(CASES)
def test_measures_are_those_counted_pair_by_pair(case):
    scores = point_track_scores(*case, SIZE)
    measured = (scores.delta_avg, scores.average_jaccard, scores.occlusion_accuracy)
    assert measured == pytest.approx(counted_by_pairs(*case), nan_ok=True)


@given(CASES)
def test_measures_are_within_0_and_1_and_grow_with_the_threshold(case):
    scores = point_track_scores(*case, SIZE)
    for values in (scores.within, scores.jaccard):
        assert np.isnan(values).all() or (0 <= values[0] <= values[-1] <= 1 and (np.diff(values) >= 0).all())
    assert np.all(np.isnan(scores.within) | (scores.jaccard <= scores.within))
    assert np.isnan(scores.occlusion_accuracy) or 0 <= scores.occlusion_accuracy <= 1


@given(CASES)
def test_truth_has_all_of_it(case):
    _, _, truth, visible = case
    scores = point_track_scores(truth, visible, truth, visible, SIZE)
    measured = np.array([scores.delta_avg, scores.average_jaccard, scores.occlusion_accuracy])
    assert np.all(np.isnan(measured) | (measured == 1))


@given(CASES, st.randoms())
def test_order_of_the_tracks_and_size_of_the_image_do_not_matter(case, random):
    order = list(range(case[0].shape[1]))
    random.shuffle(order)
    predicted, said, truth, visible = (each[:, order] for each in case)
    one = point_track_scores(*case, SIZE)
    other = point_track_scores(2 * predicted, said, 2 * truth, visible, (512, 512))
    assert np.array_equal(one.within, other.within, equal_nan=True)
    assert np.array_equal(one.jaccard, other.jaccard, equal_nan=True)
    assert one.occlusion_accuracy == pytest.approx(other.occlusion_accuracy, nan_ok=True)
