"""Training the codebook: its gradients against differences of rollouts, what is learned, and going on after a stop."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.errors import TwinError
from egophys_core.simulation import BatchCodebook, Controls, batch_of_models, rollout, spring_order
from egophys_core.simulation.gradients import differentiate
from egophys_core.twin import static_features
from tests.reference.codebook import dynamic_of, factors
from tests.simulation.scenes import frame_times, sheet_model, sheet_positions
from tests.twin.codebooks import random_codebook

torch = pytest.importorskip("torch", reason="training the prior needs torch: pip install -e '.[prior]'")

from egophys_core.prior.network import Assigned, FeatureRange, Form, StiffnessNetwork, dynamic_features  # noqa: E402
from egophys_core.prior.training import Lesson, ThroughNetwork, Training, Weights, regulariser, train  # noqa: E402

TIMES = frame_times(0.3, 0.03)
NOTHING_ELSE = Weights(distillation=0.0, offset=0.0, usage=0.0, entropy=0.0, residual=0.0)


def spread() -> FeatureRange:
    codebook = random_codebook()
    return FeatureRange(**{name: getattr(codebook, name) for name in ("low", "high", "centre", "scale")})


def hung_sheet():
    """A soft sheet that is lifted by a corner and sags, free of the table."""
    model = sheet_model(sheet_positions(4), stiffness=8.0, controller_stiffness=8.0, friction=0.0)
    corner = model.graph.positions[-1].astype(np.float64)
    path = (corner + TIMES[:, None] * np.array([0.1, 0.0, 0.5]))[:, None]
    controls = Controls(times=TIMES, positions=path.astype(np.float32), contact=np.ones((len(TIMES), 1), bool))
    return model, batch_of_models([model], [controls], ground_height=-10.0)


def lesson(name: str, loss, target: float = 0.0) -> Lesson:
    model, batch = hung_sheet()
    features = np.zeros((len(batch.springs), 12), np.float32)
    features[spring_order(model)] = static_features(model.graph)
    return Lesson(name=name, batch=batch, features=features, loss=loss, target=np.full(len(features), target))


def random_linear(seed: int):
    weights = np.random.default_rng(seed).normal(0.0, 1.0, (len(TIMES), 16, 3))

    def loss(positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.einsum("kfnd,fnd->k", positions.astype(np.float64), weights), weights[None].copy()

    return loss


def with_network(network: StiffnessNetwork, chosen: Lesson):
    used = BatchCodebook(codebook=network.codebook(), features=chosen.features[None], used=np.array([True]))
    return replace(chosen.batch, codebook=used)


@pytest.mark.parametrize("form", list(Form))
def test_gradients_by_the_weights_agree_with_differences_of_rollouts(form):
    chosen = lesson("hung", random_linear(0))
    network = StiffnessNetwork(form, 4, spread(), seed=1)
    through = ThroughNetwork(network, chosen, chosen.batch.stiffness[0], NOTHING_ELSE)
    result, _, _ = differentiate(with_network(network, chosen), chosen.loss, through_codebook=through)
    result.raise_on_failure()
    random = torch.Generator().manual_seed(2)
    for name, weights in network.named_parameters():
        if not weights.numel():
            continue
        direction = torch.randn(weights.shape, generator=random)
        step = 0.01 / float(direction.norm())
        values, before = [], weights.data.clone()
        for sign in (1.0, -1.0):
            weights.data = before + sign * step * direction
            positions = rollout(with_network(network, chosen)).positions
            values.append(float(chosen.loss(positions)[0][0]))
        weights.data = before
        slope = float((weights.grad * direction).sum())
        assert (values[0] - values[1]) / (2.0 * step) == pytest.approx(slope, rel=0.02, abs=1e-3), name


def test_torch_and_the_reference_agree_on_features_and_stiffness():
    model, _ = hung_sheet()
    random = np.random.default_rng(0)
    positions = model.graph.positions + random.normal(0.0, 0.01, (16, 3))
    velocities, held = random.normal(0.0, 0.3, (16, 3)), (np.arange(16) == 3).astype(float)
    springs, rest = model.graph.springs, model.graph.rest_lengths
    expected = dynamic_of(positions, velocities, held, springs, rest, 0.1)
    found, stretched = dynamic_features(
        *(torch.tensor(each[None]) for each in (positions, velocities, held)),
        springs=torch.tensor(springs.astype(np.int64)),
        rest_lengths=torch.tensor(rest),
        contact_height=0.1,
    )
    assert found[0].numpy() == pytest.approx(expected, rel=1e-5, abs=1e-6)
    for form in Form:
        network = StiffnessNetwork(form, 5, spread(), seed=0)
        static = static_features(model.graph)
        offset = network(torch.tensor(static), found.float(), stretched).offset[0].detach().numpy()
        assert np.exp(offset) == pytest.approx(factors(network.codebook(), static, expected), rel=1e-4)


def test_a_stiffness_that_depends_on_tension_is_learned():
    # The true object has a codebook of other weights.
    model, batch = hung_sheet()
    truth = random_codebook(4, seed=3, size=0.5)
    true = rollout(batch_of_models([replace(model, codebook=truth)], list(batch.controls), ground_height=-10.0))

    def loss(positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        off = positions.astype(np.float64) - true.positions
        return 1e3 * (off**2).mean(axis=(1, 2, 3)), 2e3 * off / off[0].size

    training = Training(network=StiffnessNetwork(Form.CODEBOOK, 4, spread(), seed=0), rate=3e-2, weights=NOTHING_ELSE)
    losses = [training.step(lesson("hung", loss)) for _ in range(12)]
    assert min(losses) < 0.5 * losses[0]


def test_targets_alone_are_learned():
    network = StiffnessNetwork(Form.CODEBOOK, 4, spread(), seed=0)
    flat = lesson("hung", lambda positions: (np.zeros(1), np.full_like(positions, 1e-12)), target=0.3)
    only = replace(NOTHING_ELSE, distillation=1.0)
    training = Training(network=network, rate=1e-2, weights=only)
    for _ in range(30):
        training.step(flat)
    _, batch = hung_sheet()
    dynamic = dynamic_of(
        batch.positions[0], 0 * batch.positions[0], np.zeros(16), batch.springs, batch.rest_lengths[0], 0
    )
    assert np.log(factors(network.codebook(), flat.features, dynamic)) == pytest.approx(0.3, abs=0.05)


def test_regularisers_like_small_offsets_even_use_and_decision():
    def of(size: float, shares: list[list[float]], **weights: float) -> float:
        springs = len(shares)
        assigned = Assigned(offset=torch.full((1, springs), size), shares=torch.tensor([shares]))
        return float(regulariser(assigned, torch.zeros(springs), replace(NOTHING_ELSE, **weights)))

    one_each, all_one, halves = [[1.0, 0.0], [0.0, 1.0]], [[1.0, 0.0]] * 2, [[0.5, 0.5]] * 2
    assert of(0.3, one_each, offset=1.0) == pytest.approx(0.09)
    assert of(0.0, one_each, usage=1.0) == pytest.approx(0.0, abs=1e-6)
    assert of(0.0, all_one, usage=1.0) == pytest.approx(np.log(2.0), rel=1e-4)
    assert of(0.0, halves, entropy=1.0) == pytest.approx(np.log(2.0), rel=1e-4)
    assert of(0.0, one_each, entropy=1.0) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("form", [Form.CODEBOOK, Form.DIRECT])
def test_a_stopped_training_ends_as_one_that_was_not(tmp_path, form):
    names = ("a", "b")
    read = {name: lesson(name, random_linear(seed)) for seed, name in enumerate(names)}.__getitem__

    def new() -> Training:
        return Training(network=StiffnessNetwork(form, 4, spread(), seed=0), rate=1e-2)

    whole = new()
    list(train(whole, names, read, passes=2, iterations=1, state=tmp_path / "whole"))
    steps = train(new(), names, read, passes=2, iterations=1, state=tmp_path / "cut")
    for _ in range(3):
        next(steps)
    resumed = new()
    assert [name for _, name, _ in train(resumed, names, read, passes=2, iterations=1, state=tmp_path / "cut")] == ["b"]
    assert resumed.network.codebook().same_as(whole.network.codebook())
    assert resumed.steps == whole.steps == 4


def test_the_state_of_another_network_is_refused(tmp_path):
    chosen = {"a": lesson("a", random_linear(0))}.__getitem__
    first = Training(network=StiffnessNetwork(Form.CODEBOOK, 4, spread(), seed=0))
    list(train(first, ("a",), chosen, passes=1, iterations=1, state=tmp_path / "state"))
    other = Training(network=StiffnessNetwork(Form.CODEBOOK, 8, spread(), seed=0))
    with pytest.raises(TwinError, match="damaged or of another network"):
        list(train(other, ("a",), chosen, passes=1, iterations=1, state=tmp_path / "state"))


def test_the_state_of_other_lessons_is_refused(tmp_path):
    read = {name: lesson(name, random_linear(0)) for name in ("a", "b")}.__getitem__

    def new() -> Training:
        return Training(network=StiffnessNetwork(Form.CODEBOOK, 4, spread(), seed=0))

    list(train(new(), ("a", "b"), read, passes=1, iterations=1, state=tmp_path / "state"))
    with pytest.raises(TwinError, match="of other lessons"):
        list(train(new(), ("b", "a"), read, passes=1, iterations=1, state=tmp_path / "state"))
    with pytest.raises(TwinError, match="more or fewer steps"):
        list(train(new(), ("a", "b"), read, passes=1, iterations=2, state=tmp_path / "state"))
