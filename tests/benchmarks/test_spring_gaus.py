"""Spring-Gaus as a baseline: its graph, how anchors make springs stiff, and that its fit goes downhill."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.prior import spring_gaus
from benchmarks.prior.anchor_springs import (
    FIXED,
    anchor_springs,
    neighbour_count,
    soft_vector,
    soft_vector_slope,
)
from benchmarks.prior.anchors import AnchoredItem
from benchmarks.prior.spring_gaus import (
    GLOBALS,
    SpringGausRefinement,
    body_at,
    body_like,
    fit_spring_gaus,
    predict_body,
)
from egophys_core.errors import SimulationError
from egophys_core.observation import prepare
from egophys_core.simulation import spring_order
from tests.identification.synthetic import known_model, make_episode, sheet_shape

ANCHORS = np.random.default_rng(0).uniform(-0.1, 0.1, (30, 3))


def anchored(**motion) -> AnchoredItem:
    """A sheet that is stiffer than its coarse fit says."""
    shape, true = sheet_shape(), known_model(stiffness_rate=0.4)
    episode = make_episode(true, **motion)
    problem = prepare(episode, shape.positions, shape.surface, spacing=shape.spacing)
    coarse = replace(true, stiffness=(0.3 * true.stiffness).astype(np.float32))
    return AnchoredItem(episode=episode, problem=problem, model=coarse, anchor="")


def test_each_anchor_asks_for_its_nearest_others():
    springs = anchor_springs(ANCHORS, neighbours=5)
    distances = np.linalg.norm(ANCHORS[:, None] - ANCHORS, axis=2)
    asked = np.argsort(distances, axis=1)[:, 1:6]
    assert set(map(tuple, springs.pairs.tolist())) == {
        (min(i, j), max(i, j)) for i, row in enumerate(asked.tolist()) for j in row
    }
    for (first, second), (rank, other_rank) in zip(springs.pairs.tolist(), springs.ranks.tolist(), strict=True):
        assert (asked[first, rank] == second) if rank >= 0 else second not in asked[first]
        assert (asked[second, other_rank] == first) if other_rank >= 0 else first not in asked[second]


def test_an_eighth_of_the_body_is_asked_for_as_in_its_own_setting():
    assert [neighbour_count(anchors) for anchors in (2048, 400, 40, 10)] == [256, 50, FIXED + 1, 9]


def test_anchors_at_one_place_have_springs_of_some_length():
    springs = anchor_springs(np.repeat(ANCHORS[:3], 2, axis=0), neighbours=3)
    assert (springs.rest_lengths > 0).all()
    assert (springs.pairs[:, 0] < springs.pairs[:, 1]).all()


def test_soft_vector_keeps_the_nearest_and_lets_go_of_the_farthest():
    even = soft_vector(0.0, 256)
    # exp(softplus(0)) = 2: the vector ends where the number of neighbours does.
    assert (even[:FIXED] == 1.0).all()
    assert even[-1] == pytest.approx(2.0 - 2.0 ** (239 / 240))
    assert even[FIXED + 120] == pytest.approx(2.0 - np.sqrt(2.0))
    assert soft_vector(-30.0, 256) == pytest.approx(np.ones(256))
    assert (soft_vector(3.0, 256) > 0).sum() == FIXED + np.ceil(240 * np.log(2.0) / np.log1p(np.exp(3.0)))


@pytest.mark.parametrize("softness", [-2.0, 0.0, 1.5])
def test_slope_of_the_soft_vector_is_a_difference_of_it(softness):
    difference = (soft_vector(softness + 1e-6, 64) - soft_vector(softness - 1e-6, 64)) / 2e-6
    assert soft_vector_slope(softness, 64) == pytest.approx(difference, abs=1e-7)


def test_stiffness_is_the_mean_of_what_both_ends_ask_for_over_the_length():
    line = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.3, 0, 0]])
    springs = anchor_springs(line, neighbours=1)
    assert springs.pairs.tolist() == [[0, 1], [1, 2]]
    # The last one asks for the middle one, which asks for the first.
    assert springs.stiffness(np.array([2.0, 4.0, 6.0]), 0.0) == pytest.approx([3.0 / 0.1, 3.0 / 0.2])
    assert springs.damping(0.5) == pytest.approx([0.5 / 0.1, 0.25 / 0.2])


@pytest.mark.parametrize("softness", [-1.0, 0.7])
def test_chain_rule_of_the_interpolation_agrees_with_differences(softness):
    generator = np.random.default_rng(1)
    springs = anchor_springs(ANCHORS, neighbours=25)
    anchors, weights = generator.uniform(0.5, 2.0, 30), generator.normal(size=len(springs.pairs))

    def total(values, h):
        return float(weights @ springs.stiffness(values, h))

    by_anchors, by_softness = springs.to_anchors(weights, anchors, softness)
    direction = generator.normal(size=30)
    along = (total(anchors + 1e-5 * direction, softness) - total(anchors - 1e-5 * direction, softness)) / 2e-5
    assert by_anchors @ direction == pytest.approx(along, rel=1e-6)
    assert by_softness == pytest.approx((total(anchors, softness + 1e-6) - total(anchors, softness - 1e-6)) / 2e-6)


def test_start_stores_and_loses_as_much_as_the_coarse_fit():
    model = known_model()
    body = body_like(model)
    squared, coarse = body.springs.rest_lengths**2, model.graph.rest_lengths.astype(float) ** 2
    stored, lost = body.springs.stiffness(body.anchors, 0.0), body.springs.damping(body.dashpot)
    assert stored @ squared == pytest.approx(float(model.stiffness @ coarse), rel=1e-5)
    assert lost @ squared == pytest.approx(float(model.spring_damping @ coarse), rel=1e-5)


def test_springs_of_the_batch_are_those_of_the_body():
    case = anchored()
    body = body_at(body_like(case.model), np.random.default_rng(2).uniform(-0.3, 0.3, 25 + len(GLOBALS)))
    batch, order = body.batch(case.problem, case.problem.controls), spring_order(body.model)
    assert np.array_equal(batch.springs[order], body.springs.pairs)
    assert batch.stiffness[0, order] == pytest.approx(body.springs.stiffness(body.anchors, body.softness), rel=1e-6)
    assert batch.damping[0, order] == pytest.approx(body.springs.damping(body.dashpot), rel=1e-6)


def test_derivative_by_the_coordinates_agrees_with_a_difference_of_losses():
    case = anchored()
    refinement = SpringGausRefinement(case.problem, body_like(case.model))
    coordinates = np.zeros_like(refinement.coordinates)
    _, gradient = refinement.derivative(coordinates, windows=1)
    generator = np.random.default_rng(3)
    for direction in (generator.uniform(0.2, 1.0, len(coordinates)), np.eye(len(coordinates))[-len(GLOBALS)]):
        # Float32 rollouts carry some 1e-7 m.
        step = 0.02
        ends = [refinement.derivative(sign * step * direction)[0] for sign in (1, -1)]
        assert (ends[0] - ends[1]) / (2 * step) == pytest.approx(float(gradient @ direction), rel=0.05)


def test_a_few_passes_lower_the_loss_and_the_best_is_kept():
    case = anchored(noise_m=2e-4)
    fit = fit_spring_gaus(case, passes=8)
    assert fit.losses.min() < 0.9 * fit.losses[0]
    assert fit.positions.shape == (len(case.episode.times), 25, 3)
    again, _ = SpringGausRefinement(case.problem, fit.body).derivative(np.zeros(25 + len(GLOBALS)))
    assert again == pytest.approx(fit.losses.min(), rel=1e-3)
    errors = fit.errors()
    assert list(errors) == ["train_cd_m", "test_cd_m", "train_te_m", "test_te_m"]
    assert fit.scores is not None
    assert errors["test_te_m"] == fit.scores.test_track_m


def test_a_body_that_diverges_has_no_errors(monkeypatch):
    def too_stiff(*_, **__):
        raise SimulationError("rollout 0 needs too many substeps")

    monkeypatch.setattr(spring_gaus, "differentiate", too_stiff)
    monkeypatch.setattr(spring_gaus, "rollout", too_stiff)
    fit = fit_spring_gaus(anchored(), passes=2)
    assert set(fit.errors().values()) == {None}
    assert np.isnan(fit.positions).all()
    assert np.isinf(fit.losses).all()


def test_prediction_is_at_rest_until_contact():
    case = anchored()
    body = body_like(case.model)
    predicted, first = predict_body(body, case.problem), case.problem.first_frame
    assert np.array_equal(predicted[: first + 1], np.repeat(case.problem.start[None], first + 1, axis=0))
