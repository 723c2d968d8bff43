from dataclasses import replace

import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.evaluation.perception import (
    PointPaths,
    TrackedViews,
    pair_frames,
    pixels_of,
    points_in_masks,
    score_points,
    score_tracks,
)

STEP_NS = 33_333_333
FRAMES = 40
MATRIX = np.array([[460.0, 0, 258.5], [0, 460.0, 258.5], [0, 0, 1]])
SHAPE = np.stack(np.meshgrid(np.arange(20) * 0.006, np.arange(15) * 0.006, [0.0]), axis=-1).reshape(-1, 3)


def motion(shape: np.ndarray) -> np.ndarray:
    """[T, N, 3]: still for half the time, then shifted and stretched."""
    share = np.clip(np.arange(FRAMES) - 20, 0, None)[:, None, None]
    return shape + share * np.array([0.002, 0.001, 0.0015]) + 0.01 * share * shape[None] * [1, 0, 0]


def stamps(count: int = FRAMES, offset_ns: int = 0) -> np.ndarray:
    return 10**18 + np.arange(count, dtype=np.int64) * STEP_NS + offset_ns


def paths(points: np.ndarray, offset_ns: int = 0) -> PointPaths:
    return PointPaths(stamps_ns=stamps(len(points), offset_ns), points=points)


