"""Errors in space against cases worked by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from egophys_core.errors import EpisodeError
from egophys_core.evaluation import camera_pose_scores, identify, reconstruction_scores
from egophys_core.evaluation.reconstruction import slip

NAN = [np.nan] * 3

ROW = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.2, 0, 0], [0.3, 0, 0]])
"""Four points 10 cm apart."""


def poses(rotations: Rotation, positions: np.ndarray) -> np.ndarray:
    matrices = np.tile(np.eye(4), (len(positions), 1, 1))
    matrices[:, :3, :3] = rotations.as_matrix()
    matrices[:, :3, 3] = positions
    return matrices


def scene(seed: int, frames: int, count: int):
    """A reconstruction some millimetres off, and the measured points, both with gaps."""
    generator = np.random.default_rng(seed)
    rest = generator.uniform(0, 0.2, (count, 3))
    truth = rest + np.cumsum(generator.normal(0, 0.01, (frames, 1, 3)), axis=0)
    followed = truth + generator.normal(0, 0.01, truth.shape)
    followed[generator.random((frames, count)) < 0.3] = np.nan
    truth[generator.random((frames, count)) < 0.3] = np.nan
    return followed, truth, rest


SCENES = st.builds(scene, st.integers(0, 2**32 - 1), st.integers(1, 5), st.integers(1, 8))


def test_errors_and_coverage_by_hand():
    truth = np.stack([ROW, ROW + [0, 0.5, 0]])
    followed = truth.copy()
    # Errors 1, 2, 5 mm and 0 in frame 0; in frame 1 one point is not measured, one not reconstructed, 0 and 3 mm.
    followed[0, :3] += [[0.001, 0, 0], [0, 0, -0.002], [0.003, 0.004, 0]]
    followed[1, 3] += [0, 0.003, 0]
    truth[1, 0] = NAN
    followed[1, 1] = NAN
    scores = reconstruction_scores(followed, truth, ROW)
    assert scores.mean_m == pytest.approx(0.011 / 6)
    # 0, 0, 1, 2, 3, 5 mm: the 95th percentile is at 4.75 of 5 steps.
    assert scores.p95_m == pytest.approx(0.0045)
    assert scores.coverage == pytest.approx(6 / 7)
    assert scores.id_stability == 1.0
    assert scores.as_dict() == pytest.approx({"mean_mm": 11 / 6, "p95_mm": 4.5, "coverage": 6 / 7, "id_stability": 1.0})


def test_points_never_identified_count_as_not_covered():
    truth = np.stack([ROW, ROW])
    places = identify(ROW[:3], ROW, 0.05)
    scores = reconstruction_scores(places.follow(truth[:, :3]), truth, ROW)
    assert (scores.coverage, scores.mean_m) == (0.75, 0.0)


def test_slip_is_the_distance_of_swapped_points_at_rest():
    truth = np.stack([ROW, ROW])
    followed = truth.copy()
    followed[1, [0, 2]] = followed[1, [2, 0]]
    assert slip(followed, truth, ROW)[1] == pytest.approx([0.2, 0, 0.2, 0])
    assert reconstruction_scores(followed, truth, ROW).id_stability == 6 / 8


def test_slip_is_measured_on_the_object_however_that_is_bent():
    # The row is folded: its ends are 1 cm apart, but 30 cm on the object.
    folded = np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0, 0.01], [0, 0, 0.01]])
    followed = folded.copy()
    followed[0] += [0, 0, 0.008]
    assert slip(followed[None], folded[None], ROW)[0] == pytest.approx([0.3, 0, 0, 0])


def test_shape_off_in_depth_does_not_slip():
    truth = np.stack([ROW, ROW])
    assert slip(truth + [0, 0, 0.04], truth, ROW) == pytest.approx(np.zeros((2, 4)))


def test_slip_needs_both_points_and_a_place_at_rest():
    truth, followed, rest = ROW[None].copy(), ROW[None].copy(), ROW.copy()
    truth[0, 0], followed[0, 1], rest[2] = NAN, NAN, NAN
    assert np.isnan(slip(followed, truth, rest))[0].tolist() == [True, True, True, False]
    # Nearest to the point unknown at rest, which names no place; of the others nearest to the one 20 cm from its own.
    followed[0, 3] = [0.19, 0, 0]
    assert slip(followed, truth, rest)[0, 3] == pytest.approx(0.2)


def test_nothing_reconstructed_is_no_coverage_and_no_error():
    truth = ROW[None]
    scores = reconstruction_scores(np.full_like(truth, np.nan), truth, ROW)
    assert scores.coverage == 0.0
    assert np.isnan([scores.mean_m, scores.p95_m, scores.id_stability]).all()
    assert np.isnan(reconstruction_scores(truth, np.full_like(truth, np.nan), ROW).coverage)


def test_pose_errors_by_hand():
    truth = poses(Rotation.from_rotvec([[0, 0, 0.3]] * 3), np.zeros((3, 3)))
    found = poses(Rotation.from_rotvec([[0, 0, 0.3], [0, 0, 0.3 + np.pi / 2], [0, 0, 0.3]]), np.zeros((3, 3)))
    found[1, :3, 3] = [0.003, 0, 0.004]
    found[2] = np.nan
    scores = camera_pose_scores(found, truth)
    assert scores.position_m[:2] == pytest.approx([0, 0.005])
    assert scores.angle_rad[:2] == pytest.approx([0, np.pi / 2])
    assert np.isnan([scores.position_m[2], scores.angle_rad[2]]).all()
    assert scores.as_dict() == pytest.approx({"pose_mm": 2.5, "pose_deg": 45.0, "pose_coverage": 2 / 3})


@pytest.mark.parametrize("angle", [1e-9, 1e-4, 1.0, 3.0, np.pi - 1e-6])
def test_angle_is_exact_when_small_and_when_large(angle):
    axis = np.array([0.6, 0, -0.8])
    turned = Rotation.from_rotvec([angle * axis]) * Rotation.from_rotvec([[0.3, -1, 0.5]])
    truth = Rotation.from_rotvec([[0.3, -1, 0.5]])
    scores = camera_pose_scores(poses(turned, np.zeros((1, 3))), poses(truth, np.zeros((1, 3))))
    assert scores.angle_rad[0] == pytest.approx(angle, rel=1e-6)


def test_no_pose_found():
    scores = camera_pose_scores(np.full((2, 4, 4), np.nan), np.tile(np.eye(4), (2, 1, 1))).as_dict()
    assert scores["pose_coverage"] == 0.0
    assert np.isnan([scores["pose_mm"], scores["pose_deg"]]).all()


def test_bad_input_is_refused():
    good = np.tile(np.eye(4), (2, 1, 1))
    scaled, mirrored, transposed = good.copy(), good.copy(), good.copy()
    scaled[1, :3, :3] *= 1.01
    mirrored[1, 2, 2] = -1
    transposed[1, 3, 0] = 0.4
    for bad in (scaled, mirrored, transposed):
        with pytest.raises(EpisodeError, match="found pose of frame 1"):
            camera_pose_scores(bad, good)
    with pytest.raises(EpisodeError, match="true pose of frame 0"):
        camera_pose_scores(good, np.full((2, 4, 4), np.nan))
    with pytest.raises(EpisodeError, match=r"\[T, 4, 4\]"):
        camera_pose_scores(good[:, :3], good[:, :3])
    with pytest.raises(EpisodeError, match=r"\[T, N, 3\]"):
        reconstruction_scores(ROW[None], ROW[None, :2], ROW)


@given(SCENES)
def test_shares_are_within_0_and_1_and_the_truth_has_no_error(case):
    followed, truth, rest = case
    scores = reconstruction_scores(followed, truth, rest)
    for share in (scores.coverage, scores.id_stability):
        assert np.isnan(share) or 0 <= share <= 1
    perfect = reconstruction_scores(truth, truth, rest)
    assert np.isnan(perfect.mean_m) or (perfect.mean_m, perfect.p95_m, perfect.coverage) == (0, 0, 1)
    assert np.isnan(perfect.id_stability) or perfect.id_stability == 1


@given(SCENES, st.randoms(), st.integers(0, 2**32 - 1))
def test_order_of_the_points_and_pose_of_the_scene_do_not_matter(case, random, seed):
    followed, truth, rest = case
    order = list(range(len(rest)))
    random.shuffle(order)
    turn = Rotation.random(random_state=seed).as_matrix()
    moved = [each[..., order, :] @ turn.T + [0.1, -0.2, 0.3] for each in case]
    one, other = reconstruction_scores(followed, truth, rest), reconstruction_scores(*moved)
    assert one.as_dict() == pytest.approx(other.as_dict(), nan_ok=True)


@given(st.integers(0, 2**32 - 1))
def test_pose_errors_do_not_depend_on_the_world_and_are_the_same_both_ways(seed):
    generator = np.random.default_rng(seed)
    one, other = (poses(Rotation.random(4, random_state=generator), generator.normal(0, 1, (4, 3))) for _ in range(2))
    world = poses(Rotation.random(1, random_state=generator), generator.normal(0, 1, (1, 3)))
    scores = camera_pose_scores(one, other)
    for again in (camera_pose_scores(other, one), camera_pose_scores(world @ one, world @ other)):
        assert again.position_m == pytest.approx(scores.position_m)
        assert again.angle_rad == pytest.approx(scores.angle_rad)
    same = camera_pose_scores(one, one)
    assert same.position_m.tolist() == [0.0] * 4
    assert same.angle_rad == pytest.approx(np.zeros(4), abs=1e-12)
