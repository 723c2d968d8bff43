"""From episodes to a twin: recovery of a known model, determinism, and what is refused."""

import dataclasses

import numpy as np
import pytest

from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError, TwinError
from egophys_core.evaluation import baseline_scores
from egophys_core.identification import FitOptions, build, episode_digest, evaluate_twin, first_grasp
from egophys_core.identification.coarse import Candidates, evaluate_candidates, fit_coarse
from egophys_core.identification.loss import rollout_loss
from egophys_core.kinds.rest_shape import rest_shape
from egophys_core.observation import Contact, Hand, contact_flags, find_hands, prepare
from egophys_core.observation.at_rest import observed_at_rest, still_frames
from egophys_core.observation.contact import see_hands
from egophys_core.options import to_mapping
from egophys_core.simulation import ContactKind
from egophys_core.twin import connected_components, encode_twin
from tests.identification.synthetic import (
    ARRIVAL,
    FPS,
    episode_of,
    known_model,
    make_episode,
    searched_numbers,
    sheet_episode,
    sheet_shape,
    without,
)
from tests.simulation.scenes import sheet_positions

SHORT = FitOptions(generations=4, population=8, frame_stride=4, dense_steps=0)


def lifted(points: np.ndarray, *, grasp: np.ndarray, arrival: int) -> Episode:
    """The points in 20 frames after a hand came down to `grasp` in frame `arrival`, and lifts them all 9 cm."""
    frames = np.arange(arrival + 20)[:, None, None]
    lift = np.clip(frames - arrival - 2, 0, 15) * [0, 0, 0.006]
    hand = np.tile(grasp, (3, 1)) + np.maximum(arrival - frames, 0) * [0, 0, 0.02]
    return episode_of(points + lift, hand + lift)


def test_model_that_made_an_episode_has_no_loss_on_it():
    episode = sheet_episode()
    shape = sheet_shape()
    problem = prepare(episode, shape.positions, shape.surface, spacing=shape.spacing)
    coordinates = np.array([number.start_u for number in searched_numbers(shape.kind)])
    far = np.full(len(coordinates), 0.9)
    losses = evaluate_candidates([problem], Candidates(shape), [coordinates, far], stride=2)
    # The episode ran through settling from frame 0, the fit starts at rest three frames before the contact.
    assert losses[0] < 2e-3
    assert losses[1] > 5 * losses[0]


def test_known_stiffness_is_recovered_to_a_low_error_on_held_out_frames():
    # Twenty times softer than where the search starts, and more damped.
    made_by = known_model(stiffness_rate=0.25, damping_rate=0.6, friction=0.6)
    episode = make_episode(made_by, noise_m=5e-4)
    twin = build([episode], FitOptions(generations=25, population=12, frame_stride=3, dense_steps=0), seed=1)
    scores = twin.provenance.scores
    contact = contact_flags(episode, find_hands(episode))
    without_physics = min(each.test_track_m for each in baseline_scores(episode, contact).values())
    assert scores["train_track_m"] < 4e-3
    assert scores["test_track_m"] < 0.25 * without_physics
    assert 0.5 < twin.model.parameters.stiffness / made_by.parameters.stiffness < 2.0


def test_search_lowers_the_loss_and_never_forgets_its_best():
    episode = make_episode(known_model(stiffness_rate=0.2, damping_rate=0.7))
    shape = rest_shape(
        observed_at_rest(episode, still_frames(episode, see_hands(episode))),
        name=episode.name,
        ground=episode.ground_height,
        max_nodes=400,
    )
    problem = prepare(episode, shape.positions, shape.surface, spacing=shape.spacing)
    start = np.array([number.start_u for number in searched_numbers(shape.kind)])
    start_loss = evaluate_candidates([problem], Candidates(shape), [start], stride=4)[0]
    reported = []
    fit = fit_coarse(
        [problem],
        shape,
        FitOptions(generations=10, population=8, frame_stride=4, dense_steps=0),
        seed=0,
        progress=lambda share, loss: reported.append((share, loss)),
    )
    assert fit.history[-1] < 0.7 * start_loss
    assert fit.history[-1] < fit.history[0]
    assert (np.diff(fit.history) <= 0).all()
    assert [loss for _, loss in reported] == list(fit.history)
    assert [share for share, _ in reported] == pytest.approx(np.arange(1, 11) / 10)


