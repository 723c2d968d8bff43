from dataclasses import replace

import cv2
import numpy as np
import pytest

from egophys_core.perception.observation import Observation
from egophys_core.perception.overlay import (
    CONTROLLER_COLOUR,
    HAND_COLOUR,
    OBJECT_COLOUR,
    confidence_colours,
    draw_masks,
    draw_picture,
    draw_tracks,
    legend,
    zoomed,
)
from egophys_core.perception.overlay_window import SMALLEST_SHARE, Window, follow
from egophys_core.perception.stages import Masks
from tests.perception.observations import observations
from tests.perception.table_scene import SIDE

WINDOW = Window(centre=np.array([250.0, 270.0]), side=140.0)


@pytest.fixture(scope="module")
def observation() -> Observation:
    return observations(1, first=24)[0]


def without_marks(seen: Observation) -> Observation:
    """Nothing found but the view."""
    nothing = np.zeros((SIDE, SIDE), bool)
    return replace(
        seen,
        masks=Masks(object=nothing, hand=nothing),
        points=np.zeros((0, 3)),
        confidence=np.zeros(0),
        pixels=np.zeros((0, 2)),
        visible=np.zeros(0, bool),
        mesh_pixels=np.zeros((0, 2)),
        mesh_edges=np.zeros((0, 2), int),
        hand_points=np.zeros((0, 3)),
    )


def changed(picture: np.ndarray, image: np.ndarray) -> np.ndarray:
    return (picture != image).any(axis=2)


def test_nothing_found_leaves_the_image_as_it_is(observation):
    empty = without_marks(observation)
    assert (draw_masks(empty) == empty.view.image).all()
    assert (draw_tracks(empty) == empty.view.image).all()


def test_masks_are_tinted_and_nothing_far_from_them_changes(observation):
    seen = replace(observation, hand_points=np.zeros((0, 3)))
    picture = draw_masks(seen)
    both = seen.masks.object | seen.masks.hand
    assert not changed(picture, seen.view.image)[~cv2.dilate(both.astype(np.uint8), np.ones((5, 5))).astype(bool)].any()
    for mask, colour in ((seen.masks.object, OBJECT_COLOUR), (seen.masks.hand, HAND_COLOUR)):
        inner = cv2.erode(mask.astype(np.uint8), np.ones((7, 7))).astype(bool)
        before, after = (np.abs(each[inner] - np.array(colour, float)).mean() for each in (seen.view.image, picture))
        assert after < 0.85 * before


def test_drawing_does_not_change_the_observation(observation):
    image, pixels, masks = observation.view.image.copy(), observation.pixels.copy(), observation.masks.object.copy()
    draw_picture(observation, window=WINDOW, tails=[pixels + 3], label="view 1")
    assert (observation.view.image == image).all()
    assert (observation.pixels == pixels).all()
    assert (observation.masks.object == masks).all()


def test_a_seen_point_is_a_dot_in_the_colour_of_its_confidence_an_inferred_one_a_ring(observation):
    seen = replace(
        without_marks(observation),
        view=replace(observation.view, image=np.zeros((SIDE, SIDE, 3), np.uint8)),
        points=np.zeros((3, 3)),
        confidence=np.array([1.0, 0.5, 0.0]),
        pixels=np.array([[100.0, 120.0], [200.0, 220.0], [300.0, 320.0]]),
        visible=np.array([True, False, False]),
    )
    picture = draw_tracks(seen)
    colours = confidence_colours(seen.confidence)
    assert (picture[120, 100] == colours[0]).all()
    assert not picture[220, 200].any()
    assert picture[218:223, 198:203].any()
    assert not picture[310:330, 310:330].any(), "a point of which nothing is known is not drawn"


def test_a_tail_leads_to_where_the_point_was_and_breaks_where_it_is_not_known(observation):
    seen = replace(
        without_marks(observation),
        view=replace(observation.view, image=np.zeros((SIDE, SIDE, 3), np.uint8)),
        points=np.zeros((1, 3)),
        confidence=np.ones(1),
        pixels=np.array([[100.0, 100.0]]),
        visible=np.ones(1, bool),
    )
    whole = draw_tracks(seen, tails=[np.array([[60.0, 100.0]]), np.array([[80.0, 100.0]])])
    assert whole[100, 62:98].any(axis=1).all()
    broken = draw_tracks(seen, tails=[np.array([[60.0, 100.0]]), np.full((1, 2), np.nan)])
    assert not broken[100, 50:94].any()


