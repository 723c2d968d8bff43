"""The drawn videos are what their truth says."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from benchmarks.drawn_video import (
    FOCAL,
    MATRIX,
    SCENES,
    SIZE,
    Drawing,
    camera_pose,
    draw_video,
    folded_sheet,
    write_bag,
)
from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.board_pose import BoardPoseFinder, CameraPose
from egophys_core.perception.camera.video import open_video
from egophys_core.recording import read_episode


@pytest.fixture(scope="module", params=list(SCENES))
def drawing(request) -> Drawing:
    return next(draw_video(request.param, [75]))


def pixels_of(drawing: Drawing) -> np.ndarray:
    homogeneous = np.column_stack([drawing.points, np.ones(len(drawing.points))])
    seen = (np.linalg.inv(drawing.world_from_camera) @ homogeneous.T)[:3]
    return (MATRIX @ seen / seen[2])[:2].T


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_folding_keeps_lengths(share):
    material = np.random.default_rng(0).uniform(-1, 1, (200, 2))
    step = 1e-5
    for direction, length in (([step, 0], 0.13 * step), ([0, step], 0.10 * step)):
        moved = folded_sheet(material + direction, share) - folded_sheet(material, share)
        assert np.linalg.norm(moved, axis=1) == pytest.approx(length, rel=1e-3)


@pytest.mark.parametrize("seconds", [0.0, 0.9, 2.1])
def test_camera_pose_is_rigid(seconds):
    pose = camera_pose(seconds)
    assert pose[:3, :3] @ pose[:3, :3].T == pytest.approx(np.eye(3))
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)


def test_board_is_drawn_where_the_pose_has_it(drawing):
    found = BoardPoseFinder(Board(), MATRIX).find(drawing.image)
    assert isinstance(found, CameraPose)
    assert np.linalg.norm(found.world_from_camera[:3, 3] - drawing.world_from_camera[:3, 3]) < 5e-4


def test_visible_points_lie_in_the_mask_and_cover_it(drawing):
    pixels = pixels_of(drawing)[drawing.visible]
    columns, rows = np.rint(pixels).astype(int).T
    assert drawing.object_mask[rows, columns].mean() > 0.96
    y, x = np.nonzero(drawing.object_mask)
    assert np.percentile(cKDTree(pixels).query(np.column_stack([x, y]))[0], 99) < 8


def test_hidden_points_lie_behind_others():
    drawing = next(draw_video("drawn_push", [0]))  # no hand yet
    assert 0.5 < drawing.visible.mean() < 0.9
    hidden = drawing.points[~drawing.visible]
    eye = drawing.world_from_camera[:3, 3]
    pixels = pixels_of(drawing)
    seen = np.flatnonzero(drawing.visible)
    near, index = cKDTree(pixels[seen]).query(pixels[~drawing.visible])
    before = np.linalg.norm(drawing.points[seen[index]] - eye, axis=1) < np.linalg.norm(hidden - eye, axis=1)
    assert before[near < 5].mean() > 0.9


def test_bag_holds_the_drawing(drawing, tmp_path):
    later = Drawing(**{**vars(drawing), "stamp_ns": drawing.stamp_ns + 33_333_333})
    bag = write_bag(tmp_path / "bag", [drawing, later])
    video = open_video(bag)
    assert (video.camera.width, video.camera.matrix[0, 0]) == (SIZE, FOCAL)
    frame = next(video.frames())
    assert frame.stamp_ns == drawing.stamp_ns
    assert np.abs(frame.image.astype(int) - drawing.image).mean() < 4
    episode = read_episode(bag)
    assert episode.points[0] == pytest.approx(drawing.points[drawing.visible], abs=1e-6)
    assert episode.point_ids.tolist() == np.flatnonzero(drawing.visible).tolist()
