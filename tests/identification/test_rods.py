"""Rods: how markers lie along a cable, and how it is bent along them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_bvp
from scipy.optimize import brentq

from egophys_core.episode import Episode
from egophys_core.identification.marker_fit import MarkerSearch, build_marker_twin, marker_model
from egophys_core.identification.markers import marker_bodies, place_markers
from egophys_core.identification.rods import bend_to, find_chain, is_rod, modulus_of_rod
from egophys_core.identification.template import parse_template, stiffness_of_modulus
from egophys_core.simulation import batch_of_models, rollout
from tests.discrepancy.cantilever import HELD, TRACKS
from tests.identification.hanging_cable import LENGTH, curve, record_of

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
    assert chain.reaches[:4] == pytest.approx([-step, 0.0, chain.length, chain.length + step], abs=1e-3)
    assert chain.reaches[4:][np.argsort(order)] == pytest.approx(step * np.arange(1, 10), abs=1e-3)


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
    assert chain.reaches[:2] == pytest.approx([0.0, 0.0])
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
    """Sections stay plane, across the curve, and turn about the normal of its plane alone."""
    radius, length, width = 0.3, 0.6, 0.01
    reaches = np.linspace(0.0, length, 13)
    straight = np.stack([reaches, np.zeros(13), np.zeros(13)], axis=1)
    angles = reaches / radius
    seen = radius * np.stack([np.sin(angles), np.zeros(13), 1.0 - np.cos(angles)], axis=1)
    bend = bend_to(straight, seen)
    assert bend.place(straight) == pytest.approx(seen, abs=1e-6)
    beside = straight[3:-3] + [0.0, width, 0.0]
    assert bend.place(beside) - seen[3:-3] == pytest.approx(np.tile([0.0, width, 0.0], (7, 1)), abs=1e-4)
    above = bend.place(straight[3:-3] + [0.0, 0.0, width]) - seen[3:-3]
    normal = np.stack([-np.sin(angles), np.zeros(13), np.cos(angles)], axis=1)[3:-3]
    assert above == pytest.approx(width * normal, abs=2e-4)


def test_beyond_the_outermost_points_a_rod_is_straight() -> None:
    straight = np.stack([np.linspace(0.0, 0.4, 5), np.zeros(5), np.zeros(5)], axis=1)
    bend = bend_to(straight, straight + [0.0, 0.0, 0.5])
    assert bend.place(np.array([[0.5, 0.0, 0.01]])) == pytest.approx(np.array([[0.5, 0.0, 0.51]]))


def test_a_rod_is_straight_at_rest_and_begins_as_it_is_seen() -> None:
    episode = record_of(curve(13), held_first=2, held_last=2)
    bodies = marker_bodies(episode, None)
    assert len(bodies) > 1
    body = bodies[5]
    known = 4 + 9
    assert is_rod(body.grasp[:known].astype(np.float64))
    model = marker_model(body, density=1000.0, stiffness=100.0, damping=1e-4, drag=1.0)
    problem = place_markers(model, body.grasp, episode)
    assert problem.start[problem.bound] == pytest.approx(episode.points[0], abs=1e-5)
    axis = np.linalg.svd(body.grasp[:known] - body.grasp[:known].mean(axis=0))[2][0]
    assert np.ptp(body.graph.positions @ axis) == pytest.approx(LENGTH * 10 / 12, rel=2e-3)


def test_a_template_says_how_far_a_free_end_reaches() -> None:
    episode = record_of(curve(8), held_first=2, held_last=0)
    [free, *_] = marker_bodies(episode, parse_template("box:0.85x0.01x0.01"))
    assert free.length == pytest.approx(0.85)
    [bar] = marker_bodies(episode, parse_template("box:0.85x0.2x0.2"))
    assert len(bar.graph.positions) != len(free.graph.positions)


@pytest.mark.parametrize(("thickness", "stiffer"), [(9, 300.0), (12, 40.0), (15, 30.0)])
def test_a_rod_hangs_as_an_elastica(thickness: int, stiffer: float) -> None:
    """EI theta'' = w (L - s) cos(theta), clamped level at s = 0, free at L; EI by the tip's height alone.

    Love, Treatise on the Mathematical Theory of Elasticity (1927), ch. 19. Markers' heights and reaches then follow to
    1 % of the length, of which 1 % is the stretch that a rod is allowed.
    """
    length, count = 0.5, 8
    level = np.stack([np.linspace(-length / 6, length, count), np.zeros(count), np.ones(count)], axis=1)
    episode = record_of(level, held_first=2, held_last=0, frames=300)
    body = marker_bodies(episode, None)[thickness]
    search = MarkerSearch(body, [episode], {}, 1000.0)
    rate = np.log(stiffer * stiffness_of_modulus(modulus_of_rod(body.length, 1000.0), body.spacing) / search.node_mass)
    fit = search.at(np.array([rate, np.log(1e-5), 15.0, 0.0, 0.0]))
    problem = fit.problems[0]
    result = rollout(batch_of_models([fit.model], [problem.controls], starts=[problem.start], ground_height=-10.0))
    result.raise_on_failure()
    places = result.positions[0][-1, problem.bound] - level[1]

    def elastica(bending_length: float) -> np.ndarray:
        """[S, 2] metres along and up at the markers; (EI / w)^(1/3) is the bending length."""
        ways = np.linspace(0.0, body.length, 200)
        solved = solve_bvp(
            lambda s, y: np.stack([y[1], (body.length - s) * np.cos(y[0]) / bending_length**3]),
            lambda start, end: np.array([start[0], end[1]]),
            ways,
            np.stack([-1.5 * (1.0 - np.exp(-ways / bending_length)), np.zeros(len(ways))]),
            max_nodes=20_000,
        )
        slope = solved.sol(ways)[0]
        step = ways[1]
        along, up = (
            np.concatenate([[0.0], np.cumsum(step * (each[1:] + each[:-1]) / 2)])
            for each in (np.cos(slope), np.sin(slope))
        )
        at = np.linspace(0.0, body.length, count - 1)[1:]
        return np.stack([np.interp(at, ways, along), np.interp(at, ways, up)], axis=1)

    tip = float(places[-1, 2])
    found = brentq(lambda each: elastica(each)[-1, 1] - tip, 0.03 * length, 2.0 * length)
    assert places[:, [0, 2]] == pytest.approx(elastica(found), abs=0.01 * length)
    assert tip < -0.2 * length


def test_an_error_of_thickness_and_stiffness_is_found() -> None:
    """What our simulator does with a rod is recovered: its record is followed by the twin that is built from it."""
    planted = _swinging(record_of(curve(9), held_first=2, held_last=2, frames=150))
    twin = build_marker_twin([planted], None)
    way = np.ptp(planted.points, axis=0).max()
    assert way > 0.05
    assert twin.provenance.settings["rmse_m"] < 0.02 * way
    assert "rod" in twin.provenance.settings["assumed"][0]


def _swinging(episode: Episode) -> Episode:
    """The cable as our simulator swings it when one hand goes up and down."""
    lift = 0.08 * np.sin(2.0 * np.pi * 0.9 * episode.times)
    held = episode.controllers.copy()
    held[:, 2:, 2] += lift[:, None].astype(np.float32)
    moved = replace(episode, controllers=held)
    body = marker_bodies(moved, None)[8]
    rate = stiffness_of_modulus(modulus_of_rod(body.length, 1000.0), body.spacing)
    model = marker_model(body, density=1000.0, stiffness=float(rate), damping=1e-5 * float(rate), drag=2.0)
    problem = place_markers(model, body.grasp, moved)
    result = rollout(batch_of_models([model], [problem.controls], starts=[problem.start], ground_height=-10.0))
    result.raise_on_failure()
    return replace(moved, points=result.positions[0][:, problem.bound])
