"""Lattices: a cantilever at three markers is placed, loaded and recovered."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.sparse import diags
from scipy.sparse.linalg import eigsh

from egophys_core.effects import TwinEffect
from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError, OptionsError, SimulationError
from egophys_core.identification import FitOptions, evaluate_twin
from egophys_core.identification.marker_fit import MarkerSearch, marker_residuals
from egophys_core.kinds import node_masses
from egophys_core.kinds.kind import MarkerBody
from egophys_core.kinds.lattice import lattice_model, turned
from egophys_core.kinds.template import parse_template
from egophys_core.observation import observe_episode, place_twin
from egophys_core.simulation import batch_of_models
from egophys_core.twin import GRAVITY, ObjectModel
from egophys_core.twin.statics import stiffness_matrix
from tests.diagnosis.cantilever import (
    DENSITY,
    DRAG,
    FRAMES,
    HELD,
    RATE,
    TEMPLATE,
    TRACKS,
    body_and_model,
    ring_down_episode,
    still_episode,
    twin_of,
)
from tests.kinds.seen_markers import marker_body, place_markers


@pytest.fixture(scope="module")
def cantilever() -> tuple[MarkerBody, ObjectModel, Episode]:
    body, model = body_and_model()
    return body, model, ring_down_episode(body, model)


def test_a_twin_of_something_else_has_no_place_at_the_markers(
    cantilever: tuple[MarkerBody, ObjectModel, Episode],
) -> None:
    body, model, episode = cantilever
    other = replace(twin_of(body, model), grasp=body.grasp + np.float32(0.1))
    with pytest.raises(EpisodeError, match="is it a twin of these markers"):
        place_twin(other, episode)


def test_true_stiffness_beats_its_neighbours(cantilever: tuple[MarkerBody, ObjectModel, Episode]) -> None:
    body, _, episode = cantilever
    search = MarkerSearch(body, [observe_episode(episode)], DENSITY)
    factors = (0.8, 0.9, 1.0, 1.1, 1.25)
    fits = [search.at(np.array([np.log(RATE * factor), np.log(1e-9), DRAG, 0.0, 0.0])) for factor in factors]
    assert int(np.argmin(np.linalg.norm(marker_residuals(fits), axis=1))) == 2


@pytest.mark.parametrize(("angle", "axis"), [("pitch", 2), ("yaw", 1)])
def test_turns_upward_and_to_its_left_about_the_clamp(angle: str, axis: int) -> None:
    body = marker_body(still_episode(), parse_template(TEMPLATE))
    known = len(HELD) + len(TRACKS)
    moved = turned(body, known, **{"pitch": 0.0, "yaw": 0.0, angle: 0.02})
    shift = (moved.graph.positions[-len(TRACKS) :] - body.graph.positions[-len(TRACKS) :]).mean(axis=0)
    length = float(TRACKS[:, 0].mean() - body.grasp[known:, 0].mean())
    assert shift[axis] == pytest.approx(0.02 * length, rel=0.02)
    assert np.delete(shift, axis) == pytest.approx(0.0, abs=1e-4)
    assert (moved.grasp[:known] == body.grasp[:known]).all()


@pytest.mark.parametrize(("held", "turns"), [(HELD, False), (HELD[:2], True)], ids=["three held", "two held"])
def test_a_beam_held_back_at_the_start_is_placed_by_its_clamp(held: np.ndarray, turns: bool) -> None:
    """Two held points do not tell how it is turned; the markers help, and the hand at them turns it."""
    body = marker_body(still_episode(held), parse_template(TEMPLATE))
    model = lattice_model(body, density=DENSITY, stiffness=RATE * DENSITY * body.spacing**3, damping=1e-9, drag=DRAG)
    held_back = still_episode(held, TRACKS + [0.0, 0.005, 0.0])
    placed = place_markers(model, body.grasp, held_back).controls.positions[0, len(held) :]
    away = np.linalg.norm(placed - body.grasp[len(held) + len(TRACKS) :], axis=1).max()
    assert (away > 2e-4) if turns else (away < 1e-5)


def test_a_load_hangs_at_the_end_and_markers_weigh_nothing(
    cantilever: tuple[MarkerBody, ObjectModel, Episode],
) -> None:
    body, model, episode = cantilever
    payload = place_markers(model, body.grasp, episode, load=0.1).controls.payload
    assert payload is not None
    (end,) = np.flatnonzero(payload > 0)
    assert payload[end] == pytest.approx(0.1 / 9.81)
    assert body.graph.positions[end] == pytest.approx([0.1, 0.0, 0.5], abs=1e-3)
    masses = node_masses(model) + payload
    cells = len(masses) - len(TRACKS) - 1
    assert masses.min() > 0.0
    assert masses.sum() == pytest.approx(cells * DENSITY * body.spacing**3 + 0.1 / 9.81)


def test_a_node_that_would_weigh_nothing_is_refused(cantilever: tuple[MarkerBody, ObjectModel, Episode]) -> None:
    body, model, episode = cantilever
    controls = place_markers(model, body.grasp, episode).controls
    lifted = replace(controls, payload=np.where(np.arange(len(node_masses(model))) == 7, -1.0, 0.0))
    with pytest.raises(SimulationError, match=r"payload leaves .* kg of node 7"):
        batch_of_models([model], [lifted], ground_height=-10.0)


def test_mass_that_an_effect_shifts_away_leaves_what_relieves_markers_positive(
    cantilever: tuple[MarkerBody, ObjectModel, Episode],
) -> None:
    body, model, episode = cantilever
    values = {"x": -0.05, "y": 0.0, "z": 0.0, "radius": 0.01, "fraction": 4.0}
    uneven = replace(model, effects=(TwinEffect(name="uneven_mass", values=values),))
    controls = place_markers(model, body.grasp, episode, load=0.1).controls
    masses = batch_of_models([uneven], [controls], ground_height=-10.0).masses[0]
    assert masses.min() > 0.0
    assert masses.sum() == pytest.approx(
        batch_of_models([model], [controls], ground_height=-10.0).masses.sum(), rel=1e-4
    )


def test_a_load_slows_a_ring_down_as_it_does_a_beam(cantilever: tuple[MarkerBody, ObjectModel, Episode]) -> None:
    """1 + cosh x cos x = r x (sin x cosh x - cos x sinh x), x^2 in proportion to the rate, r = load over beam.

    Blevins, Formulas for Natural Frequency and Mode Shape (1979), table 8-8: a cantilever with a mass at its end.
    """
    body, model, episode = cantilever
    graph, clamped = model.graph, body.grasp[len(HELD) + len(TRACKS) :]
    free = np.linalg.norm(graph.positions[:, None] - clamped, axis=2).min(axis=1) > 1e-4
    axes = np.repeat(free, 3)
    stiffness = stiffness_matrix(graph.positions.astype(float), graph.springs, model.stiffness.astype(float))
    beam = DENSITY * 0.015**2 * float(0.1 - clamped[:, 0].mean())

    def rate(load: float) -> float:
        payload = place_markers(model, body.grasp, episode, load=load).controls.payload
        masses = np.repeat(node_masses(model) + payload, 3)[axes]
        return float(np.sqrt(eigsh(stiffness[axes][:, axes], k=1, M=diags(masses).tocsc(), sigma=0.0)[0][0]))

    def of_beam(load: float) -> float:
        share = load / GRAVITY / beam
        return (
            brentq(
                lambda x: 1 + np.cosh(x) * np.cos(x) - share * x * (np.sin(x) * np.cosh(x) - np.cos(x) * np.sinh(x)),
                0.1,
                2.0,
            )
            ** 2
        )

    for load in (0.1, 0.3):
        assert rate(0.0) / rate(load) == pytest.approx(of_beam(0.0) / of_beam(load), rel=0.02)


def test_clamp_is_followed_when_it_moves() -> None:
    body, model = body_and_model()
    episode = still_episode()
    shift = np.linspace(0.0, 0.05, FRAMES)[:, None, None] * [0.0, 1.0, 0.0]
    moved = replace(episode, controllers=(episode.controllers + shift).astype(np.float32))
    held = place_markers(model, body.grasp, moved).controls.positions[:, len(HELD) :]
    np.testing.assert_allclose(held[-1] - held[0], np.broadcast_to([0.0, 0.05, 0.0], held[0].shape), atol=1e-6)


def test_a_twin_is_evaluated_at_its_markers(cantilever: tuple[MarkerBody, ObjectModel, Episode]) -> None:
    body, model, episode = cantilever
    scores, predicted = evaluate_twin(twin_of(body, model), episode)
    assert predicted.shape[1] == len(body.graph.positions)
    extent = float(np.ptp(episode.points[:, :, 2].mean(axis=1)))
    assert scores.all_track_m < 0.05 * extent


def test_what_is_held_by_nothing_and_a_density_of_nothing_are_refused() -> None:
    episode = still_episode()
    with pytest.raises(EpisodeError, match="no controller points, so nothing moves the object"):
        marker_body(
            replace(episode, controllers=episode.controllers[:, :0], controller_ids=episode.controller_ids[:0]), None
        )
    with pytest.raises(OptionsError, match="density"):
        FitOptions(density=0.0)
