"""Lifting against planes whose depth is written down here."""

import numpy as np
import pytest

from egophys_core.errors import EpisodeError, OptionsError
from egophys_core.perception.stages import PointMap, Tracks
from egophys_core.perception.surface.lifting import LiftOptions, depths, lift, sample

SIZE, FOCAL = 32, 40.0
LOOKS_DOWN = np.array([[1.0, 0, 0, 0.1], [0, -1, 0, 0.2], [0, 0, -1, 0.6], [0, 0, 0, 1]])
"""Camera 0.6 m above the table, looking straight down."""


def rays(pixels: np.ndarray) -> np.ndarray:
    centre = (SIZE - 1) / 2
    return np.concatenate([(pixels - centre) / FOCAL, np.ones((*pixels.shape[:-1], 1))], axis=-1)


def seen_at(pixels: np.ndarray, depth: np.ndarray | float, pose: np.ndarray = LOOKS_DOWN) -> np.ndarray:
    return (rays(pixels) * np.broadcast_to(depth, pixels.shape[:-1])[..., None]) @ pose[:3, :3].T + pose[:3, 3]


def grid() -> np.ndarray:
    rows, columns = np.mgrid[:SIZE, :SIZE]
    return np.stack([columns, rows], axis=-1).astype(np.float64)


def map_at(depth: np.ndarray | float, confidence: float = 0.9) -> PointMap:
    points = seen_at(grid(), depth).astype(np.float32)
    return PointMap(points=points, confidence=np.full((SIZE, SIZE), confidence, np.float32))


def with_unknown(point_map: PointMap, row: int, column: int) -> PointMap:
    points, confidence = point_map.points.copy(), point_map.confidence.copy()
    points[row, column] = np.nan
    confidence[row, column] = 0.0
    return PointMap(points=points, confidence=confidence)


def one_view(pixels: np.ndarray) -> Tracks:
    return Tracks(pixels=pixels[None].astype(np.float32), visible=np.isfinite(pixels).all(axis=1)[None])


def test_between_pixels_of_a_plane_the_point_is_exact():
    pixels = np.random.default_rng(0).uniform(0, SIZE - 1, (200, 2))
    points, confidence = sample(map_at(0.5), pixels, LOOKS_DOWN)
    np.testing.assert_allclose(points, seen_at(pixels, 0.5), atol=1e-6)
    np.testing.assert_allclose(confidence, 0.9, atol=1e-6)


def test_no_point_lies_between_two_surfaces():
    near, far = 0.4, 0.5
    depth = np.where(grid()[..., 0] < 10, near, far)
    for x in (9.1, 9.4, 9.6, 9.9):
        found, _ = sample(map_at(depth), np.array([[x, 5.3]]), LOOKS_DOWN)
        assert depths(found, LOOKS_DOWN)[0] == pytest.approx(near if x < 9.5 else far, abs=1e-6)


def test_unknown_pixel_next_to_it_is_left_out_and_the_nearest_decides():
    point_map = with_unknown(map_at(0.5), row=8, column=8)
    found, confidence = sample(point_map, np.array([[7.2, 8.0], [7.8, 8.0]]), LOOKS_DOWN)
    assert depths(found[:1], LOOKS_DOWN)[0] == pytest.approx(0.5, abs=1e-6)
    assert confidence[0] == pytest.approx(0.9, abs=1e-6)
    assert np.isnan(found[1]).all()
    assert confidence[1] == 0.0


@pytest.mark.parametrize("place", [(-0.6, 5), (5, SIZE - 0.4), (1e6, 1e6), (np.nan, 5), (5, np.inf), (-np.inf, 3)])
def test_outside_the_image_nothing_is_known(place):
    found, confidence = sample(map_at(0.5), np.array([place]), LOOKS_DOWN)
    assert np.isnan(found).all()
    assert confidence[0] == 0.0


def test_the_outer_half_of_the_border_pixels_is_in_the_image():
    found, _ = sample(map_at(0.5), np.array([[-0.4, -0.4], [SIZE - 0.6, SIZE - 0.6]]), LOOKS_DOWN)
    np.testing.assert_allclose(found, seen_at(np.array([[0, 0], [SIZE - 1, SIZE - 1]]), 0.5), atol=1e-6)


@pytest.mark.parametrize("kept", [0.2001, 0.7, 1.4999])
@pytest.mark.parametrize("dropped", [0.1999, 1.5001])
def test_depth_range_of_the_paper_is_along_the_axis_of_the_camera(kept, dropped):
    # Far from the centre the distance to the camera is larger than the depth: only the depth may count.
    corner = one_view(np.array([[1.0, 1.0]]))
    assert np.isfinite(lift(corner, [map_at(kept)], LOOKS_DOWN[None]).points).all()
    assert np.isnan(lift(corner, [map_at(dropped)], LOOKS_DOWN[None]).points).all()


def test_confidence_below_the_threshold_gives_no_point():
    here = one_view(np.array([[5.5, 5.5]]))
    above, below = (lift(here, [map_at(0.5, each)], LOOKS_DOWN[None]) for each in (0.51, 0.49))
    assert above.confidence[0, 0] == pytest.approx(0.51, abs=1e-6)
    assert np.isnan(below.points).all()
    assert below.confidence[0, 0] == 0.0


def test_hidden_tracks_and_views_without_pose_give_no_points():
    pixels = np.full((3, 2, 2), 5.0, np.float32)
    pixels[1, 1] = np.nan
    visible = np.isfinite(pixels).all(axis=2)
    poses = np.stack([LOOKS_DOWN] * 3)
    poses[2] = np.nan
    lifted = lift(Tracks(pixels=pixels, visible=visible), (map_at(0.5) for _ in range(3)), poses)
    assert np.isfinite(lifted.points).all(axis=2).tolist() == [[True, True], [True, False], [False, False]]
    assert (lifted.confidence > 0).tolist() == [[True, True], [True, False], [False, False]]


@pytest.mark.parametrize("maps", [0, 1, 3])
def test_one_map_a_view_is_asked_for(maps):
    tracks = Tracks(pixels=np.zeros((2, 1, 2), np.float32), visible=np.ones((2, 1), bool))
    with pytest.raises(EpisodeError, match="for 2 tracked views"):
        lift(tracks, [map_at(0.5)] * maps, np.stack([LOOKS_DOWN] * 2))


def test_one_pose_a_view_is_asked_for():
    with pytest.raises(EpisodeError, match=r"\[1, 4, 4\], got \(2, 4, 4\)"):
        lift(one_view(np.zeros((1, 2))), [map_at(0.5)], np.stack([LOOKS_DOWN] * 2))


def test_no_tracks_no_points():
    tracks = Tracks(pixels=np.zeros((1, 0, 2), np.float32), visible=np.zeros((1, 0), bool))
    assert lift(tracks, [map_at(0.5)], LOOKS_DOWN[None]).points.shape == (1, 0, 3)


def test_thresholds_out_of_range_are_refused():
    with pytest.raises(OptionsError, match="min_confidence"):
        LiftOptions(min_confidence=1.5)
