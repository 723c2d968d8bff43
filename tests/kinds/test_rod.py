"""Rods: how markers lie along a cable, and how it is bent along them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_bvp

from egophys_core.diagnosis.evidence.fitted_parameters import baseline_parameters, with_effect
from egophys_core.errors import EpisodeError, OptionsError
from egophys_core.identification import build, evaluate_twin
from egophys_core.identification.marker_fit import MarkerSearch
from egophys_core.kinds.rod import rod_model
from egophys_core.kinds.rod_curve import PIECES, Chain, bend_to, find_chain, rod_nodes
from egophys_core.kinds.template import parse_template
from egophys_core.observation import observe_episode
from egophys_core.twin import GRAVITY
from tests.diagnosis.cantilever import HELD, TRACKS
from tests.kinds.hanging_cable import LENGTH, curve, moved_by_hand, record_of, rolled_out
from tests.kinds.seen_markers import marker_body, place_markers

PAIR = [np.array([0, 1])]
TWO_PAIRS = [np.array([0, 1]), np.array([2, 3])]


@settings(max_examples=30, deadline=None)
@given(st.permutations(range(9)), st.floats(0.3, 1.5))
def test_markers_in_any_order_are_found_along_the_curve(order: list[int], half_turn: float) -> None:
    points = curve(13, half_turn=half_turn)
    chain = find_chain(np.concatenate([points[:2], points[-2:]]), TWO_PAIRS, points[2:-2][order])
    assert chain is not None
    assert chain.has_far_clamp
    step = LENGTH / 12
    assert chain.length == pytest.approx(10 * step, rel=2e-3)
    assert chain.arc_lengths[:4] == pytest.approx([-step, 0.0, chain.length, chain.length + step], abs=1e-3)
    assert chain.arc_lengths[4:][np.argsort(order)] == pytest.approx(step * np.arange(1, 10), abs=1e-3)


def test_a_free_end_is_where_the_last_marker_is() -> None:
    points = curve(8)
    chain = find_chain(points[:2], PAIR, points[2:])
    assert chain is not None
    assert not chain.has_far_clamp
    assert chain.length == pytest.approx(LENGTH * 6 / 7, rel=2e-3)


def test_points_of_a_clamp_that_lie_across_are_one_place() -> None:
    points = curve(7)
    across = points[0] + np.array([[0.0, -0.02, 0.0], [0.0, 0.02, 0.0]])
    chain = find_chain(across, PAIR, points[1:])
    assert chain is not None
    assert chain.arc_lengths[:2] == pytest.approx([0.0, 0.0])
    assert chain.length == pytest.approx(LENGTH, rel=5e-3)


@pytest.mark.parametrize(
    ("held", "clamps", "tracks"),
    [
        (HELD, [np.arange(3)], TRACKS),
        (np.zeros((1, 3)), [np.array([0])], 0.1 * np.array([[1, 0, 0], [2, 0, 0], [2, 1, 0], [2, -1, 0]])),
        (np.zeros((1, 3)), [np.array([0])], 0.1 * np.array([[-1, 0, 0], [1, 0, 0], [2, 0, 0]])),
        (np.zeros((1, 3)), [np.array([0])], 0.1 * np.array([[1, 0, 0], [2, 0, 0]])),
    ],
    ids=["beam", "fork", "held in the middle", "too few"],
)
def test_what_does_not_lie_along_a_curve_is_no_rod(
    held: np.ndarray, clamps: list[np.ndarray], tracks: np.ndarray
) -> None:
    assert find_chain(held, clamps, tracks) is None


def test_a_bend_follows_a_circle_and_does_not_twist() -> None:
    """Cross-sections stay plane, across the curve, and turn about the normal of its plane alone."""
    radius, length, width = 0.3, 0.6, 0.01
    arc_lengths = np.linspace(0.0, length, 13)
    straight = np.stack([arc_lengths, np.zeros(13), np.zeros(13)], axis=1)
    angles = arc_lengths / radius
    seen = radius * np.stack([np.sin(angles), np.zeros(13), 1.0 - np.cos(angles)], axis=1)
    bend = bend_to(straight, seen, np.zeros_like(seen))
    assert bend.place(straight) == pytest.approx(seen, abs=1e-6)
    beside = straight[3:-3] + [0.0, width, 0.0]
    assert bend.place(beside) - seen[3:-3] == pytest.approx(np.tile([0.0, width, 0.0], (7, 1)), abs=1e-4)
    above = bend.place(straight[3:-3] + [0.0, 0.0, width]) - seen[3:-3]
    normal = np.stack([-np.sin(angles), np.zeros(13), np.cos(angles)], axis=1)[3:-3]
    assert above == pytest.approx(width * normal, abs=2e-4)


def test_a_rod_begins_as_fast_as_its_markers() -> None:
    """A motion that is cut out of a longer record goes on as it went."""
    moved = moved_by_hand(record_of(curve(13), held_first=2, held_last=2, frames=160), aside=0.1)
    body = marker_body(moved, None)
    model = rod_model(body, density=1000.0, rigidity=0.02, retardation_time=0.015, drag=0.5)
    whole = replace(moved, points=rolled_out(model, body, moved))
    later = slice(70, None)
    cut = replace(
        whole,
        times=whole.times[later] - whole.times[70],
        points=whole.points[later],
        confidence=whole.confidence[later],
        controllers=whole.controllers[later],
    )
    goes_on, from_rest = (
        np.linalg.norm(rolled_out(model, body, cut, from_rest=each) - cut.points, axis=2).mean()
        for each in (False, True)
    )
    assert from_rest > 0.015
    assert goes_on < 0.2 * from_rest


def test_beyond_the_outermost_points_a_rod_is_straight() -> None:
    straight = np.stack([np.linspace(0.0, 0.4, 5), np.zeros(5), np.zeros(5)], axis=1)
    bend = bend_to(straight, straight + [0.0, 0.0, 0.5], np.zeros_like(straight))
    assert bend.place(np.array([[0.5, 0.0, 0.01]])) == pytest.approx(np.array([[0.5, 0.0, 0.51]]))


@pytest.mark.parametrize(("held_first", "held_last"), [(2, 2), (1, 1), (3, 0), (1, 0)])
def test_nodes_lie_at_markers_and_evenly_between_and_clamps_hold_two(held_first: int, held_last: int) -> None:
    points = curve(13)
    end = 13 - held_last
    held = np.concatenate([points[:held_first], points[end:]])
    clamps = [each for each in np.split(np.arange(len(held)), [held_first]) if len(each)]
    along = find_chain(held, clamps, points[held_first:end])
    assert along is not None
    arc_lengths, clamped = rod_nodes(along, len(held), along.length)
    piece = along.length / PIECES
    assert np.abs(arc_lengths[:, None] - along.arc_lengths[len(held) :]).min(axis=0) == pytest.approx(0.0, abs=1e-12)
    far = [along.length, along.length + piece] if held_last else []
    assert arc_lengths[clamped] == pytest.approx([-piece, 0.0, *far], abs=1e-9)
    assert np.diff(arc_lengths) == pytest.approx(piece, rel=0.35)


def test_markers_side_by_side_share_a_node() -> None:
    near = 0.1 * LENGTH / PIECES
    along = Chain(arc_lengths=np.array([-0.02, 0.0, 0.3, 0.3 + near, LENGTH]), length=LENGTH, has_far_clamp=False)
    arc_lengths, _ = rod_nodes(along, 2, LENGTH)
    assert np.diff(arc_lengths).min() > 0.25 * LENGTH / PIECES
    assert np.abs(arc_lengths - 0.3 - near / 2).min() == pytest.approx(0.0, abs=1e-9)


def test_a_rod_is_built_straight_and_begins_as_it_is_seen() -> None:
    episode = record_of(curve(13), held_first=2, held_last=2)
    body = marker_body(episode, None)
    assert body.kind == "rod"
    model = rod_model(body, density=1000.0, rigidity=0.01, retardation_time=0.01, drag=1.0)
    problem = place_markers(model, body.grasp, episode)
    assert problem.start[problem.bound] == pytest.approx(episode.points[0], abs=1e-5)
    axis = np.linalg.svd(body.grasp - body.grasp.mean(axis=0))[2][0]
    assert np.ptp(body.graph.positions @ axis) == pytest.approx(LENGTH * 10 / 12 * (1 + 2 / PIECES), rel=2e-3)
    assert np.linalg.norm(np.cross(body.graph.positions - body.graph.positions[0], axis), axis=1).max() < 1e-5


@pytest.mark.parametrize("fewer", ["markers", "held"])
def test_a_record_of_fewer_markers_or_held_points_is_refused(fewer: str) -> None:
    points = curve(13)
    body = marker_body(record_of(points, held_first=2, held_last=2), None)
    model = rod_model(body, density=1000.0, rigidity=0.01, retardation_time=0.01, drag=1.0)
    other = {
        "markers": record_of(np.delete(points, 5, axis=0), held_first=2, held_last=2),
        "held": record_of(points[:-2], held_first=2, held_last=0),
    }[fewer]
    with pytest.raises(EpisodeError, match="is it a twin of these markers"):
        place_markers(model, body.grasp, other)


def test_a_template_says_how_far_a_free_end_reaches_and_what_it_weighs() -> None:
    episode = record_of(curve(8), held_first=2, held_last=0)
    free = marker_body(episode, parse_template("box:0.85x0.01x0.01"))
    assert (free.kind, free.length) == ("rod", pytest.approx(0.85))
    whole = float(free.graph.rest_lengths.sum())
    assert free.volume == pytest.approx(whole * 0.01**2)
    assert marker_body(episode, parse_template("box:0.85x0.2x0.2")).kind == "lattice"


def test_a_load_on_a_rod_of_unknown_weight_is_refused() -> None:
    episode = record_of(curve(8), held_first=2, held_last=0)
    with pytest.raises(OptionsError, match="give its size"):
        build([episode], loads={episode.name: 0.1})


def test_a_load_hangs_at_the_free_end() -> None:
    episode = record_of(curve(8), held_first=2, held_last=0)
    body = marker_body(episode, parse_template("box:0.85x0.01x0.01"))
    model = rod_model(body, density=1000.0, rigidity=0.01, retardation_time=0.01, drag=1.0)
    payload = place_markers(model, body.grasp, episode, load=0.5).controls.payload
    assert payload is not None
    assert payload[-1] == pytest.approx(0.5 / GRAVITY)
    assert (payload[:-1] == 0.0).all()


@pytest.mark.parametrize("bending_length", [0.04, 0.1, 0.2])
def test_a_rod_hangs_as_an_elastica(bending_length: float) -> None:
    """EI theta'' = w (L - s) cos(theta), clamped level, free at L; (EI / w)^(1/3) is the bending length.

    Love, Treatise on the Mathematical Theory of Elasticity (1927), ch. 19. At its clamp a rod bends from half a piece
    before the last held node on.
    """
    length, count = 0.5, 8
    level = np.stack([np.linspace(-length / 6, length, count), np.zeros(count), np.ones(count)], axis=1)
    episode = record_of(level, held_first=2, held_last=0, frames=400)
    body = marker_body(episode, None)
    model = rod_model(body, density=1000.0, rigidity=GRAVITY * bending_length**3, retardation_time=0.001, drag=8.0)
    places = rolled_out(model, body, episode)[-1] - level[1]
    half = 0.5 * body.spacing
    whole = body.length + half
    arc_lengths = np.linspace(0.0, whole, 400)
    solved = solve_bvp(
        lambda s, y: np.stack([y[1], (whole - s) * np.cos(y[0]) / bending_length**3]),
        lambda start, end: np.array([start[0], end[1]]),
        arc_lengths,
        np.stack([-1.5 * (1.0 - np.exp(-arc_lengths / bending_length)), np.zeros(len(arc_lengths))]),
        max_nodes=20_000,
    )
    slope = solved.sol(arc_lengths)[0]
    along, up = (
        np.concatenate([[0.0], np.cumsum(arc_lengths[1] * (each[1:] + each[:-1]) / 2)])
        for each in (np.cos(slope), np.sin(slope))
    )
    at = half + np.linspace(0.0, body.length, count - 1)[1:]
    elastica = np.stack([np.interp(at, arc_lengths, along) - half, np.interp(at, arc_lengths, up)], axis=1)
    assert places[:, [0, 2]] == pytest.approx(elastica, abs=0.006 * length)
    assert places[-1, 2] < -0.2 * length


def test_how_a_rod_bends_and_how_it_is_damped_are_found() -> None:
    """What our simulator does with a rod is recovered."""
    moved = moved_by_hand(record_of(curve(9), held_first=2, held_last=2, frames=200))
    body = marker_body(moved, None)
    injected = rod_model(body, density=1000.0, rigidity=0.02, retardation_time=0.015, drag=0.5)
    seen = rolled_out(injected, body, moved)
    twin = build([replace(moved, points=seen)])
    assert np.ptp(seen, axis=0).max() > 0.05
    assert twin.provenance.settings["rmse_m"] < 1e-3
    found = twin.model.parameters
    assert found.flexural_rigidity == pytest.approx(injected.parameters.flexural_rigidity, rel=0.03)
    assert found.retardation_time == pytest.approx(0.015, rel=0.15)
    assert found.drag == pytest.approx(0.5, abs=0.1)
    assert "rod" in twin.provenance.settings["assumed"][0]


@pytest.mark.slow
def test_an_intrinsic_curvature_is_found() -> None:
    """Of a cable that was kept on a coil, and begins where it hangs."""
    moved = moved_by_hand(record_of(curve(9), held_first=2, held_last=2, frames=200), aside=0.1)
    body = marker_body(moved, None)
    straight = rod_model(body, density=1000.0, rigidity=0.02, retardation_time=0.015, drag=0.5)
    coiled = replace(
        straight,
        parameters=replace(straight.parameters, intrinsic_curvature_level=1.5, intrinsic_curvature_up=-0.8, drag=8.0),
    )
    hanging = rolled_out(coiled, body, replace(moved, controllers=np.repeat(moved.controllers[:1], 200, axis=0)))
    there = replace(moved, points=np.repeat(hanging[-1:], moved.frames, axis=0))
    lively = replace(coiled, parameters=replace(coiled.parameters, drag=0.5))
    seen = replace(there, points=rolled_out(lively, body, there))
    twin = build([seen])
    assert twin.provenance.settings["rmse_m"] < 1e-3
    # How much it is bent upwards is nearly the same as how stiff it is.
    assert twin.model.parameters.intrinsic_curvature_level == pytest.approx(1.5, abs=0.3)
    assert -1.2 < twin.model.parameters.intrinsic_curvature_up < -0.2


@pytest.mark.slow
def test_an_uneven_intrinsic_curvature_is_told_from_several_records() -> None:
    """What was fitted to two motions foretells a third; an even curvature does not."""
    still = moved_by_hand(record_of(curve(9), held_first=2, held_last=2, frames=70))
    body = marker_body(still, None)
    along = np.linspace(0.0, 1.0, len(body.graph.positions))
    uneven = np.stack([3.0 * np.sin(6.0 * along), 2.0 * np.cos(9.0 * along)], axis=1)
    straight = rod_model(body, density=1000.0, rigidity=0.01, retardation_time=0.015, drag=4.0)
    bent = replace(straight, intrinsic_curvature=uneven.astype(np.float32))
    hanging = rolled_out(bent, body, replace(still, controllers=np.repeat(still.controllers[:1], 70, axis=0)))
    there = replace(still, points=np.repeat(hanging[-1:], 70, axis=0))
    way = (1.0 - np.cos(2.0 * np.pi * 0.9 * there.times))[:, None, None] * (np.arange(4) > 1)[:, None]
    records = []
    for name, side in (("one", [0.0, 0.04, 0.0]), ("two", [-0.05, 0.0, 0.05]), ("three", [-0.04, -0.03, 0.02])):
        carried = replace(there, name=name, controllers=there.controllers + np.float32(way * side))
        records.append(replace(carried, points=rolled_out(bent, body, carried)))
    twin = build(records[:2])
    even = replace(twin, model=replace(twin.model, intrinsic_curvature=None))
    found, without = (evaluate_twin(each, observe_episode(records[2]))[0].all_track_m for each in (twin, even))
    assert found < 0.002
    assert without > 3.0 * found


def test_a_drag_that_grows_with_speed_does_not_make_a_rod_stiff() -> None:
    """What the search starts from, where no numbers explain all that is seen."""
    moved = moved_by_hand(record_of(curve(9), held_first=2, held_last=2, frames=140), aside=0.1)
    body = marker_body(moved, None)
    bare = rod_model(body, density=1000.0, rigidity=0.02, retardation_time=0.015, drag=0.0)
    injected = with_effect(bare, "quadratic_drag", {"coefficient": 10.0})
    seen = observe_episode(replace(moved, points=rolled_out(injected, body, moved)))
    search = MarkerSearch(body, [seen], 1000.0)
    (rigidity, *_), error = search.best(search.unknowns.static_deflection)
    assert error > 2e-3
    assert np.exp(rigidity) == pytest.approx(0.02, rel=0.5)


def test_free_parameters_of_a_rod_are_those_that_are_searched() -> None:
    body = marker_body(record_of(curve(9), held_first=2, held_last=2), None)
    model = rod_model(body, density=1000.0, rigidity=0.02, retardation_time=0.015, drag=0.5)
    parameters = baseline_parameters(model)
    expected = [model.parameters.flexural_rigidity, 0.015, 0.5, 0.0, 0.0]
    assert [parameter.read(model) for parameter in parameters] == pytest.approx(expected)
    softer = parameters[0].to(model, parameters[0].position_of(0.5 * model.parameters.flexural_rigidity))
    assert softer.parameters.flexural_rigidity == pytest.approx(0.5 * model.parameters.flexural_rigidity)


def test_a_rod_follows_a_clamp_that_turns_by_less_than_markers_slip() -> None:
    """Two held points 20 mm apart, one of which moves by a millimetre: the rod's tip by a hundred."""
    places = np.stack([np.array([-0.02, 0.0, 0.25, 0.5, 1.0]), *np.zeros((2, 5))], axis=1)
    still = record_of(places, held_first=2, held_last=0, frames=100)
    held = still.controllers.copy()
    held[:, 0, 2] -= 0.001 * np.clip(still.times / still.times[50], 0.0, 1.0).astype(np.float32)
    turned = replace(still, controllers=held)
    body = marker_body(turned, None)
    model = rod_model(body, density=1000.0, rigidity=0.01, retardation_time=0.01, drag=1.0)
    driven = place_markers(model, body.grasp, turned).controls.positions[:, 2:]
    chord = driven[-1, 1] - driven[-1, 0]
    assert np.arctan2(chord[2], chord[0]) == pytest.approx(0.05, abs=1e-3)
