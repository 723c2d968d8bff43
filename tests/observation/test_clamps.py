"""Clamps: which held points belong together, and how they turn what they hold."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.geometry import smallest_rotation
from egophys_core.observation.clamps import (
    carried_by_clamps,
    clamp_groups,
    rigid_fit,
    smoothed_clamps,
    stands_still,
)


def test_points_that_come_near_but_move_apart_are_two_clamps() -> None:
    """Two hands of two points each that begin 10 cm from each other."""
    pair = np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.0]])
    apart = np.linspace(0.1, 0.4, 5)
    held = np.stack([np.concatenate([pair, pair + [distance, 0.0, 0.0]]) for distance in apart])
    assert [group.tolist() for group in clamp_groups(held)] == [[0, 1], [2, 3]]


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_clamp_carries_what_it_holds(count: int) -> None:
    """Three points tell all of a turn, two all but that about their line, one none."""
    points = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0], [0.0, 0.04, 0.0]])[:count]
    turn = Rotation.from_rotvec([0.0, 0.0, 0.6]).as_matrix()
    shift = np.array([0.2, -0.1, 0.3])
    clamped = np.array([[0.02, 0.01, 0.01], [0.06, -0.02, 0.0]])
    held = np.stack([points, points @ turn.T + shift])
    carried = carried_by_clamps(held, clamped)
    expected = clamped @ turn.T + shift if count > 1 else clamped + shift
    assert carried[0] == pytest.approx(clamped)
    assert carried[1] == pytest.approx(expected, abs=1e-9)


def test_what_slips_in_its_glue_stands_still() -> None:
    held = np.zeros((3, 2, 3))
    held[1, 0, 0] = 0.0015
    assert stands_still(held)
    assert carried_by_clamps(held, np.ones((4, 3))) == pytest.approx(np.ones((3, 4, 3)))
    held[2, 1, 2] = 0.01
    assert not stands_still(held)


def test_the_smallest_rotation_is_about_what_is_across_both() -> None:
    generator = np.random.default_rng(0)
    for source, target in generator.normal(size=(20, 2, 3)):
        turn = smallest_rotation(source, target)
        axis = np.cross(source, target)
        assert turn @ source / np.linalg.norm(source) == pytest.approx(target / np.linalg.norm(target))
        assert turn @ axis == pytest.approx(axis)
        assert np.linalg.det(turn) == pytest.approx(1.0)
    assert smallest_rotation(np.zeros(3), np.ones(3)) == pytest.approx(np.eye(3))


@pytest.mark.parametrize("direction", np.eye(3))
def test_a_direction_can_be_turned_round(direction: np.ndarray) -> None:
    turn = smallest_rotation(direction, -2.0 * direction)
    assert turn @ direction == pytest.approx(-direction)
    assert turn @ turn.T == pytest.approx(np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_a_rigid_motion_is_found() -> None:
    generator = np.random.default_rng(1)
    points, shift = generator.normal(size=(5, 3)), generator.normal(size=3)
    turn = Rotation.random(random_state=2).as_matrix()
    found_turn, found_shift = rigid_fit(points, points @ turn.T + shift)
    assert found_turn == pytest.approx(turn)
    assert found_shift == pytest.approx(shift)


def test_smoothing_takes_noise_and_leaves_what_hands_do() -> None:
    times = np.arange(300) / 100.0
    motion = np.zeros((300, 2, 3))
    motion[:, :, 2] = 0.1 * np.sin(2.0 * np.pi * 1.5 * times)[:, None]
    noise = np.random.default_rng(0).normal(0.0, 0.0002, motion.shape)
    assert smoothed_clamps(motion, times) == pytest.approx(motion, abs=5e-4)
    assert smoothed_clamps(noise, times)[10:-10].std() < 0.6 * noise[10:-10].std()


def test_frames_that_are_far_apart_are_not_smoothed() -> None:
    times = np.arange(30) / 30.0
    held = np.random.default_rng(0).normal(0.0, 0.01, (30, 2, 3))
    assert (smoothed_clamps(held, times) == held).all()
