"""The object in the first views: whatever its colour, with rivals, from a box or point, and when there is none."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.evaluation.masks import region_similarity
from egophys_core.perception.masks.object_finder import find_object
from tests.perception.table_scene import BLUE, DARK, GREEN, KHAKI, RED, TAN, Scene, draw


def first_views(scene, count=5):
    frames = [draw(scene, frame) for frame in range(count)]
    return [view for view, _ in frames], frames[0][1].object


def without_poses(views):
    return [replace(view, world_from_camera=np.full((4, 4), np.nan)) for view in views]


@pytest.mark.parametrize("colours", [(GREEN,), (BLUE, RED), (DARK,), (KHAKI,)])
def test_object_is_found_whatever_its_colour(colours):
    views, truth = first_views(Scene(object_colours=colours))
    found = find_object(views)
    assert region_similarity(found.mask, truth) > 0.95
    assert found.warning == ""


def test_object_of_the_colour_of_the_table_is_found_by_its_texture():
    views, truth = first_views(Scene(object_colours=(TAN,), texture=0.5))
    assert region_similarity(find_object(views).mask, truth) > 0.9


def test_without_poses_the_object_stands_out_from_the_border():
    views, truth = first_views(Scene())
    assert region_similarity(find_object(without_poses(views)).mask, truth) > 0.95


def test_of_two_objects_the_larger_is_taken_and_the_other_named():
    views, truth = first_views(Scene(seconds=((0.2, 0.12),)))
    found = find_object(views)
    assert region_similarity(found.mask, truth) > 0.95
    other = found.others[0].box
    assert "2 things on the table" in found.warning
    assert f"--object-box with one of: {' '.join(map(str, other))}" in found.warning
    chosen = find_object(views, box=other)
    assert not (chosen.mask & truth).any()
    assert np.count_nonzero(chosen.mask) > 500


def test_box_and_point_choose_the_object():
    views, truth = first_views(Scene())
    y, x = np.nonzero(truth)
    box = (x.min() - 12, y.min() - 12, x.max() + 12, y.max() + 12)
    assert region_similarity(find_object(views, box=box).mask, truth) > 0.95
    assert region_similarity(find_object(views, point=(x.mean(), y.mean())).mask, truth) > 0.95


def test_thing_in_a_board_is_no_object():
    views, _ = first_views(Scene())
    around = np.array([[-0.2, -0.2, 0], [0.2, -0.2, 0], [0.2, 0.2, 0], [-0.2, 0.2, 0]])
    with pytest.raises(EpisodeError, match="no object found in the first 5 views"):
        find_object(views, board_corners=around)


def test_thing_that_does_not_stay_is_no_object():
    # The object of the later views is elsewhere on the table: what is in the first is a hand that moves on.
    views, _ = first_views(Scene(), count=1)
    later, _ = draw(Scene(hand_frames=(-40, -30), push=(0.007, 0.0)), 1)
    with pytest.raises(EpisodeError, match="--object-box"):
        find_object([*views, later])


def test_empty_table_has_no_object():
    views, _ = first_views(Scene(object_colours=(TAN,), texture=0.0), count=1)
    covered = [replace(views[0], image=np.full_like(views[0].image, 120))]
    with pytest.raises(EpisodeError, match="nothing on the table differs"):
        find_object(covered)


@pytest.mark.parametrize("box", [(10, 10, 5, 20), (-3, 0, 50, 50), (0, 0, 600, 20), (np.nan, 0, 9, 9), (5, 5, 7, 7)])
def test_bad_boxes_are_refused(box):
    views, _ = first_views(Scene(), count=1)
    with pytest.raises(EpisodeError, match="in a view of 518 x 518"):
        find_object(views, box=box)


@pytest.mark.parametrize("point", [(-1, 5), (5, 518), (np.nan, 5)])
def test_bad_points_are_refused(point):
    views, _ = first_views(Scene(), count=1)
    with pytest.raises(EpisodeError, match="must be x y in pixels"):
        find_object(views, point=point)


def test_no_views_are_refused():
    with pytest.raises(EpisodeError, match="no views"):
        find_object([])


def test_black_first_view_is_refused():
    views, _ = first_views(Scene(gains={0: 0.0}), count=2)
    with pytest.raises(EpisodeError, match="the first view is black"):
        find_object(views)
