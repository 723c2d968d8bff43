"""Camera poses from a tag board, against images whose pose is known and against the recorded videos."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.errors import OptionsError
from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.board_pose import (
    BoardPoseFinder,
    CameraPose,
    NoPose,
    focal_error,
    intrinsics_warning,
)
from egophys_core.perception.camera.focal_length import focal_length
from egophys_core.perception.camera.lens import FullView, SquareView
from egophys_core.perception.camera.pose_track import track_poses
from egophys_core.perception.camera.video import open_video
from tests.perception.camera.board_scene import MATRIX, board_image, board_pixels, pose_error, random_pose

VIDEOS = Path(__file__).resolve().parents[3] / "shared" / "data" / "video"
BOARD = Board()
HAND = (120, 140, 190)


@pytest.fixture(scope="module")
def scenes() -> list[tuple[np.ndarray, np.ndarray]]:
    """(true pose, image) of six views with lens blur, noise, shading, exposure and JPEG."""
    random = np.random.default_rng(1)
    found = []
    for _ in range(6):
        pose = random_pose(random)
        look = {"blur": random.uniform(0.4, 0.8), "exposure": random.uniform(0.7, 1.1)}
        found.append((pose, board_image(BOARD, pose, random, samples=4, noise=random.uniform(1, 4), **look)))
    return found


@pytest.fixture(scope="module")
def finder() -> BoardPoseFinder:
    return BoardPoseFinder(BOARD, MATRIX)


def located(result: CameraPose | NoPose) -> CameraPose:
    assert isinstance(result, CameraPose), result.reason
    return result


def with_tags_hidden(image: np.ndarray, pose: np.ndarray, hidden: list[int]) -> np.ndarray:
    """The image with a patch of hand over some tags."""
    covered = image.copy()
    for tag in hidden:
        corner = BOARD.tag_corners[tag]
        square = corner + np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * (BOARD.tag_side + 0.006) - 0.003
        outline = board_pixels(BOARD, square, pose, MATRIX)
        cv2.fillConvexPoly(covered, (outline * 16).round().astype(np.int32), HAND, shift=4)
    return covered


def test_pose_is_within_a_third_of_a_millimetre(scenes, finder):
    errors = np.array([pose_error(located(finder.find(image)).world_from_camera, pose) for pose, image in scenes])
    # Measured 0.06 mm and 0.004 degrees on the mean of 30; asked for are 1 mm and 0.1 degrees.
    assert errors[:, 0].max() < 0.3e-3
    assert errors[:, 1].max() < 0.02
    assert errors[:, 0].mean() < 0.15e-3


def test_covariance_says_how_wrong_it_is(scenes, finder):
    shares = []
    for pose, image in scenes:
        found = located(finder.find(image))
        turn = Rotation.from_matrix(found.world_from_camera[:3, :3] @ pose[:3, :3].T).as_rotvec()
        error = np.concatenate([found.world_from_camera[:3, 3] - pose[:3, 3], turn])
        shares.append(error @ np.linalg.solve(found.covariance, error) / 6)
    # 1 is expected, a few times less with the floor; 5 would be errors beyond two standard deviations throughout.
    assert np.mean(shares) < 2
    assert np.max(shares) < 5


def test_same_image_same_pose(scenes, finder):
    image = scenes[0][1]
    first, again = located(finder.find(image)), located(finder.find(image))
    assert np.array_equal(first.world_from_camera, again.world_from_camera)


@pytest.mark.parametrize(
    "board", [Board(columns=3, rows=5, tag_side=0.05, gap=0.02, first_id=40, origin=(0.1, 0.3, 0))]
)
def test_another_board(board):
    random = np.random.default_rng(5)
    pose = random_pose(random)
    pose[:3, 3] += [0.1, 0, 0]
    found = located(BoardPoseFinder(board, MATRIX).find(board_image(board, pose, random, samples=4)))
    assert pose_error(found.world_from_camera, pose)[0] < 1e-3
    assert set(found.tags) <= set(range(40, 55))


def test_hand_over_half_of_the_board(scenes, finder):
    for pose, image in scenes[:3]:
        found = located(finder.find(with_tags_hidden(image, pose, [0, 1, 4, 5, 8, 9])))
        assert list(found.tags) == [2, 3, 6, 7, 10, 11]
        assert pose_error(found.world_from_camera, pose)[0] < 0.6e-3


def test_hand_over_parts_of_tags_does_not_pull_the_pose(scenes, finder):
    pose, image = scenes[0]
    covered = image.copy()
    # A finger across the board, which hides no tag entirely.
    ends = board_pixels(BOARD, np.array([(-0.02, 0.06), (0.2, 0.17)]), pose, MATRIX).round().astype(int)
    cv2.line(covered, tuple(map(int, ends[0])), tuple(map(int, ends[1])), HAND, 8)
    assert pose_error(located(finder.find(covered)).world_from_camera, pose)[0] < 0.6e-3


def test_fewer_than_six_tags_need_a_pose_shortly_before(scenes, finder):
    pose, image = scenes[0]
    before = located(finder.find(image))
    four = with_tags_hidden(image, pose, [0, 1, 4, 5, 8, 9, 10, 11])
    alone = finder.find(four)
    assert isinstance(alone, NoPose)
    assert "needed are 6" in alone.reason
    found = located(finder.find(four, near=before))
    assert pose_error(found.world_from_camera, pose)[0] < 1e-3
    assert np.trace(found.covariance) > 2 * np.trace(before.covariance)


def test_tags_in_one_row_are_not_enough(scenes, finder):
    pose, image = scenes[0]
    row = with_tags_hidden(image, pose, [4, 5, 6, 7, 8, 9, 10, 11])
    assert isinstance(finder.find(row, near=located(finder.find(image))), NoPose)


def test_no_board_black_and_hidden_frames_say_why(scenes, finder):
    pose, image = scenes[0]
    black = finder.find(np.zeros_like(image))
    assert isinstance(black, NoPose)
    assert "black" in black.reason
    gone = finder.find(with_tags_hidden(image, pose, list(range(12))), near=located(finder.find(image)))
    assert isinstance(gone, NoPose)
    assert "no tags found" in gone.reason
    noise = np.random.default_rng(0).integers(0, 256, image.shape, dtype=np.uint8)
    assert isinstance(finder.find(noise), NoPose)


def test_image_with_other_tags_has_no_pose(scenes, finder):
    other = Board(first_id=100)
    random = np.random.default_rng(2)
    assert isinstance(finder.find(board_image(other, scenes[0][0], random, samples=3)), NoPose)


def test_blur_costs_certainty_then_the_pose(scenes, finder):
    for sigma in (1.0, 1.5, 2.0, 4.0, 8.0):
        for pose, image in scenes[:3]:
            found = finder.find(cv2.GaussianBlur(image, (0, 0), sigma))
            assert sigma <= 1.0 or sigma < 4.0 or isinstance(found, NoPose)
            if isinstance(found, CameraPose):
                assert found.blur > sigma - 0.1
                assert pose_error(found.world_from_camera, pose)[0] < 1e-3
            else:
                assert sigma > 1.0, found.reason


@pytest.mark.parametrize("factor", [0.9, 0.98, 1.02, 1.1])
def test_wrong_focal_length_is_noticed(scenes, factor):
    matrix = MATRIX * [[factor], [factor], [1]]
    matrix[:2, 2] = MATRIX[:2, 2]
    finder = BoardPoseFinder(BOARD, matrix)
    poses = [located(finder.find(image)) for _, image in scenes]
    error, deviation = focal_error(poses)
    assert (error > 0) == (factor < 1)
    assert abs(error) > 5 * deviation
    assert "focal length" in (intrinsics_warning(poses) or "")


@pytest.mark.parametrize("factor", [pytest.param(0.9, marks=pytest.mark.slow), 1.1])
def test_right_focal_length_comes_back(scenes, factor):
    matrix = MATRIX * [[factor], [factor], [1]]
    matrix[:2, 2] = MATRIX[:2, 2]
    found = focal_length([image for _, image in scenes[:8]], BOARD, matrix)
    assert found is not None
    assert found.pixels == pytest.approx(577.3, abs=4 * found.deviation)
    assert found.deviation < 0.005 * 577.3
    assert "10." in found.note or "9.9" in found.note


def test_right_intrinsics_are_not_doubted(scenes, finder):
    assert intrinsics_warning([located(finder.find(image)) for _, image in scenes]) is None
    assert intrinsics_warning([]) is None


def test_undistorted_lens_is_noticed(scenes, finder):
    along = (np.arange(640) - 319.5) / 577.3
    x, y = np.meshgrid(along, along)
    stretch = 1 + 0.3 * (x * x + y * y)
    maps = [(value * stretch * 577.3 + 319.5).astype(np.float32) for value in (x, y)]
    poses = [located(finder.find(cv2.remap(image, *maps, cv2.INTER_CUBIC))) for _, image in scenes]
    assert intrinsics_warning(poses) is not None


@pytest.mark.parametrize("gap", [0.018, 0.013])
def test_wrong_side_or_gap_is_noticed(scenes, gap):
    finder = BoardPoseFinder(replace(BOARD, gap=gap), MATRIX)
    poses = [each for _, image in scenes if isinstance(each := finder.find(image), CameraPose)]
    assert not poses or "measure" in (intrinsics_warning(poses) or "")


def test_wrong_order_of_tags_has_no_pose(scenes):
    finder = BoardPoseFinder(replace(BOARD, columns=3, rows=4), MATRIX)
    assert all(isinstance(finder.find(image), NoPose) for _, image in scenes)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"columns": 1, "rows": 8}, "2 columns"),
        ({"columns": 2, "rows": 2}, "6 tags"),
        ({"tag_side": 60.0}, "60 mm"),
        ({"gap": 0.001}, "less than a cell"),
        ({"first_id": 580}, "36h11 has 0 to 586"),
        ({"origin": (0.0, float("nan"), 0.0)}, "finite"),
    ],
)
def test_boards_that_do_not_work_are_refused(changes, says):
    with pytest.raises(OptionsError, match=says):
        Board(**changes)


@pytest.mark.skipif(not VIDEOS.is_dir(), reason="the recorded videos (../shared/data/video) are not on this machine")
@pytest.mark.parametrize("name", ["towel_lift", "plush_pull"])
def test_recorded_videos(name):
    video = open_video(VIDEOS / name / "episode_0.mcap")
    view, square = FullView(video.camera), SquareView(video.camera)
    finder = BoardPoseFinder(BOARD, view.matrix)
    square_finder = BoardPoseFinder(BOARD, square.matrix)
    poses: list[CameraPose] = []
    stamps = []
    for index, frame in enumerate(video.frames()):
        if index >= 45:
            break
        poses.append(located(finder.find(view.image(frame.image), near=poses[-1] if poses else None)))
        stamps.append(frame.stamp_ns)
        if index % 20 == 0:
            small = located(square_finder.find(square.image(frame.image)))
            distance, turn = pose_error(square.to_raw_pose(small.world_from_camera), poses[-1].world_from_camera)
            assert distance < 1e-3
            assert turn < 0.05
    track = track_poses(stamps, np.array([pose.world_from_camera for pose in poses]))
    assert track.known.all()
    assert not track.inferred.any()
    # A head moves smoothly: third differences of white noise have 20 times its variance.
    jerk = np.diff(track.world_from_camera[:, :3, 3], n=3, axis=0)
    assert np.sqrt((jerk**2).sum(axis=1).mean() / 20) < 0.3e-3
    assert intrinsics_warning(poses) is None
