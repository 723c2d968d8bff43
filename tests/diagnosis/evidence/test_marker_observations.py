"""Objects with a few markers: a synthetic cantilever is placed, followed and recovered."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.sparse import diags
from scipy.sparse.linalg import eigsh
from scipy.spatial.transform import Rotation

from egophys_core.diagnosis.evidence.fitted_parameters import with_effect
from egophys_core.diagnosis.evidence.marker_observations import observe_markers, unidentifiable_effects
from egophys_core.diagnosis.evidence.refit import median_size
from egophys_core.diagnosis.evidence.residuals import block_means, residuals, track_offsets
from egophys_core.diagnosis.hypotheses.ranking import probe_effects
from egophys_core.effects import LIBRARY
from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError, OptionsError, SimulationError
from egophys_core.identification import FitOptions, build, evaluate_twin
from egophys_core.identification.marker_fit import MarkerFit, MarkerSearch, marker_errors
from egophys_core.kinds import kind_named, kind_of, node_masses
from egophys_core.kinds.kind import MarkerBody
from egophys_core.kinds.lattice import lattice_model, turned
from egophys_core.kinds.template import parse_template
from egophys_core.observation import observe_episode, place_twin
from egophys_core.observation.marker_record import find_onset
from egophys_core.simulation import ContactKind, batch_of_models
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
    still_episode,
    swinging,
    twin_of,
)
from tests.kinds.seen_markers import marker_body, place_markers


@pytest.fixture(scope="module")
def cantilever() -> tuple[MarkerBody, ObjectModel, Episode]:
    body, model = body_and_model()
    return body, model, swinging(body, model)


def test_begins_where_the_swing_turns(cantilever: tuple[MarkerBody, ObjectModel, Episode]) -> None:
    episode = cantilever[2]
    onset = find_onset(episode)
    heights = episode.points[:, :, 2].mean(axis=1)
    assert abs(onset.frame - int(heights[:40].argmin())) <= 1
    assert onset.markers[:, 2].mean() == pytest.approx(heights[:40].min(), abs=5e-5)


def test_what_is_not_let_go_begins_at_once() -> None:
    onset = find_onset(still_episode())
    assert (onset.frame, onset.time) == (0, 0.0)


def test_free_rollout_from_the_turn_follows_the_swing(cantilever: tuple[MarkerBody, ObjectModel, Episode]) -> None:
    body, model, episode = cantilever
    observation = observe_markers(twin_of(body, model), episode)
    found = block_means(observation, track_offsets(observation, [model])[0])
    swing = np.ptp(episode.points[:, :, 2].mean(axis=1))
    # Bent by its markers it is not quite as gravity bent it, and higher modes are not at rest.
    assert np.nanmax(np.abs(found)) < 0.05 * swing


def test_a_record_mounted_anew_says_as_much_of_the_swing(
    cantilever: tuple[MarkerBody, ObjectModel, Episode],
) -> None:
    """What a turn of the clamp by 0.7 degrees moves is set aside for the most part; a wrong stiffness is not."""
    body, model, episode = cantilever
    turn = Rotation.from_rotvec([0.0, 0.0, 0.012]).as_matrix()
    clamp = body.grasp[len(HELD) + len(TRACKS) :].mean(axis=0)
    turned_record = replace(episode, points=((episode.points - clamp) @ turn.T + clamp).astype(np.float32))
    observation = observe_markers(twin_of(body, model), turned_record)
    offset = np.nanmean(track_offsets(observation, [model])[0], axis=(0, 1, 2))
    stiffer = replace(model, stiffness=model.stiffness * np.float32(1.3))
    true, wrong = ([each] for each in residuals([observation], [model, stiffer])[0])
    assert np.linalg.norm(offset) > 1e-3
    assert median_size(true) < 0.25 * np.linalg.norm(offset)
    assert median_size(wrong) > 2.0 * median_size(true)


def test_what_hands_move_is_not_mounted_anew(cantilever: tuple[MarkerBody, ObjectModel, Episode]) -> None:
    """A steady offset counts in full, in blocks that are as long as those of what is seen as a surface."""
    body, model, _ = cantilever
    still = still_episode(frames=100)
    hands = still.controllers + np.linspace(0.0, 0.1, 100, dtype=np.float32)[:, None, None]
    found = []
    for shift in (0.0, 0.003):
        points = still.points.copy()
        points[50:] += np.float32(shift)
        observation = observe_markers(twin_of(body, model), replace(still, controllers=hands, points=points))
        assert not observation.mounted
        assert observation.block_count == round(still.times[-1] / 0.2)
        (blocks,) = residuals([observation], [model])[0][:, :, : len(TRACKS)]
        found.append(blocks)
    moved = found[1] - found[0]
    assert moved[:2] == pytest.approx(0.0, abs=1e-5)
    assert moved[3:] == pytest.approx(0.003, abs=1e-5)


def test_a_twin_is_evaluated_at_its_markers(cantilever: tuple[MarkerBody, ObjectModel, Episode]) -> None:
    body, model, episode = cantilever
    scores, predicted = evaluate_twin(twin_of(body, model), episode)
    assert predicted.shape[1] == len(body.graph.positions)
    swing = float(np.ptp(episode.points[:, :, 2].mean(axis=1)))
    assert scores.all_track_m < 0.05 * swing


def test_the_clamp_of_markers_holds_all_the_time(cantilever: tuple[MarkerBody, ObjectModel, Episode]) -> None:
    episode = cantilever[2]
    contacts = observe_episode(episode).contact
    assert contacts.shape[1] == len(HELD)
    assert (contacts == ContactKind.HOLD).all()


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
    fits: list[MarkerFit] = [
        search.at(np.array([np.log(RATE * factor), np.log(1e-9), DRAG, 0.0, 0.0])) for factor in factors
    ]
    assert int(np.argmin(marker_errors(fits))) == 2


@pytest.mark.parametrize(("way", "axis"), [("pitch", 2), ("yaw", 1)])
def test_turns_upward_and_to_its_left_about_the_clamp(way: str, axis: int) -> None:
    body = marker_body(still_episode(), parse_template(TEMPLATE))
    known = len(HELD) + len(TRACKS)
    moved = turned(body, known, **{"pitch": 0.0, "yaw": 0.0, way: 0.02})
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


def test_a_load_slows_a_swing_as_it_does_a_beam(cantilever: tuple[MarkerBody, ObjectModel, Episode]) -> None:
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


def test_slopes_of_effects_on_a_swing_are_those_near_none(
    cantilever: tuple[MarkerBody, ObjectModel, Episode],
) -> None:
    """Material that is stiffer along the beam makes its swing faster: where a search for it starts the swing
    is out of step, and tells nothing of a little of it."""
    body, model, episode = cantilever
    observation = observe_markers(twin_of(body, model), episode)
    [baseline] = residuals([observation], [model])
    others = [name for name in LIBRARY if name != "anisotropy"]
    [probe] = probe_effects([observation], model, [baseline[0]], without=others, progress=lambda share: None)
    there = with_effect(model, "anisotropy", {"cosine": 1e-3, "sine": 0.0})
    fine = (residuals([observation], [there])[0][0] - baseline[0]) / 0.01
    seen = np.isfinite(fine)
    assert np.abs(fine[seen]).max() > 1e-4
    assert probe.slopes[0][..., 0][seen] == pytest.approx(fine[seen], abs=0.25 * np.abs(fine[seen]).max())


def test_a_still_clamp_tells_nothing_of_the_hands(cantilever: tuple[MarkerBody, ObjectModel, Episode]) -> None:
    body, model, episode = cantilever
    observation = observe_markers(twin_of(body, model), episode)
    unidentifiable = unidentifiable_effects(kind_of(model), [observation])
    assert "tracking_offset" in unidentifiable
    assert "viscoelasticity" not in unidentifiable
    assert observation.rate == 0.0


def test_a_rod_tells_nothing_of_springs_nor_a_record_of_markers_of_a_table(
    cantilever: tuple[MarkerBody, ObjectModel, Episode],
) -> None:
    body, model, episode = cantilever
    moved = replace(observe_markers(twin_of(body, model), episode), mounted=False)
    of_a_rod, of_a_lattice = (set(unidentifiable_effects(kind_named(name), [moved])) for name in ("rod", "lattice"))
    assert of_a_lattice == {"table_adhesion", "place_dependent_friction", "stribeck_friction"}
    assert of_a_rod < set(LIBRARY)
    assert "viscoelasticity" in of_a_rod
    assert not {"quadratic_drag", "control_delay", "uneven_mass", "gripper_offset"} & of_a_rod


def test_clamp_is_followed_when_it_moves() -> None:
    body, model = body_and_model()
    episode = still_episode()
    shift = np.linspace(0.0, 0.05, FRAMES)[:, None, None] * [0.0, 1.0, 0.0]
    moved = replace(episode, controllers=(episode.controllers + shift).astype(np.float32))
    held = place_markers(model, body.grasp, moved).controls.positions[:, len(HELD) :]
    np.testing.assert_allclose(held[-1] - held[0], np.broadcast_to([0.0, 0.05, 0.0], held[0].shape), atol=1e-6)


def test_a_record_begins_where_all_markers_are_seen(cantilever: tuple[MarkerBody, ObjectModel, Episode]) -> None:
    body, model, _ = cantilever
    late = still_episode(frames=100)
    points = late.points.copy()
    points[:5, 0] = np.nan
    late = replace(late, points=points)
    placed = place_markers(model, body.grasp, late)
    assert placed.episode.frames == 95
    assert np.isfinite(placed.episode.points).all()
    assert marker_body(late, parse_template(TEMPLATE)).grasp == pytest.approx(body.grasp)
    observation = observe_markers(twin_of(body, model), late)
    assert observation.record is not None
    assert observation.record.times[0] == 0.0


def test_markers_that_are_never_all_seen_are_refused() -> None:
    points = still_episode().points.copy()
    points[::2, 0], points[1::2, 1] = np.nan, np.nan
    points[0, 2] = np.nan
    hidden = replace(still_episode(), points=points)
    with pytest.raises(EpisodeError, match=f"no frame shows all {len(TRACKS)} markers"):
        marker_body(hidden, None)
    points[-1] = still_episode().points[-1]
    with pytest.raises(EpisodeError, match="no frame shows all"):
        marker_body(replace(hidden, points=points), None)


def test_bad_input_is_refused() -> None:
    episode = still_episode()
    with pytest.raises(EpisodeError, match="no controller points, so nothing moves the object"):
        marker_body(
            replace(episode, controllers=episode.controllers[:, :0], controller_ids=episode.controller_ids[:0]), None
        )
    with pytest.raises(OptionsError, match="not among"):
        build([episode], loads={"other": 1.0})
    with pytest.raises(OptionsError, match="density"):
        FitOptions(density=0.0)
