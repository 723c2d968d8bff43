"""The reference of self-collision against cases worked by hand."""

import numpy as np
import pytest

from tests.reference.self_collision import candidate_pairs, collide

TOUCH = 0.01
"""Collision distance, metres."""
NEAR = TOUCH - 1e-9
"""So near that nothing needs to part."""


def after(positions, velocities, *, masses=None, pairs=((0, 1),), restitution=0.0, friction=0.0):
    masses = np.ones(len(positions)) if masses is None else np.array(masses)
    listed = [(i, j, TOUCH) for i, j in pairs]
    return collide(
        np.array(positions), np.array(velocities), masses, listed, restitution=restitution, friction=friction
    )


@pytest.mark.parametrize(("restitution", "speeds"), [(0.0, (0.0, 0.0)), (0.5, (-0.5, 0.5)), (1.0, (-1.0, 1.0))])
def test_equal_masses_head_on(restitution, speeds):
    contacts, velocities = after([[0, 0, 0], [NEAR, 0, 0]], [[1, 0, 0], [-1, 0, 0]], restitution=restitution)
    assert contacts.tolist() == [1, 1]
    assert velocities[:, 0] == pytest.approx(speeds, abs=1e-6)


def test_elastic_collision_of_unequal_masses():
    # m1 = 1 at 3 m/s on m2 = 2 at rest: (m1 - m2) / (m1 + m2) * 3 = -1 and 2 m1 / (m1 + m2) * 3 = 2.
    _, velocities = after([[0, 0, 0], [0, NEAR, 0]], [[0, 3, 0], [0, 0, 0]], masses=[1, 2], restitution=1.0)
    assert velocities[:, 1] == pytest.approx([-1, 2])


def test_glancing_collision_loses_what_friction_takes():
    # Approach 1 m/s, reduced mass 1/2: P = 0.5, friction 0.2 * 0.5 = 0.1 against sliding of 1 m/s.
    _, velocities = after([[0, 0, 0], [NEAR, 0, 0]], [[1, 1, 0], [0, 0, 0]], friction=0.2)
    assert velocities == pytest.approx(np.array([[0.5, 0.9, 0], [0.5, 0.1, 0]]), abs=1e-6)


def test_strong_friction_stops_the_sliding_and_no_more():
    _, velocities = after([[0, 0, 0], [NEAR, 0, 0]], [[1, 1, 0], [0, 0, 0]], friction=5.0)
    assert velocities == pytest.approx(np.array([[0.5, 0.5, 0], [0.5, 0.5, 0]]), abs=1e-6)


def test_three_in_a_row_split_the_middle_one():
    # 1 kg at 1 m/s meets half of the middle one, 0.5 kg: both go on with 1 / 1.5; the halves cancel.
    contacts, velocities = after(
        [[-NEAR, 0, 0], [0, 0, 0], [NEAR, 0, 0]], [[1, 0, 0], [0, 0, 0], [-1, 0, 0]], pairs=[(0, 1), (1, 2)]
    )
    assert contacts.tolist() == [1, 2, 1]
    assert velocities[:, 0] == pytest.approx([2 / 3, 0, -2 / 3], abs=1e-6)


@pytest.mark.parametrize(("depth", "parting"), [(0.0005, 0.05), (0.005, 0.1)])
def test_nodes_that_are_too_near_part(depth, parting):
    _, velocities = after([[0, 0, 0], [TOUCH - depth, 0, 0]], [[0, 0, 0], [0, 0, 0]])
    assert velocities[1, 0] - velocities[0, 0] == pytest.approx(parting)


@pytest.mark.parametrize(
    ("second", "speed"),
    [([2 * TOUCH, 0, 0], -1.0), ([NEAR, 0, 0], 1.0), ([0, 0, 0], -1.0)],
    ids=["far", "parting", "same place"],
)
def test_pairs_that_do_not_collide(second, speed):
    contacts, velocities = after([[0, 0, 0], second], [[0, 0, 0], [speed, 0, 0]], restitution=0.5, friction=1.0)
    assert contacts.tolist() == [0, 0]
    assert velocities.tolist() == [[0, 0, 0], [speed, 0, 0]]


@pytest.mark.parametrize(
    ("offset", "velocity", "found"),
    [
        # Within 0.1 s a fall makes 0.049 m; the collision distance is 0.01 m.
        ([0.058, 0, 0], [0, 0, 0], True),
        ([0.060, 0, 0], [0, 0, 0], False),
        # 1 m/s towards the other: 0.1 m nearer and 0.05 m of tolerance more.
        ([0.208, 0, 0], [-1, 0, 0], True),
        ([0.210, 0, 0], [-1, 0, 0], False),
        # Away from it: the tolerance alone.
        ([0.108, 0, 0], [1, 0, 0], True),
        ([0.110, 0, 0], [1, 0, 0], False),
        # Past it, 0.108 m aside half way.
        ([0.05, 0.108, 0], [-1, 0, 0], True),
        ([0.05, 0.110, 0], [-1, 0, 0], False),
    ],
)
def test_candidates_come_near_within_the_horizon(offset, velocity, found):
    positions, velocities = np.array([[0, 0, 0], offset]), np.array([[0, 0, 0], velocity])
    rest = np.array([[0, 0, 0], [1, 0, 0]])
    assert bool(candidate_pairs(positions, velocities, rest, distance=0.01, horizon=0.1)) == found


@pytest.mark.parametrize(("rest", "found"), [(0.0156, False), (0.0158, True)])
def test_neighbours_at_rest_are_no_candidates(rest, found):
    # pi / 2 * 0.01 = 0.0157.
    nodes, still = np.array([[0, 0, 0], [0.005, 0, 0]]), np.zeros((2, 3))
    at_rest = np.array([[0, 0, 0], [0, rest, 0]])
    assert bool(candidate_pairs(nodes, still, at_rest, distance=0.01, horizon=0.1)) == found


def test_no_candidates_without_a_collision_distance():
    nodes = np.array([[0, 0, 0], [1e-4, 0, 0]])
    assert not candidate_pairs(nodes, np.zeros((2, 3)), np.eye(3)[:2], distance=0.0, horizon=0.1)