def test_same_seed_gives_the_same_twin_to_the_byte_and_another_seed_another():
    one, same, other = (build([sheet_episode()], SHORT, seed=seed) for seed in (7, 7, 8))
    assert encode_twin(one) == encode_twin(same)
    assert one.twin_id == same.twin_id
    assert one.twin_id != other.twin_id
    assert not np.array_equal(one.model.stiffness, other.model.stiffness)


def test_fit_neither_uses_nor_touches_numpys_global_generator():
    np.random.seed(123)
    before = np.random.get_state()[1].copy()
    one = build([sheet_episode()], SHORT, seed=7)
    assert np.array_equal(np.random.get_state()[1], before)
    np.random.seed(5)
    assert build([sheet_episode()], SHORT, seed=7).twin_id == one.twin_id


def test_twin_says_what_made_it():
    episode = sheet_episode()
    twin = build([episode], SHORT, seed=3, parent_id="0123456789abcdef")
    provenance = twin.provenance
    assert provenance.episodes == ({"name": "synthetic", "sha256": episode_digest(episode)},)
    of_markers = {"template", "density"}
    assert provenance.settings == {name: each for name, each in to_mapping(SHORT).items() if name not in of_markers}
    assert (provenance.seed, provenance.parent_id) == (3, "0123456789abcdef")
    assert twin.model.kind == "sheet"
    scores, predicted = evaluate_twin(twin, episode)
    assert scores.as_dict() == provenance.scores
    assert predicted.shape == (episode.frames, 25, 3)
    # The grasp is where the fingers are as the hold begins.
    assert twin.grasp == pytest.approx(episode.controllers[round(ARRIVAL / FPS)], abs=0.02)


def test_grasp_is_where_a_hand_takes_hold_though_another_pressed_before():
    shape = sheet_shape()
    problem = prepare(sheet_episode(), shape.positions, shape.surface, spacing=shape.spacing)
    press = Hand(controllers=np.array([0]), contacts=(Contact(first=2, last=5, kind=ContactKind.PRESS),))
    holds = tuple(Contact(first=first, last=first + 9, kind=ContactKind.HOLD) for first in (20, 40))
    hands = (press, Hand(controllers=np.array([1, 2]), contacts=holds))
    grasp = first_grasp(dataclasses.replace(problem, hands=hands))
    assert np.array_equal(grasp, problem.episode.controllers[20, 1:])
    pressed = first_grasp(dataclasses.replace(problem, hands=(press,)))
    assert np.array_equal(pressed, problem.episode.controllers[2, :1])


def test_points_that_are_seen_now_and_then_are_enough():
    episode = without(sheet_episode(), frames=slice(20, 60, 3), points=slice(0, 12))
    twin = build([episode], SHORT, seed=0)
    assert np.isfinite(list(twin.provenance.scores.values())).all()


def test_progress_goes_from_nothing_to_all_and_can_stop_the_build():
    stages = []
    build([sheet_episode()], SHORT, seed=0, progress=lambda *report: stages.append(report))
    shares = [share for _, share, _ in stages]
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert list(dict.fromkeys(stage for stage, _, _ in stages)) == ["prepare", "search", "evaluate", "done"]

    def stop(stage: str, share: float, loss: float) -> None:
        if stage == "search":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        build([sheet_episode()], SHORT, seed=0, progress=stop)


def test_several_episodes_are_fitted_together_with_the_object_placed_in_each():
    model = known_model()
    one = make_episode(model)
    angle = 0.6
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    moved = (model.graph.positions @ turn.T + [0.1, 0.05, 0]).astype(np.float32)
    two = make_episode(model, name="second", start=moved, carry=(-0.05, 0.02, 0.1))
    twin = build([one, two], SHORT, seed=0)
    assert [each["name"] for each in twin.provenance.episodes] == ["synthetic", "second"]
    shape = twin.model.graph
    problem = prepare(two, shape.positions, shape.surface, spacing=0.04)
    assert np.median(np.linalg.norm(problem.start - moved, axis=1)) < 2e-3
    assert twin.twin_id != build([one], SHORT, seed=0).twin_id


