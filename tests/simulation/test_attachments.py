"""Which nodes a controller point takes hold of (paper, App. B.2): r_c, its number of neighbours, K_min = 5."""

import numpy as np
import pytest

from egophys_core.simulation.attachments import FEWEST_NEIGHBOURS, LEAST_CUTOFF, NOTHING_HELD, attach


def on_a_line(*distances: float) -> np.ndarray:
    return np.array([[x, 0.0, 0.0] for x in distances])


ORIGIN = np.zeros((1, 3))


def held(nodes: np.ndarray, controllers: np.ndarray = ORIGIN, *, radius=0.03, most=10, flat=True) -> list:
    found = attach(
        nodes,
        controllers,
        np.ones(len(controllers), bool),
        radius=radius,
        max_neighbours=most,
        flat=flat,
    )
    return sorted(zip(found.controllers.tolist(), found.nodes.tolist(), strict=True))


def test_all_nodes_within_the_radius_are_held():
    nodes = on_a_line(0.031, 0.005, 0.010, 0.015, 0.020, 0.030)
    assert held(nodes) == [(0, 1), (0, 2), (0, 3), (0, 4), (0, 5)]


def test_the_nearest_are_held_when_there_are_too_many():
    assert held(on_a_line(0.02, 0.01, 0.03, 0.005), most=2, flat=False) == [(0, 1), (0, 3)]


def test_rest_lengths_are_the_distances_at_the_grasp():
    nodes = on_a_line(0.01, 0.02)
    found = attach(nodes, ORIGIN, np.array([True]), radius=0.03, max_neighbours=10, flat=True)
    assert found.rest_lengths == pytest.approx([0.01, 0.02])
    assert found.rest_lengths.dtype == np.float32


@pytest.mark.parametrize("flat", [True, False])
def test_a_point_that_does_not_take_hold_holds_nothing(flat):
    two = np.zeros((2, 3))
    found = attach(on_a_line(0.01, 0.02), two, np.array([False, True]), radius=0.03, max_neighbours=10, flat=flat)
    assert set(found.controllers.tolist()) == {1}
    nothing = attach(on_a_line(0.01), two, np.array([False, False]), radius=0.03, max_neighbours=10, flat=flat)
    assert nothing is NOTHING_HELD


def test_flat_object_lends_its_nearest_nodes_when_too_few_are_within_the_radius():
    nodes = on_a_line(0.02, 0.04, 0.06, 0.08, 0.10, 0.12, 0.14)
    assert held(nodes) == [(0, node) for node in range(FEWEST_NEIGHBOURS)]


def test_fallback_of_a_flat_object_stops_at_the_cutoff():
    # max(2.5 * 0.03, 0.15) = 0.15 m; a larger radius reaches 2.5 times itself.
    assert held(on_a_line(0.10, LEAST_CUTOFF + 0.001)) == [(0, 0)]
    assert held(on_a_line(LEAST_CUTOFF - 0.001)) == [(0, 0)]
    assert held(on_a_line(0.24, 0.26), radius=0.1) == [(0, 0)]


def test_fallback_holds_no_more_than_the_point_may():
    assert held(on_a_line(0.05, 0.06, 0.07), most=2) == [(0, 0), (0, 1)]


def test_five_within_the_radius_are_enough_for_no_fallback():
    nodes = on_a_line(0.01, 0.015, 0.02, 0.025, 0.03, 0.04)
    assert held(nodes) == [(0, node) for node in range(5)]
    assert held(nodes[1:]) == [(0, node) for node in range(5)]


def test_solid_is_held_strictly_within_the_radius_when_any_point_finds_a_node():
    nodes = on_a_line(0.02, 0.05, 0.06)
    far = np.array([[0.0, 0.0, 0.0], [0.10, 0.0, 0.0]])
    assert held(nodes, far, flat=False) == [(0, 0)]
    assert held(nodes, far, flat=True) == [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2)]


def test_solid_falls_back_only_when_no_point_finds_a_node():
    nodes = on_a_line(0.05, 0.06, 0.20)
    assert held(nodes, flat=False) == [(0, 0), (0, 1)]


def test_nothing_is_held_out_of_reach():
    assert held(on_a_line(0.5, 0.6)) == []


def test_equal_distances_are_decided_by_the_order_of_nodes():
    nodes = np.array([[0.01, 0, 0], [-0.01, 0, 0], [0, 0.01, 0], [0, 0, 0.01]])
    assert held(nodes, most=2, flat=False) == [(0, 0), (0, 1)]
