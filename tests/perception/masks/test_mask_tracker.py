"""Masks of drawn videos against exact ones: colours near the table's and the skin's, shadow, exposure, blur, hiding."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.evaluation.masks import mask_scores, region_similarity
from egophys_core.perception.masks.mask_tracker import MaskTracker
from tests.perception.table_scene import BLUE, DARK, GREEN, KHAKI, Scene, draw

REDDISH_SKIN = (110, 150, 235)


def follow(scene, with_poses=True):
    """Predicted and true masks, each a list over the frames."""
    tracker, predicted, truths = None, [], []
    for frame in range(scene.frames):
        view, truth = draw(scene, frame)
        if not with_poses:
            view = replace(view, world_from_camera=np.full((4, 4), np.nan))
        tracker = tracker or MaskTracker(view, truth.object)
        predicted.append(tracker.next(view))
        truths.append(truth)
    assert not any((each.object & each.hand).any() for each in predicted)
    return predicted, truths


def scores(predicted, truths, part):
    return mask_scores([getattr(each, part) for each in predicted], [getattr(each, part) for each in truths])


@pytest.mark.parametrize(
    "scene",
    [
        pytest.param(Scene(object_colours=(BLUE, GREEN), frames=32), id="two-tone", marks=pytest.mark.slow),
        pytest.param(Scene(object_colours=(KHAKI,), frames=32), id="like the table", marks=pytest.mark.slow),
        pytest.param(Scene(object_colours=(REDDISH_SKIN,), frames=32), id="like the skin"),
        pytest.param(
            Scene(object_colours=(DARK,), hand_colour=(60, 90, 60), frames=32),
            id="dark and glove",
            marks=pytest.mark.slow,
        ),
        pytest.param(Scene(table_colour=(60, 60, 70), frames=32), id="dark table", marks=pytest.mark.slow),
    ],
)
def test_object_and_hand_are_kept_apart(scene):
    predicted, truths = follow(scene)
    of_object = scores(predicted, truths, "object")
    assert of_object.region > 0.93
    assert of_object.contour > 0.95
    # From frame 14 on the hand is well in the view.
    assert scores(predicted[14:], truths[14:], "hand").region > 0.93


def test_without_a_hand_its_mask_is_empty():
    predicted, truths = follow(Scene(hand_frames=None, frames=15))
    assert scores(predicted, truths, "object").region > 0.95
    assert not any(each.hand.any() for each in predicted)


def test_shadow_is_neither_object_nor_hand():
    predicted, truths = follow(Scene(frames=30))
    extra = predicted[-1].hand & ~truths[-1].hand
    assert np.count_nonzero(extra) < 0.05 * np.count_nonzero(truths[-1].hand)


def test_without_poses_the_object_is_followed_by_colour():
    predicted, truths = follow(Scene(frames=28), with_poses=False)
    assert scores(predicted, truths, "object").region > 0.95


def test_change_of_exposure_black_frames_and_blur():
    gains = dict.fromkeys(range(16, 22), 0.6) | dict.fromkeys(range(22, 30), 1.3) | {12: 0.0, 20: 0.0}
    predicted, truths = follow(Scene(gains=gains, blurred=(24, 25), frames=30))
    for black in (12, 20):
        assert not predicted[black].object.any()
        assert not predicted[black].hand.any()
    lit = [frame for frame in range(30) if frame not in (12, 20)]
    found = scores([predicted[frame] for frame in lit], [truths[frame] for frame in lit], "object")
    assert found.region > 0.95
    assert found.region_per_frame.min() > 0.9


@pytest.mark.parametrize(
    "push",
    [
        pytest.param((0.0, 0.0), id="still", marks=pytest.mark.slow),
        pytest.param((0.004, 0.001), id="moved while hidden"),
    ],
)
def test_object_hidden_for_a_second_comes_back(push):
    predicted, truths = follow(Scene(hand_frames=(2, 200), hand_covers=(15, 44), push=push, frames=50))
    assert not predicted[30].object.any()
    assert region_similarity(predicted[30].hand, truths[30].hand) > 0.9
    back = scores(predicted[46:], truths[46:], "object")
    assert back.region_per_frame.min() > 0.93
    assert scores(predicted[48:], truths[48:], "hand").region > 0.8


def test_prior_of_the_caller_replaces_the_flow():
    view, truth = draw(Scene(), 0)
    tracker = MaskTracker(view, truth.object)
    # A gap of 27 frames: the flow cannot follow, a predicted silhouette can.
    later, moved = draw(Scene(hand_frames=(-20, -15)), 27)
    masks = tracker.next(later, object_prior=moved.object)
    assert region_similarity(masks.object, moved.object) > 0.9


@pytest.mark.slow
def test_same_views_give_the_same_masks():
    first, second = (follow(Scene(frames=12))[0] for _ in range(2))
    assert all((one.object == two.object).all() for one, two in zip(first, second, strict=True))


@pytest.mark.parametrize("mask", [np.zeros((518, 518), bool), np.ones((40, 40), bool), np.ones((518, 518), np.uint8)])
def test_bad_first_mask_is_refused(mask):
    view, _ = draw(Scene(), 0)
    with pytest.raises(EpisodeError, match="object's mask must be"):
        MaskTracker(view, mask)
