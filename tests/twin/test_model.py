"""Graphs, parameters and models: what is made, and what is refused."""

import dataclasses

import numpy as np
import pytest

from egophys_core.errors import TwinError
from egophys_core.kinds import node_masses
from egophys_core.twin import (
    PhysicalParameters,
    SpringGraph,
    SpringKind,
    bridge_components,
    connect,
    connected_components,
    per_kind,
)
from egophys_core.twin.parameters import SIGNED
from tests.simulation.scenes import parameters, sheet_model
from tests.twin.examples import make_twin


def on_a_line(*xs: float) -> np.ndarray:
    return np.array([[x, 0.0, 0.0] for x in xs])


def pairs(springs: np.ndarray) -> list[tuple[int, int]]:
    return [tuple(pair) for pair in springs.tolist()]


def test_nodes_within_the_radius_are_connected():
    assert pairs(connect(on_a_line(0, 1, 2, 4), radius=1.0, max_neighbours=5)) == [(0, 1), (1, 2)]


def test_a_node_asks_for_its_nearest_but_may_be_asked_by_more():
    # Each of the outer nodes asks for node 0, which itself asks for one.
    positions = np.array([[0, 0, 0], [1.0, 0, 0], [0, 1.01, 0], [0, 0, 1.02]])
    assert pairs(connect(positions, radius=1.2, max_neighbours=1)) == [(0, 1), (0, 2), (0, 3)]


def test_nearer_nodes_are_skipped_within_the_inner_radius():
    springs = connect(on_a_line(0, 1, 2, 3), radius=2.5, inner_radius=1.5, max_neighbours=5)
    assert pairs(springs) == [(0, 2), (1, 3)]


def test_nothing_in_reach_gives_no_springs():
    assert connect(on_a_line(0, 5), radius=1.0, max_neighbours=3).shape == (0, 2)


def test_components_are_counted():
    labels = connected_components(5, np.array([[0, 1], [3, 4]]))
    assert len(set(labels.tolist())) == 3
    assert labels[0] == labels[1]
    assert labels[3] == labels[4]


def test_pieces_are_joined_by_their_shortest_gaps():
    positions = on_a_line(0, 1, 2, 10, 11, 30)
    springs = connect(positions, radius=1.0, max_neighbours=3)
    joined = bridge_components(positions, springs)
    assert connected_components(6, joined).max() == 0
    assert {(2, 3), (4, 5)} <= set(pairs(joined))
    assert set(pairs(springs)) <= set(pairs(joined))


def test_single_node_needs_no_bridge():
    assert bridge_components(np.zeros((1, 3)), np.zeros((0, 2), np.int32)).shape == (0, 2)


def test_one_piece_is_left_alone():
    springs = np.array([[0, 1], [1, 2]], np.int32)
    assert bridge_components(on_a_line(0, 1, 2), springs) is not None
    assert np.array_equal(bridge_components(on_a_line(0, 1, 2), springs), springs)


