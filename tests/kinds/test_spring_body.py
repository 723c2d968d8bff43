"""From normalised coordinates to a model."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from egophys_core.kinds import KINDS, kind_named, node_masses
from egophys_core.kinds.kind import RestShape, Touch
from egophys_core.kinds.rest_shape import surface_model
from egophys_core.kinds.spring_body import spring_graph
from egophys_core.twin import SpringKind, connected_components
from tests.identification.synthetic import SPACING, candidate, searched_numbers, sheet_shape
from tests.simulation.scenes import sheet_positions

SEEN = [name for name, kind in KINDS.items() if kind.from_surface]
"""Kinds of what is seen as a surface."""


@pytest.mark.parametrize("kind", SEEN)
def test_normalised_coordinates_span_the_range_and_meet_the_start(kind):
    for number in searched_numbers(kind):
        assert number.value(0.0) == pytest.approx(number.low)
        assert number.value(1.0) == pytest.approx(number.high)
        assert number.value(number.start_u) == pytest.approx(number.start)
        assert 0.0 < number.start_u < 1.0


def test_logarithmic_number_is_the_geometric_mean_in_the_middle():
    stiffness = searched_numbers("sheet")[0]
    assert stiffness.logarithmic
    assert stiffness.value(0.5) == pytest.approx(np.sqrt(stiffness.low * stiffness.high))


@given(data=st.data(), kind=st.sampled_from(SEEN))
@settings(max_examples=40, deadline=None)
def test_every_corner_of_the_search_gives_a_connected_model(data, kind):
    numbers = searched_numbers(kind)
    coordinates = np.array(data.draw(st.lists(st.floats(0, 1), min_size=len(numbers), max_size=len(numbers))))
    flat = sheet_shape(4)
    shape = RestShape(positions=flat.positions, surface=flat.surface, kind=kind, spacing=SPACING)
    model = candidate(shape, coordinates)
    assert connected_components(16, model.graph.springs).max() == 0
    assert (model.stiffness > 0).all()
    assert model.parameters.total_mass == 0.1
    # The object rests on the table where it was seen.
    assert model.parameters.contact_radius == pytest.approx(flat.positions[:, 2].min())


def test_springs_are_counted_once_and_bending_comes_after_structural():
    graph = spring_graph(sheet_shape(), radius=1.5 * SPACING, max_neighbours=12, bends=True)
    pairs = [tuple(pair) for pair in graph.springs.tolist()]
    assert len(set(pairs)) == len(pairs)
    assert all(i < j for i, j in pairs)
    assert (np.diff(graph.kinds.astype(int)) >= 0).all()
    assert set(graph.kinds.tolist()) == {SpringKind.STRUCTURAL, SpringKind.BENDING}
    ends = graph.positions[graph.springs]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    assert graph.rest_lengths == pytest.approx(lengths, rel=1e-5)
    bending = graph.kinds == SpringKind.BENDING
    assert lengths[~bending].max() <= 1.5 * SPACING * 1.001
    assert lengths[bending].min() > 1.4 * 1.5 * SPACING * 0.999


def test_solid_has_no_bending_springs_and_no_strain_limit():
    shape = RestShape(positions=sheet_positions(4, SPACING), surface=np.ones(16, bool), kind="solid", spacing=SPACING)
    coordinates = np.array([number.start_u for number in searched_numbers("solid")])
    model = candidate(shape, coordinates)
    assert (model.graph.kinds == SpringKind.STRUCTURAL).all()
    assert model.parameters.strain_limit >= 1e6
    assert model.parameters.ground_projection == 0.0


@pytest.mark.parametrize(
    ("touch", "shown", "hidden"),
    [(Touch.HELD, "grip_share", "collision_friction"), (Touch.PRESSED, "collision_friction", "grip_share")],
)
def test_what_hands_did_not_show_is_not_searched(touch, shown, hidden):
    flat = sheet_shape(4)
    shape = RestShape(
        positions=flat.positions,
        surface=flat.surface,
        kind="solid",
        spacing=SPACING,
        grasp_radius=0.05,
        touches=frozenset({touch}),
    )
    body = surface_model(kind_named("solid"))
    numbers = {number.name: number for number in body.numbers(shape)}
    assert shown in numbers
    assert hidden not in numbers
    firmest = body.candidate(shape, np.ones(len(numbers)), ground_height=0.0).parameters
    start = next(number.start for number in body.searched if number.name == hidden)
    searched = numbers[shown].high
    assert (firmest.controller_radius / 0.05, firmest.collision_friction) == pytest.approx(
        (searched, start) if touch is Touch.HELD else (start, searched)
    )


def test_stiffness_is_per_node_mass():
    # omega^2 of one spring and one node is the searched rate, whatever the number of nodes.
    coordinates = np.array([number.start_u for number in searched_numbers("sheet")])
    rate = searched_numbers("sheet")[0].start
    for side in (4, 7):
        model = candidate(sheet_shape(side), coordinates)
        assert model.parameters.stiffness / node_masses(model)[0] == pytest.approx(rate, rel=1e-5)
