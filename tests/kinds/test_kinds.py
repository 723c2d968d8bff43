"""The kinds of objects: how they are found, and what is asked of all of them."""

import re
from collections import Counter
from dataclasses import replace
from itertools import chain

import numpy as np
import pytest

from egophys_core.errors import EpisodeError, OptionsError, TwinError
from egophys_core.identification import FitOptions, build, predict
from egophys_core.kinds import KINDS, kind_named, kind_of, node_masses
from egophys_core.kinds.rod import rod_model
from egophys_core.kinds.surface_faces import faces_of_body
from egophys_core.observation import place_twin
from egophys_core.simulation import batch_of_models
from egophys_core.twin import ObjectModel, decode_twin, encode_twin
from tests.diagnosis.cantilever import TEMPLATE, body_and_model, ring_down_episode, still_episode, twin_of
from tests.effects.situations import solid
from tests.identification.synthetic import candidate, searched_numbers, sheet_episode, sheet_shape
from tests.kinds.hanging_cable import curve, record_of
from tests.kinds.seen_markers import marker_body
from tests.simulation.scenes import frame_times, idle_controls, sheet_model, sheet_positions
from tests.twin.examples import make_twin


def rod() -> ObjectModel:
    body = marker_body(record_of(curve(9), held_first=2, held_last=2), None)
    return rod_model(body, density=1000.0, rigidity=0.02, retardation_time=0.015, drag=0.5)


MODELS = {"sheet": sheet_model, "solid": solid, "rod": rod, "lattice": lambda: body_and_model()[1]}


def test_every_kind_of_the_list_has_a_model_here():
    assert set(MODELS) == set(KINDS)


@pytest.mark.parametrize("name", MODELS)
def test_a_model_says_what_it_is_of_and_shares_out_its_mass(name):
    model = MODELS[name]()
    assert kind_of(model) is KINDS[name]
    masses = node_masses(model)
    assert masses.shape == (len(model.graph.positions),)
    assert masses.sum() == pytest.approx(model.parameters.total_mass, rel=1e-5)
    assert (masses > 0.0).all()


def test_a_rod_has_its_mass_along_its_length():
    model = rod()
    halves = np.concatenate([[0.0], model.graph.rest_lengths, [0.0]])
    stood_for = (halves[1:] + halves[:-1]) / 2.0
    assert node_masses(model) / stood_for == pytest.approx(model.parameters.total_mass / halves.sum(), rel=1e-4)


@pytest.mark.parametrize("name", MODELS)
def test_fitted_parameters_lie_within_their_bounds_and_are_named_once(name):
    model = MODELS[name]()
    found = kind_of(model).fitted(model)
    assert max(Counter(each.parameter.name for each in found).values()) == 1
    for each in found:
        assert each.parameter.low < each.parameter.high
        assert each.parameter.step > 0.0
        if each.springs is None:
            assert hasattr(model.parameters, each.parameter.name)


@pytest.mark.parametrize("name", MODELS)
def test_variants_are_of_the_same_nodes_and_kind(name):
    model = MODELS[name]()
    kind = kind_of(model)
    for each in (*chain.from_iterable(kind.variants(model)), *kind.otherwise_at_rest(model)):
        assert kind_of(each) is kind
        assert np.array_equal(each.graph.positions, model.graph.positions)
    assert bool(kind.variants(model)) == (kind.from_surface is not None)
    made = [
        {(len(each.graph.springs), each.parameters.controller_radius) for each in one} for one in kind.variants(model)
    ]
    assert all(len(each) == 1 for each in made)
    assert len(set().union(*made)) == len(made)


@pytest.mark.parametrize(("given", "hint"), [("shet", "did you mean sheet?"), ("liquid", "there are sheet, solid")])
def test_an_unknown_kind_is_refused_with_the_nearest_or_all(given, hint):
    with pytest.raises(TwinError, match=re.escape(hint)):
        kind_named(given)
    with pytest.raises(TwinError, match="no kind of object is called"):
        batch_of_models(
            [replace(sheet_model(), kind=given)], [idle_controls(frame_times(0.1, 1 / 30))], ground_height=0.0
        )
    with pytest.raises(OptionsError, match=r"kind must be one of auto, sheet, solid.*, got"):
        FitOptions(kind=given)


def test_the_springs_of_a_rod_link_each_node_to_the_next():
    model = rod()
    crossed = replace(model, graph=replace(model.graph, springs=model.graph.springs[::-1].copy()))
    with pytest.raises(TwinError, match="each node to the next"):
        batch_of_models([crossed], [idle_controls(frame_times(0.1, 1 / 30))], ground_height=-10.0)


