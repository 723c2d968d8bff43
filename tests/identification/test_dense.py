"""Dense refinement: the gradient it follows, what it recovers, and which step it keeps."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.evaluation import chamfer_per_frame, track_error_per_frame
from egophys_core.identification import FitOptions, build, dense
from egophys_core.identification.adam import Adam
from egophys_core.identification.dense import CONTACT_NAMES, DenseRefinement, fit_dense, model_at
from egophys_core.identification.loss import loss_gradient
from egophys_core.kinds import KINDS
from egophys_core.observation import prepare
from tests.identification.synthetic import known_model, make_episode, sheet_shape

OPTIONS = FitOptions(frame_stride=2, dense_rate=0.1)


def problem_of(model, **motion):
    shape = sheet_shape()
    return prepare(make_episode(model, **motion), shape.positions, shape.surface, spacing=shape.spacing)


def softer(model, factor):
    return replace(model, stiffness=(model.stiffness * factor).astype(np.float32))


@pytest.mark.parametrize("seed", range(5))
def test_gradient_of_the_loss_agrees_with_central_differences(seed):
    generator = np.random.default_rng(seed)
    predicted = generator.uniform(-0.1, 0.1, (3, 12, 3))
    surface = generator.random(12) < 0.8
    observed = generator.uniform(-0.1, 0.1, (3, 9, 3))
    observed[generator.random((3, 9)) < 0.3] = np.nan
    bound = generator.integers(-1, surface.sum(), 9)

    def total(points):
        visible = points[:, surface]
        errors = chamfer_per_frame(visible, observed) + track_error_per_frame(visible, observed, bound)
        return float(np.nansum(errors))

    gradient = loss_gradient(predicted, surface, bound, observed)
    for _ in range(5):
        direction = generator.normal(size=predicted.shape)
        # Small enough that no other node becomes the nearest.
        step = 1e-7
        difference = (total(predicted + step * direction) - total(predicted - step * direction)) / (2 * step)
        assert difference == pytest.approx(float((gradient * direction).sum()), rel=1e-4, abs=1e-6)


def test_frame_without_visible_points_has_no_gradient():
    predicted, surface = np.zeros((1, 4, 3)), np.ones(4, bool)
    assert not loss_gradient(predicted, surface, np.arange(2), np.full((1, 2, 3), np.nan)).any()


def test_exact_fit_has_a_finite_gradient():
    predicted, surface = np.random.default_rng(0).normal(size=(2, 4, 3)), np.ones(4, bool)
    assert not loss_gradient(predicted, surface, np.arange(4), predicted).any()


def test_derivative_by_the_coordinates_agrees_with_a_difference_of_losses(monkeypatch):
    monkeypatch.setattr(dense, "WINDOWS", 1)
    problem = problem_of(known_model(stiffness_rate=0.3, damping_rate=0.8))
    model = softer(known_model(stiffness_rate=0.2, damping_rate=0.8), 0.7)
    refinement = DenseRefinement([problem], model, OPTIONS)
    direction = np.random.default_rng(1).normal(size=len(refinement.coordinates))

    def fitted(share):
        return refinement._derivative(problem, model_at(model, share * direction))[0].fitted

    _, gradient = refinement._derivative(problem, model)
    # Float32 rollouts carry some 1e-7 m; the step is long enough that the loss moves by 1e-4 m.
    step = 0.02
    assert (fitted(step) - fitted(-step)) / (2 * step) == pytest.approx(float(gradient @ direction), rel=0.05)


def test_wrong_stiffness_is_refined_towards_the_episode():
    problem = problem_of(known_model(stiffness_rate=0.4), noise_m=2e-4)
    start = softer(known_model(stiffness_rate=0.4), 0.3)
    refinement = DenseRefinement([problem], start, OPTIONS)
    for _ in range(30):
        refinement.step()
    first, validation = refinement.history[0], [step.validation for step in refinement.history]
    assert refinement.history[-1].fitted < 0.5 * first.fitted
    assert refinement.best_validation == min(validation) < 0.6 * first.validation
    # Springs got stiffer again, where they carry something.
    assert np.median(refinement.best.stiffness / start.stiffness) > 1.1


def test_coarse_model_is_kept_when_no_step_is_better(monkeypatch):
    downhill = Adam.step
    monkeypatch.setattr(Adam, "step", lambda adam, gradient: -downhill(adam, gradient))
    start = softer(known_model(), 0.5)
    options = replace(OPTIONS, dense_steps=4)
    best = fit_dense([problem_of(known_model())], start, options, progress=lambda share, loss: None)
    assert np.array_equal(best.stiffness, start.stiffness)


def test_no_steps_leave_the_model_alone():
    model = known_model()
    assert fit_dense([], model, FitOptions(dense_steps=0), progress=lambda share, loss: None) is model


def test_refinement_repeats_itself_to_the_bit():
    problem, start = problem_of(known_model()), softer(known_model(), 0.5)
    runs = []
    for _ in range(2):
        refinement = DenseRefinement([problem], start, OPTIONS)
        steps = [refinement.step() for _ in range(3)]
        runs.append((steps, refinement.coordinates.tobytes()))
    assert runs[0] == runs[1]


def test_two_episodes_are_refined_together():
    model = softer(known_model(), 0.5)
    problems = [problem_of(known_model()), problem_of(known_model(), carry=(-0.05, 0.02, 0.1))]
    together = DenseRefinement(problems, model, OPTIONS).step()
    alone = [DenseRefinement([problem], model, OPTIONS).step() for problem in problems]
    assert together.fitted == pytest.approx(np.mean([step.fitted for step in alone]))
    assert together.validation == pytest.approx(np.mean([step.validation for step in alone]))


def test_of_a_solid_all_train_frames_are_followed_and_the_last_choose(monkeypatch):
    problem, start = problem_of(known_model()), softer(known_model(), 0.5)
    sheet = DenseRefinement([problem], start, OPTIONS).step()
    monkeypatch.setattr(dense, "kind_of", lambda model: KINDS["solid"])
    solid = DenseRefinement([problem], start, OPTIONS).step()
    assert solid.validation == pytest.approx(sheet.validation)
    low, high = sorted((sheet.fitted, sheet.validation))
    assert low < solid.fitted < high


def test_coordinates_of_zero_are_the_start_and_others_scale_it():
    start = known_model()
    springs = len(start.stiffness)
    same = model_at(start, np.zeros(springs + len(CONTACT_NAMES)))
    assert np.array_equal(same.stiffness, start.stiffness)
    assert same.parameters.friction == pytest.approx(start.parameters.friction)
    assert same.parameters.restitution == pytest.approx(start.parameters.restitution)
    far = model_at(start, np.full(springs + len(CONTACT_NAMES), np.log(2.0)))
    assert far.stiffness == pytest.approx(2 * start.stiffness, rel=1e-5)
    assert far.parameters.controller_stiffness == pytest.approx(2 * start.parameters.controller_stiffness)
    assert start.parameters.restitution < far.parameters.restitution < 1


def test_build_refines_after_the_search_and_says_so():
    stages = []
    options = FitOptions(generations=2, population=8, frame_stride=4, dense_steps=2)
    twin = build(
        [make_episode(known_model())],
        options,
        seed=0,
        progress=lambda stage, share, loss: stages.append((stage, share)),
    )
    names = [stage for stage, _ in stages]
    assert names == ["prepare", "search", "search", "refine", "refine", "evaluate", "done"]
    assert [share for _, share in stages] == sorted(share for _, share in stages)
    assert twin.provenance.settings["dense_steps"] == 2


def test_adam_goes_by_its_rate_at_first_and_finds_a_minimum():
    adam = Adam(rate=0.1, size=3)
    assert adam.step(np.array([5.0, -1e-4, 0.0])) == pytest.approx([0.1, -0.1, 0.0])
    adam, place = Adam(rate=0.05, size=2), np.array([1.0, -2.0])
    for _ in range(400):
        place = place - adam.step(2 * (place - [0.3, 0.4]))
    assert place == pytest.approx([0.3, 0.4], abs=0.02)
