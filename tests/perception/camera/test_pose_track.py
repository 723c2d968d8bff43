"""Poses of frames put together; short gaps interpolated, long ones left."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.errors import EpisodeError
from egophys_core.perception.camera.pose_track import track_poses

STEP_NS = 40_000_000
AXIS = np.array([0.3, -0.5, 0.8])


def true_pose(frame: int) -> np.ndarray:
    """Constant speed and constant turning, which interpolation must give back exactly."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(0.02 * frame * AXIS).as_matrix()
    pose[:3, 3] = [0.01 * frame, -0.2, 0.5 + 0.003 * frame]
    return pose


def poses_without(frames: int, missing: list[int]) -> np.ndarray:
    poses = np.array([true_pose(frame) for frame in range(frames)])
    poses[missing] = np.nan
    return poses


def test_short_gap_is_interpolated_and_said():
    missing = [3, 7, 8, 9]
    track = track_poses(np.arange(15) * STEP_NS, poses_without(15, missing))
    assert np.flatnonzero(track.inferred).tolist() == missing
    assert track.known.all()
    for frame in range(15):
        assert track.world_from_camera[frame] == pytest.approx(true_pose(frame), abs=1e-9)


def test_gap_of_half_a_second_is_the_longest():
    # 12.5 steps are half a second: 12 steps from pose to pose are filled, 13 are not.
    for hidden, is_filled in ((11, True), (12, False)):
        missing = list(range(5, 5 + hidden))
        track = track_poses(np.arange(25) * STEP_NS, poses_without(25, missing))
        assert track.inferred[missing].all() == is_filled
        assert np.isnan(track.world_from_camera[missing]).all() != is_filled
        assert track.known.sum() == (25 if is_filled else 25 - hidden)


def test_dropped_frames_count_as_time():
    # Frames 5 and 6 are 40 ms apart from their neighbours in number, but 0.6 s passed between.
    stamps = np.arange(12) * STEP_NS
    stamps[6:] += 600_000_000
    track = track_poses(stamps, poses_without(12, [5]))
    assert not track.known[5]


def test_ends_are_not_made_up():
    track = track_poses(np.arange(6) * STEP_NS, poses_without(6, [0, 5]))
    assert track.known.tolist() == [False, True, True, True, True, False]


def test_nothing_found_at_all():
    assert not track_poses(np.arange(4) * STEP_NS, poses_without(4, [0, 1, 2, 3])).known.any()
    assert len(track_poses([], np.zeros((0, 4, 4))).known) == 0


@pytest.mark.parametrize("stamps", [[0, 1], [0, 2, 1], [0, 1, 1]])
def test_stamps_must_fit(stamps):
    with pytest.raises(EpisodeError, match="strictly increasing"):
        track_poses(stamps, poses_without(3, []))
