"""Poses where the board is not seen, and how the board lies, against drawn tables; the board's poses are given."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.board_pose import CameraPose
from egophys_core.perception.camera.table_poses import TablePoses, poses_over_table
from tests.perception.camera.board_scene import pose_error
from tests.perception.camera.table_film import MATRIX, film, sway, table_texture

BOARD = Board()


@pytest.fixture(scope="module")
def table() -> np.ndarray:
    return table_texture()


def located(poses: np.ndarray, frames: list[int], lie: np.ndarray) -> dict[int, CameraPose]:
    """What a board says that in truth lies otherwise: `lie` [4, 4] in the world, from a frame in its middle."""
    middle = np.eye(4)
    middle[:2, 3] = 0.0, 0.330
    noise = np.random.default_rng(3)
    made = {}
    for frame in frames:
        pose = middle @ np.linalg.inv(lie) @ poses[frame]
        pose[:3, 3] += noise.normal(0, 1e-4, 3)
        made[frame] = CameraPose(
            world_from_camera=pose,
            covariance=np.diag([1e-8] * 3 + [4e-9] * 3),
            tags=np.arange(12),
            rms_pixels=0.02,
            tag_growth=0.0,
            blur=0.5,
            log_focal=(0.0, 0.001),
        )
    return made


def lying(tilt_deg: float, height: float) -> np.ndarray:
    lie = np.eye(4)
    lie[:3, :3] = Rotation.from_rotvec(np.radians(tilt_deg) * np.array([0.6, 0.8, 0])).as_matrix()
    lie[:3, 3] = 0.0, 0.330, height
    return lie


def worst(found: TablePoses, poses: np.ndarray) -> tuple[float, float]:
    """Metres and degrees."""
    errors = [pose_error(pose, poses[frame]) for frame, pose in found.world_from_camera.items()]
    return max(error[0] for error in errors), max(error[1] for error in errors)


@pytest.mark.parametrize("seen", [[0], [7], [0, 1, 2, 14]])
def test_others_follow_from_few_frames_with_the_board(table, seen):
    poses = sway(15)
    found = poses_over_table(enumerate(film(table, poses)), located(poses, seen, lying(0, 0)), BOARD, MATRIX)
    assert found is not None
    assert sorted(found.world_from_camera) == list(range(15))
    # The board's noise is 0.17 mm; one frame of it is all there is.
    metres, degrees = worst(found, poses)
    assert metres < 1e-3
    assert degrees < 0.1
    assert found.note is None
    assert found.world_from_said == pytest.approx(np.eye(4))


@pytest.mark.parametrize(("tilt_deg", "height"), [(5.0, 0.030), (0.0, 0.020), (3.0, 0.0)])
def test_board_that_does_not_lie_on_the_table_is_noticed(table, tilt_deg, height):
    poses = sway(15)
    seen = located(poses, list(range(0, 15, 2)), lying(tilt_deg, height))
    found = poses_over_table(enumerate(film(table, poses)), seen, BOARD, MATRIX)
    assert found is not None
    assert found.tilt_deg == pytest.approx(tilt_deg, abs=0.3)
    assert found.height_m == pytest.approx(height, abs=0.003)
    assert "does not lie on the table" in (found.note or "")
    assert found.board.origin[2] == pytest.approx(BOARD.origin[2] + height, abs=0.003)
    # The world is that of the table, not of the board.
    metres, degrees = worst(found, poses)
    assert metres < 0.004
    assert degrees < 0.3


@pytest.mark.parametrize("height", [-0.06, 0.3])
def test_plane_that_is_no_table_says_nothing(table, height):
    # The top of a pillow before the board, or the floor below the table.
    poses = sway(10)
    seen = located(poses, list(range(0, 10, 2)), lying(0, height))
    assert poses_over_table(enumerate(film(table, poses)), seen, BOARD, MATRIX) is None


def test_table_without_texture_locates_nothing():
    poses = sway(8)
    blank = np.full((1200, 1200, 3), 140.0)
    seen = located(poses, [0, 4], lying(0, 0))
    assert poses_over_table(enumerate(film(blank, poses)), seen, BOARD, MATRIX) is None
