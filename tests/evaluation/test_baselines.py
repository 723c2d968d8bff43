"""Predictions without physics."""

import numpy as np
import pytest

from egophys_core.evaluation import baseline_scores, rigid_follow_prediction, static_prediction
from tests.identification.synthetic import episode_of

FRAMES, SPLIT = 10, 7


def moving_episode():
    """Two points and two hands; point 0 moves 1 cm a frame along x, point 1 stays."""
    frame = np.arange(FRAMES)[:, None]
    points = np.zeros((FRAMES, 2, 3))
    points[:, 0, 0] = 0.01 * frame[:, 0]
    points[:, 1] = [1.0, 0, 0]
    controllers = np.zeros((FRAMES, 2, 3))
    controllers[:, 0] = points[:, 0] + [0, 0, 0.02]
    controllers[:, 1] = [1.0, 0, 0.5]
    return points, controllers


def test_static_prediction_copies_train_frames_and_keeps_the_last():
    points, controllers = moving_episode()
    predicted = static_prediction(episode_of(points, controllers))
    assert predicted[:SPLIT] == pytest.approx(points[:SPLIT])
    assert predicted[SPLIT:] == pytest.approx(np.tile(points[SPLIT - 1], (FRAMES - SPLIT, 1, 1)))


def test_static_prediction_never_looks_at_held_out_frames():
    points, controllers = moving_episode()
    other = points.copy()
    other[SPLIT:] += 5.0
    one, two = (static_prediction(episode_of(each, controllers)) for each in (points, other))
    assert np.array_equal(one, two)


def test_static_prediction_puts_a_hidden_point_where_it_was_last_seen():
    points, controllers = moving_episode()
    points[4:, 0] = np.nan
    predicted = static_prediction(episode_of(points, controllers))
    assert predicted[4:, 0, 0] == pytest.approx(np.full(6, 0.03))


def test_rigid_prediction_moves_with_the_nearest_holding_controller_from_its_hold_on():
    points, controllers = moving_episode()
    hold = np.zeros((FRAMES, 2), bool)
    hold[3:6, 0] = True
    predicted = rigid_follow_prediction(episode_of(points, controllers), hold)
    # Both points follow the only hand that ever holds: two steps of 1 cm (frames 4 and 5), then it lets go.
    way = np.array([0, 0, 0, 0, 0.01, 0.02, 0.02, 0.02, 0.02, 0.02])
    assert predicted[:, 0, 0] == pytest.approx(way, abs=1e-6)
    assert predicted[:, 1, 0] == pytest.approx(1.0 + way, abs=1e-6)


def test_each_point_follows_the_hand_nearest_to_it_at_that_hands_grasp():
    points, controllers = moving_episode()
    hold = np.ones((FRAMES, 2), bool)
    predicted = rigid_follow_prediction(episode_of(points, controllers), hold)
    assert predicted[-1, 0] == pytest.approx([0.09, 0, 0], abs=1e-6)
    assert predicted[-1, 1] == pytest.approx([1.0, 0, 0], abs=1e-6)


def test_without_any_hold_nothing_moves():
    points, controllers = moving_episode()
    predicted = rigid_follow_prediction(episode_of(points, controllers), np.zeros((FRAMES, 2), bool))
    assert predicted == pytest.approx(np.tile(points[0], (FRAMES, 1, 1)))


@pytest.mark.parametrize("lag", [0.33, -0.2])
def test_points_recorded_late_are_followed_at_their_lag(lag):
    times = np.arange(60) / 10
    hand = np.stack([0.1 * np.sin(2.0 * times), 0.05 * np.cos(3.0 * times), 0 * times], axis=1)
    late = np.stack([np.interp(times - lag, times, hand[:, axis]) for axis in range(3)], axis=1)
    points = np.array([[0.02, 0, 0], [0, 0.1, 0]]) + (late - late[0])[:, None]
    scores = baseline_scores(episode_of(points, hand[:, None], times), np.ones((60, 1), bool))
    assert scores["moves with nearest controller"].test_track_m > 0.02
    assert scores["nearest controller at its best lag"].test_track_m < 0.004


def test_scores_of_the_baselines_by_hand():
    points, controllers = moving_episode()
    scores = baseline_scores(episode_of(points, controllers), np.ones((FRAMES, 2), bool))
    static, rigid = scores["last observed shape stays"], scores["moves with nearest controller"]
    # Point 0 is 1, 2, 3 cm ahead in the three held-out frames, point 1 in place: mean 1 cm.
    assert static.test_track_m == pytest.approx(0.01, rel=1e-4)
    assert static.test_chamfer_m == pytest.approx(0.01, rel=1e-4)
    assert np.isnan([static.train_track_m, static.train_chamfer_m, static.all_track_m, static.all_chamfer_m]).all()
    assert rigid.all_track_m == pytest.approx(0.0, abs=1e-6)


def test_points_not_seen_in_the_first_frame_do_not_break_the_scores():
    points, controllers = moving_episode()
    points = np.concatenate([points, points[:, :1] + [0, 0.5, 0]], axis=1)
    points[:3, 2] = np.nan
    scores = baseline_scores(episode_of(points, controllers), np.ones((FRAMES, 2), bool))
    assert np.isfinite([each.test_chamfer_m for each in scores.values()]).all()
