"""The whole segmenter: one pair of masks a view, in order, nothing held back, a warning where it had to choose."""

import warnings

import pytest

from egophys_core.errors import EpisodeError
from egophys_core.evaluation.masks import region_similarity
from egophys_core.perception.masks.colour_segmenter import ColourSegmenter
from tests.perception.table_scene import Scene, draw


def test_masks_come_one_a_view_and_without_keeping_the_views():
    scene, taken = Scene(frames=20), []

    def views():
        for frame in range(scene.frames):
            taken.append(frame)
            yield draw(scene, frame)[0]

    stream = ColourSegmenter(still_views=6).masks(views())
    first = next(stream)
    assert taken == [0, 1, 2, 3, 4, 5]
    assert region_similarity(first.object, draw(scene, 0)[1].object) > 0.95
    rest = list(stream)
    assert len(rest) == 19
    assert region_similarity(rest[-1].object, draw(scene, 19)[1].object) > 0.93


def test_video_shorter_than_the_still_views_is_segmented():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(list(ColourSegmenter().masks(draw(Scene(), frame)[0] for frame in range(3)))) == 3


def test_two_objects_warn():
    views = [draw(Scene(seconds=((0.2, 0.12),)), frame)[0] for frame in range(2)]
    with pytest.warns(UserWarning, match="2 things on the table"):
        list(ColourSegmenter().masks(views))


def test_no_views_are_refused():
    with pytest.raises(EpisodeError, match="no views"):
        list(ColourSegmenter().masks([]))


def test_black_views_at_the_start_and_among_the_still_ones_are_passed_over():
    scene = Scene(gains={0: 0.0, 1: 0.0, 4: 0.0, 6: 0.0}, hand_frames=None, frames=8)
    drawn = [draw(scene, frame) for frame in range(8)]
    masks = list(ColourSegmenter(still_views=5).masks(view for view, _ in drawn))
    assert len(masks) == 8
    assert not any(masks[frame].object.any() for frame in (0, 1, 4, 6))
    assert all(region_similarity(masks[frame].object, drawn[frame][1].object) > 0.95 for frame in (2, 3, 5, 7))