def small_graph() -> SpringGraph:
    return SpringGraph(
        positions=on_a_line(0, 1, 2).astype(np.float32),
        springs=np.array([[0, 1], [1, 2]], np.int32),
        kinds=np.array([SpringKind.STRUCTURAL, SpringKind.BENDING], np.uint8),
        rest_lengths=np.ones(2, np.float32),
        surface=np.ones(3, bool),
    )


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"positions": np.zeros((3, 2), np.float32)}, r"positions must be \(3, 3\), got \(3, 2\)"),
        ({"kinds": np.zeros(3, np.uint8)}, r"kinds must be \(2,\), got \(3,\)"),
        ({"springs": np.array([[0, 1], [1, 3]], np.int32)}, "names node 3, there are 3"),
        ({"springs": np.array([[0, 1], [-1, 2]], np.int32)}, "spring names node"),
        ({"springs": np.array([[0, 0], [1, 2]], np.int32)}, r"spring 0 must name its lower node first.* got \[0, 0\]"),
        ({"springs": np.array([[0, 1], [2, 1]], np.int32)}, r"spring 1 must name its lower node first.* got \[2, 1\]"),
        ({"springs": np.array([[0, 1], [1, 2]], float)}, "springs must be integers, got float64"),
        ({"kinds": np.full(2, 9, np.uint8)}, r"kinds must be \[0, 1\], got 9"),
        ({"positions": np.zeros((3, 3), complex)}, "positions must be floating-point numbers, got complex128"),
        ({"surface": np.zeros(3, bool)}, "none of its 3 nodes is on the surface"),
        ({"rest_lengths": np.array([1, np.inf], np.float32)}, "rest length of spring 1 is inf m"),
        (
            {name: array[:0] for name, array in vars(small_graph()).items() if name not in ("positions", "surface")},
            "no springs between its 3 nodes",
        ),
        ({"positions": np.full((3, 3), np.nan, np.float32)}, "node 0 is not finite"),
        ({"rest_lengths": np.array([1, 0], np.float32)}, r"spring 1 between nodes \[1, 2\] has rest length 0 m"),
        ({"rest_lengths": np.array([np.nan, 1], np.float32)}, "spring 0"),
        ({"rest_lengths": np.array([1000, 1000], np.float32)}, "rest lengths are 1000 m, where nodes at rest are"),
    ],
)
def test_ill_formed_graphs_are_refused(change, text):
    with pytest.raises(TwinError, match=text):
        dataclasses.replace(small_graph(), **change)


def test_empty_graph_is_refused():
    with pytest.raises(TwinError, match="no nodes"):
        SpringGraph(
            positions=np.zeros((0, 3), np.float32),
            springs=np.zeros((0, 2), np.int32),
            kinds=np.zeros(0, np.uint8),
            rest_lengths=np.zeros(0, np.float32),
            surface=np.zeros(0, bool),
        )


def test_bending_springs_have_their_share():
    assert per_kind(small_graph(), 8.0, 0.25).tolist() == [8.0, 2.0]


def test_mass_is_shared_equally():
    masses = node_masses(sheet_model(total_mass=0.32))
    assert masses == pytest.approx(np.full(16, 0.02))


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_stiffness_of_a_spring_must_be_positive_and_finite(value):
    model = sheet_model()
    stiffness = model.stiffness.copy()
    stiffness[3] = value
    with pytest.raises(TwinError, match="stiffness must be finite and positive"):
        dataclasses.replace(model, stiffness=stiffness)
    with pytest.raises(TwinError, match="one per spring"):
        dataclasses.replace(model, stiffness=stiffness[:-1])


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(PhysicalParameters)])
@pytest.mark.parametrize("value", [-0.1, np.nan, np.inf, True, 10**400])
def test_parameters_must_be_finite_and_not_negative(name, value):
    if value == -0.1 and name in SIGNED:
        assert getattr(parameters(**{name: value}), name) == value
        return
    with pytest.raises(TwinError, match=f"{name} must be finite and not negative, got {value}"):
        parameters(**{name: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("total_mass", 0.0),
        ("total_mass", 1e-30),
        ("controller_neighbours", 0),
        ("controller_neighbours", 2.5),
        ("stiffness", 0.0),
        ("controller_radius", 0.0),
        ("restitution", 1.1),
        ("ground_projection", 2.0),
    ],
)
def test_parameters_must_be_in_their_range(name, value):
    with pytest.raises(TwinError, match=name):
        parameters(**{name: value})


def test_grasp_must_be_points():
    with pytest.raises(TwinError, match=r"grasp must be \[C, 3\] in metres, got \(3,\)"):
        make_twin(grasp=np.zeros(3, np.float32))
    for grasp in (np.full((1, 3), "0.1"), np.full((1, 3), np.nan, np.float32)):
        with pytest.raises(TwinError, match="grasp must be finite floating-point numbers in metres"):
            make_twin(grasp=grasp)


@pytest.mark.parametrize("height", ["zero", None, [0], np.nan, True, 10**400])
def test_the_height_of_the_table_must_be_a_number(height):
    with pytest.raises(TwinError, match="ground_height must be a finite number in metres, got"):
        make_twin(ground_height=height)