def test_mesh_and_hand_points_are_drawn_where_they_are(observation):
    seen = replace(
        without_marks(observation),
        mesh_pixels=np.array([[100.0, 100.0], [140.0, 100.0], [np.nan, np.nan]]),
        mesh_edges=np.array([[0, 1], [1, 2]]),
        hand_points=np.array([[0.0, 0.0, 0.0], [np.nan] * 3]),
    )
    picture = draw_tracks(seen)
    moved = changed(picture, seen.view.image)
    assert moved[100, 102:138].all()
    from_pose = np.linalg.inv(seen.view.world_from_camera)[:3, 3]
    x, y = (seen.view.camera_matrix @ from_pose / from_pose[2])[:2].round().astype(int)
    assert picture[y, x] == pytest.approx(CONTROLLER_COLOUR, abs=10)
    moved[97:104, 97:144] = False
    moved[y - 6 : y + 7, x - 6 : x + 7] = False
    assert not moved.any()


@pytest.mark.parametrize("odd", [np.nan, np.inf, -np.inf, 1e12, -1e12])
def test_places_that_are_none_or_far_away_do_no_harm(observation, odd):
    seen = replace(
        observation,
        pixels=np.full_like(observation.pixels, odd),
        mesh_pixels=np.full_like(observation.mesh_pixels, odd),
        hand_points=np.full_like(observation.hand_points, odd),
        confidence=np.full_like(observation.confidence, odd),
    )
    expected = without_marks(replace(observation))
    expected = replace(expected, masks=observation.masks)
    tails = [np.full_like(seen.pixels, odd)]
    assert (draw_picture(seen, window=WINDOW, tails=tails) == draw_picture(expected, window=WINDOW)).all()


def test_a_view_without_a_pose_says_so(observation):
    lost = replace(observation, view=replace(observation.view, world_from_camera=np.full((4, 4), np.nan)))
    known, unknown = (draw_picture(each, window=WINDOW)[:50, :250] for each in (observation, lost))
    assert changed(unknown, known).sum() > 100


def test_the_zoomed_view_is_that_of_a_camera(observation):
    closer = zoomed(observation, WINDOW)
    seen = np.column_stack([observation.points, np.ones(len(observation.points))])
    seen = (np.linalg.inv(closer.view.world_from_camera) @ seen.T)[:3]
    pixels = (closer.view.camera_matrix @ seen / seen[2])[:2].T
    assert np.abs(pixels - closer.pixels).max() < 1e-6
    inside = ((pixels > 3) & (pixels < SIDE - 4)).all(axis=1) & observation.visible
    assert inside.sum() > 50
    x, y = np.rint(pixels[inside]).astype(int).T
    assert closer.masks.object[y, x].mean() > 0.97
    x0, y0 = np.rint(WINDOW.corner).astype(int)
    part = observation.view.image[y0 : y0 + 140, x0 : x0 + 140].astype(float).mean(axis=(0, 1))
    assert closer.view.image.mean(axis=(0, 1)) == pytest.approx(part, abs=2)


def test_window_holds_the_object_follows_it_calmly_and_stays_in_the_view():
    def box(x0: int, y0: int, x1: int, y1: int) -> np.ndarray:
        mask = np.zeros((400, 400), bool)
        mask[y0:y1, x0:x1] = True
        return mask

    window = follow(box(100, 150, 200, 210))
    assert window.centre == pytest.approx([149.5, 179.5])
    assert window.side == pytest.approx(150)
    later = follow(box(140, 150, 240, 210), window)
    assert 0 < later.centre[0] - window.centre[0] < 10
    for _ in range(100):
        later = follow(box(140, 150, 240, 210), later)
    assert later.centre == pytest.approx([189.5, 179.5], abs=0.1)
    corner = follow(box(0, 0, 60, 60))
    assert corner.corner.min() >= -0.5
    assert follow(box(0, 0, 400, 400)).side == 400
    assert follow(box(7, 7, 8, 8)).side == SMALLEST_SHARE * 400
    nothing = box(0, 0, 0, 0)
    assert follow(nothing, window) is window
    assert follow(nothing).side == 400


def test_colours_tell_confidence():
    colours = confidence_colours(np.array([0.0, 0.5, 1.0, np.nan, 7.0])).astype(int)
    red, blue = colours[:, 2], colours[:, 0]
    assert red[0] > 180 > 60 > blue[0]
    assert blue[2] > 200 > 60 > red[2]
    assert (colours[3] == colours[0]).all()
    assert (colours[4] == colours[2]).all()


@pytest.mark.parametrize("width", [1, 300, 2000])
def test_legend_has_the_width_asked_for(width):
    assert legend(width).shape == (32, width, 3)