def camera(frame: int) -> np.ndarray:
    """Looks straight down from half a metre, and moves."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = 0.06 + 0.001 * frame, 0.04, 0.5
    return pose


def views(points: np.ndarray) -> TrackedViews:
    poses = np.stack([camera(frame) for frame in range(len(points))])
    pixels = np.stack([pixels_of(each, MATRIX, pose) for each, pose in zip(points, poses, strict=True)])
    return TrackedViews(
        paths=paths(points),
        pixels=pixels,
        visible=np.isfinite(pixels).all(axis=2),
        world_from_camera=poses,
        camera_matrix=MATRIX,
        size=(518, 518),
    )


MEASURED = motion(SHAPE[::7] * 0.9 + [0.004, 0.003, 0])
FOUND = motion(SHAPE)


def test_frames_are_paired_by_the_nearest_stamp():
    assert pair_frames(np.array([0, 10, 20, 30]), np.array([-1, 12, 13, 26])).tolist() == [0, 1, -1, 3]
    assert pair_frames(np.array([5]), np.array([5, 6])).tolist() == [0]
    assert pair_frames(np.array([5]), np.array([6])).tolist() == [-1]
    assert pair_frames(np.array([0, 10]), np.zeros(0, int)).tolist() == [-1, -1]
    assert pair_frames(np.zeros(0, int), np.array([1])).tolist() == []


def test_what_is_exact_has_no_error_between_the_points_too():
    scores = score_points(paths(FOUND), paths(MEASURED, offset_ns=3_000_000))
    assert scores.mean_m < 1e-6
    assert (scores.coverage, scores.id_stability) == (1.0, 1.0)


def test_an_offset_off_the_surface_is_the_error():
    scores = score_points(paths(FOUND + [0, 0, 0.004]), paths(MEASURED))
    assert scores.mean_m == pytest.approx(0.004, abs=1e-5)
    assert scores.p95_m == pytest.approx(0.004, abs=1e-5)


def test_drift_along_the_surface_after_the_start_is_an_error():
    drift = np.linspace(0, 0.03, FRAMES)
    scores = score_points(paths(FOUND + drift[:, None, None] * [1.0, 0, 0]), paths(MEASURED))
    assert scores.mean_m == pytest.approx(np.abs(drift - drift[:15].mean()).mean(), rel=0.05)
    assert scores.id_stability < 0.96


def test_frames_and_points_that_are_missing_lower_the_coverage_alone():
    kept = np.r_[0:20, 30:40]
    some = PointPaths(stamps_ns=stamps()[kept], points=FOUND[kept])
    scores = score_points(some, paths(MEASURED))
    assert scores.coverage == pytest.approx(0.75)
    assert scores.mean_m < 1e-6
    hidden = FOUND.copy()
    hidden[25:, SHAPE[:, 0] < 0.03] = np.nan
    scores = score_points(paths(hidden), paths(MEASURED))
    assert 0.8 < scores.coverage < 0.95
    assert scores.mean_m < 1e-6


def test_a_point_with_nothing_reconstructed_near_it_counts_as_missing():
    beside = np.concatenate([MEASURED, MEASURED + [0.5, 0, 0]], axis=1)
    assert score_points(paths(FOUND), paths(beside)).coverage == pytest.approx(0.5)


def test_tracks_of_what_is_exact_are_exact():
    scores = score_tracks(views(FOUND), paths(MEASURED))
    assert (scores.delta_avg, scores.average_jaccard, scores.occlusion_accuracy) == (1.0, 1.0, 1.0)


def test_tracks_that_are_off_by_pixels():
    seen = views(FOUND)
    shifted = replace(seen, pixels=seen.pixels + [3 * 518 / 256, 0])
    # 3 pixels of the 256: beyond thresholds 1 and 2, within 4, 8 and 16.
    assert score_tracks(shifted, paths(MEASURED)).delta_avg == pytest.approx(0.6)


def test_tracks_said_to_be_hidden_lower_the_occlusion_accuracy_alone():
    seen = views(FOUND)
    visible = seen.visible.copy()
    visible[30:] = False
    scores = score_tracks(replace(seen, visible=visible), paths(MEASURED))
    assert scores.delta_avg == 1.0
    assert scores.occlusion_accuracy == pytest.approx(29 / 39)


def test_true_poses_show_what_wrong_ones_hide():
    seen = views(FOUND)
    wrong = seen.world_from_camera.copy()
    wrong[1:, 0, 3] += 0.02
    pixels = np.stack([pixels_of(each, MATRIX, pose) for each, pose in zip(FOUND, wrong, strict=True)])
    fooled = replace(seen, pixels=pixels, world_from_camera=wrong)
    assert score_tracks(fooled, paths(MEASURED)).delta_avg == 1.0
    assert score_tracks(fooled, paths(MEASURED), poses=seen.world_from_camera).delta_avg < 0.5


def test_views_without_a_pose_are_left_out():
    seen = views(FOUND)
    poses = seen.world_from_camera.copy()
    poses[10:20] = np.nan
    scores = score_tracks(replace(seen, world_from_camera=poses), paths(MEASURED))
    assert scores.delta_avg == 1.0
    poses[:] = np.nan
    assert np.isnan(score_tracks(replace(seen, world_from_camera=poses), paths(MEASURED)).delta_avg)


def test_points_in_masks_is_the_share_of_projections_inside():
    seen = views(FOUND)
    masks = np.zeros((FRAMES, 518, 518), bool)
    assert points_in_masks(masks, seen, paths(MEASURED)) == 0
    masks[:20] = True
    assert points_in_masks(masks, seen, paths(MEASURED)) == pytest.approx(0.5)
    assert np.isnan(points_in_masks(masks, seen, paths(np.full_like(MEASURED, np.nan))))


def test_points_behind_the_camera_have_no_pixels():
    pixels = pixels_of(np.array([[0.06, 0.04, 0.6], [0.06, 0.04, 0.0], [np.nan] * 3]), MATRIX, camera(0))
    assert np.isfinite(pixels).all(axis=1).tolist() == [False, True, False]
    assert pixels[1] == pytest.approx([258.5, 258.5])


def test_bad_input_is_refused():
    with pytest.raises(EpisodeError, match="do not increase"):
        PointPaths(stamps_ns=np.array([1, 1]), points=np.zeros((2, 3, 3)))
    with pytest.raises(EpisodeError, match=r"\[T, N, 3\]"):
        PointPaths(stamps_ns=np.array([1, 2]), points=np.zeros((3, 3, 3)))
    nothing = np.full_like(FOUND, np.nan)
    with pytest.raises(EpisodeError, match="0 reconstructed points"):
        score_points(paths(nothing), paths(MEASURED))