class TestWhatIsNotSeenSo:
    def test_a_rod_is_not_built_from_a_surface(self):
        with pytest.raises(OptionsError, match=r"one of sheet, solid: choose one of these"):
            build([sheet_episode()], FitOptions(kind="rod"))

    def test_a_sheet_is_not_built_from_markers(self):
        with pytest.raises(OptionsError, match=r"one of rod, lattice: choose one of these"):
            build([still_episode()], FitOptions(kind="sheet"))

    def test_what_does_not_lie_along_a_curve_is_no_rod_because_someone_says_so(self):
        with pytest.raises(EpisodeError, match=r"are not those of a rod .*leave the kind out"):
            build([still_episode()], FitOptions(kind="rod"))

    def test_a_twin_of_a_surface_has_no_place_at_markers_nor_the_other_way_round(self):
        with pytest.raises(EpisodeError, match="is it a twin of these markers"):
            place_twin(make_twin(), still_episode())
        body, model = body_and_model()
        with pytest.raises(EpisodeError, match="is a lattice, which is placed by the markers"):
            place_twin(twin_of(body, model), sheet_episode())


class TestTwinsOfMarkersFromBeforeLattices:
    """They say they are solids."""

    def test_they_are_read_and_are_lattices(self):
        body, model = body_and_model()
        former = twin_of(body, replace(model, kind="solid"))
        read = decode_twin(encode_twin(former), name="it")
        assert read.twin_id == former.twin_id
        assert kind_of(read.model).name == "lattice"

    def test_they_do_what_they_did(self):
        body, model = body_and_model()
        episode = ring_down_episode(body, model, frames=40)
        former, now = (
            predict(each, place_twin(twin_of(body, each), episode)) for each in (replace(model, kind="solid"), model)
        )
        assert np.array_equal(former, now)

    def test_of_a_hand_that_holds_more_they_are_none(self):
        model = body_and_model()[1]
        held = replace(model, kind="solid", parameters=replace(model.parameters, controller_neighbours=2))
        assert kind_of(held).name == "solid"

    def test_a_fitted_toy_is_no_lattice_though_it_lies_on_the_table(self):
        toy = replace(sheet_shape(5), kind="solid")
        toy = replace(toy, positions=toy.positions * np.float32([1.0, 1.0, 0.0]))
        model = candidate(toy, np.array([number.start_u for number in searched_numbers("solid")]))
        assert model.parameters.contact_radius == 0.0
        assert kind_of(model).name == "solid"


class TestFaces:
    def test_those_of_a_sheet_cover_it_once(self):
        """Triangles of an 11 x 11 grid have the area of its square, whichever way its diagonals go."""
        model = sheet_model(sheet_positions(11, 0.02))
        faces = kind_of(model).faces(model.graph)
        assert area(model.graph.positions, faces) == pytest.approx(0.2**2, rel=1e-3)

    def test_those_of_a_sheet_leave_a_hole_open(self):
        positions = sheet_positions(21, 0.01)
        ring = positions[np.linalg.norm(positions[:, :2] - positions[:, :2].mean(axis=0), axis=1) > 0.045]
        faces = kind_named("sheet").faces(sheet_model(ring).graph)
        hole = np.linalg.norm(ring[faces].mean(axis=1)[:, :2] - positions[:, :2].mean(axis=0), axis=1)
        assert hole.min() > 0.03

    def test_those_of_a_body_enclose_its_volume_and_look_outward(self):
        """The divergence theorem: a sixth of the sum of a . (b x c) over a closed surface is the volume inside."""
        line = np.linspace(0.0, 0.1, 6)
        box = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
        faces = faces_of_body(box)
        a, b, c = box[faces].transpose(1, 0, 2)
        assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0 == pytest.approx(1e-3, rel=1e-6)
        edges = Counter((face[one], face[(one + 1) % 3]) for face in faces.tolist() for one in range(3))
        assert all(edges[there, here] == count for (here, there), count in edges.items())

    def test_a_line_has_none_and_too_few_nodes_neither(self):
        model = rod()
        assert kind_of(model).faces(model.graph).shape == (0, 3)
        assert faces_of_body(np.zeros((3, 3))).shape == (0, 3)

    def test_a_beam_has_faces_all_around(self):
        model = body_and_model()[1]
        faces = kind_of(model).faces(model.graph)
        width = float(TEMPLATE.rsplit("x", 1)[1])
        length = float(np.ptp(model.graph.positions[:, 0]))
        # Faces go through the centres of cells: a beam of four across has 3/4 of its width.
        assert area(model.graph.positions, faces) == pytest.approx(4 * 0.75 * width * length, rel=0.2)


def area(positions: np.ndarray, faces: np.ndarray) -> float:
    """m^2 of triangles."""
    a, b, c = positions[faces].astype(float).transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)