def test_gap_in_the_surface_is_bridged():
    # Two halves 20 cm apart, out of reach of any spring the search may choose.
    half = sheet_positions(4, 0.03, 0.004)
    points = np.concatenate([half, half + np.float32([0.25, 0, 0])])
    episode = lifted(points, grasp=points[0] + [0, 0, 0.01], arrival=12)
    twin = build([episode], FitOptions(generations=1, population=4, dense_steps=0, kind="sheet"), seed=0)
    assert connected_components(len(points), twin.model.graph.springs).max() == 0


def test_solid_keeps_its_inner_nodes_unseen():
    generator = np.random.default_rng(0)
    direction = generator.normal(size=(60, 3))
    ball = 0.06 * direction / np.linalg.norm(direction, axis=1, keepdims=True) + [0, 0, 0.06]
    episode = lifted(ball, grasp=ball[np.argmax(ball[:, 2])], arrival=10)
    twin = build([episode], FitOptions(generations=1, population=4, dense_steps=0), seed=0)
    graph = twin.model.graph
    assert twin.model.kind == "solid"
    assert graph.surface.sum() == 60
    assert len(graph.positions) > 65
    assert twin.model.parameters.drag > 0


def test_hand_that_never_comes_near_is_refused():
    episode = sheet_episode()
    away = dataclasses.replace(episode, controllers=episode.controllers + np.float32([0, 0, 2.0]))
    with pytest.raises(
        EpisodeError, match=r"synthetic: no hand moves the object: none ever comes nearer .* than 2\.\d\d m"
    ):
        build([away], SHORT, seed=0)


def test_hand_that_waits_beside_the_object_is_refused():
    episode = sheet_episode()
    waits = dataclasses.replace(episode, controllers=np.repeat(episode.controllers[:1], episode.frames, axis=0))
    beside = episode.points[0, 0] - waits.controllers[0].mean(axis=0) + np.float32([0.0, 0.0, 0.02])
    waits = dataclasses.replace(waits, controllers=waits.controllers + beside)
    with pytest.raises(EpisodeError, match=r"synthetic: no hand moves the object \(no points within 0\.04 m"):
        build([waits], SHORT, seed=0)


def test_no_episode_and_too_short_ones_are_refused():
    with pytest.raises(EpisodeError, match="no episode given"):
        build([], SHORT, seed=0)
    short = episode_of(np.tile(sheet_positions(), (2, 1, 1)), np.zeros((2, 1, 3)))
    with pytest.raises(EpisodeError, match="2 frames leave 0 to fit"):
        build([short], SHORT, seed=0)


def test_hold_after_the_train_frames_is_refused_with_the_reason():
    # Nothing moves in the first 70 %: there is nothing to fit.
    episode = lifted(sheet_positions(), grasp=sheet_positions()[0] + [0, 0, 0.01], arrival=50)
    with pytest.raises(EpisodeError, match=r"synthetic: .* fitted; with the first contact at frame (49|5.) it takes"):
        build([episode], SHORT, seed=0)


def test_controllers_that_jump_out_of_the_world_make_every_candidate_diverge():
    shape = sheet_shape()
    problem = prepare(sheet_episode(), shape.positions, shape.surface, spacing=shape.spacing)
    wild = problem.controls.positions.copy()
    wild[25:] = 1e37
    problem = dataclasses.replace(problem, controls=dataclasses.replace(problem.controls, positions=wild))
    with pytest.raises(TwinError, match="every candidate of the coarse fit diverged"):
        fit_coarse([problem], shape, SHORT, seed=0, progress=lambda share, loss: None)


def test_digest_changes_with_everything_a_fit_sees():
    episode = sheet_episode()
    digests = {episode_digest(episode)}
    for name in ("points", "controllers", "times"):
        changed = getattr(episode, name).copy()
        changed[-1] += np.asarray(1e-3, changed.dtype)
        digests.add(episode_digest(dataclasses.replace(episode, **{name: changed})))
    assert len(digests) == 4


def test_loss_is_chamfer_plus_track_error():
    # One vertex 1 cm off along the diagonal of x and y: L1 distance 0.02, Euclidean distance 0.01 sqrt(2).
    predicted = np.array([[[0.01, 0.01, 0], [5, 5, 5]]])
    surface, bound = np.array([True, False]), np.array([0])
    loss = rollout_loss(predicted, surface, bound, np.zeros((1, 1, 3)))
    assert loss == pytest.approx(0.02 + 0.01 * np.sqrt(2))
    assert rollout_loss(predicted * np.nan, surface, bound, np.zeros((1, 1, 3))) == np.inf
