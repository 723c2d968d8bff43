"""Training the prior that ships with the project, and its ablations, on the training sequences."""

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
import torch

from benchmarks.prior.anchors import OPTIONS, AnchoredItem, read_anchored, stiffness_taught
from benchmarks.prior.items import Item, all_items
from benchmarks.prior.measure import checkpoint
from benchmarks.prior.sequences import Split
from egophys_core.errors import SimulationError
from egophys_core.files import write_json
from egophys_core.identification.building import predict
from egophys_core.identification.loss import errors_and_gradient
from egophys_core.prior import save_codebook, with_prior
from egophys_core.prior.network import FeatureRange, Form, StiffnessNetwork, dynamic_features
from egophys_core.prior.training import Lesson, Training, train
from egophys_core.simulation import batch_of_models, spring_order
from egophys_core.simulation.codebook_arrays import held_nodes
from egophys_core.simulation.engine import Engine
from egophys_core.twin import Codebook, static_features
from egophys_core.twin.spring_features import FEATURES, STATIC

VALIDATION_OBJECTS = (8, 13, 20, 24, 31)
"""Of the list of training objects: those that choose the pass which is kept, and teach nothing."""

SEED = 0
RATE = 1e-2
"""Of Adam: ten times the paper's, whose objects are seen a hundred times or more each, these ten to twenty times."""

SAMPLED_FRAMES = 12
"""Of each rollout, whose features say how they are spread."""


@dataclass(frozen=True, kw_only=True)
class Model:
    """A prior of the comparison."""

    name: str
    form: Form
    prototypes: int


MODELS = (
    Model(name="codebook K=4", form=Form.CODEBOOK, prototypes=4),
    Model(name="direct MLP", form=Form.DIRECT, prototypes=0),
    Model(name="static codebook", form=Form.STATIC, prototypes=4),
    Model(name="codebook K=8", form=Form.CODEBOOK, prototypes=8),
    Model(name="codebook K=16", form=Form.CODEBOOK, prototypes=16),
)


def split_of_training(data: Path) -> tuple[list[Item], list[Item]]:
    """Training items to learn from, and those of other objects that choose the pass which is kept."""
    training = [each for each in all_items(data) if each.split is Split.TRAINING]
    seeds = sorted({each.object_seed for each in training})
    validating = {seeds[index] for index in VALIDATION_OBJECTS}
    learned = [each for each in training if each.object_seed not in validating]
    return learned, [each for each in training if each.object_seed in validating]


def train_model(
    model: Model, data: Path, anchors: Path, folder: Path, *, passes: int, iterations: int
) -> Iterator[dict[str, object]]:
    """Train a model, pass after pass, and keep the one that does best on the validation objects.

    Yields:
        What each pass came to: losses in metres, and the ratio of validation errors to those of coarse fits.
    """
    folder.mkdir(parents=True, exist_ok=True)
    learned, validating = split_of_training(data)
    names = {each.name: each for each in learned}
    spread = feature_range([read_anchored(each, anchors) for each in learned])
    network = StiffnessNetwork(model.form, model.prototypes, spread, seed=SEED)
    training = Training(network=network, rate=RATE)
    read = cache(partial(_lesson, names=names, anchors=anchors))
    judged = [read_anchored(each, anchors) for each in validating]
    before = [held_out_error(each, None) for each in judged]
    losses: list[float] = []
    began = time.perf_counter()
    state = checkpoint(folder, model.name).with_suffix(".state")
    # A training that goes on has its best pass already.
    kept = folder.glob(f"{state.stem}.pass*.json") if state.exists() else ()
    best = min((json.loads(each.read_text())["validation_ratio"] for each in kept), default=np.inf)
    for turn, name, loss in train(training, list(names), read, passes=passes, iterations=iterations, state=state):
        losses.append(loss)
        if name != learned[-1].name:
            continue
        codebook = network.codebook()
        after = [held_out_error(each, codebook) for each in judged]
        # Of logarithms: a rollout or two that topple the other way would decide the mean.
        ratio = float(np.exp(np.mean(np.log(np.array(after) / before))))
        if ratio < best:
            best = ratio
            notes = {"model": model.name, "pass": str(turn + 1), "sequences": str(len(learned)), "seed": str(SEED)}
            save_codebook(codebook, checkpoint(folder, model.name), notes=notes)
        finite = [each for each in losses if np.isfinite(each)]
        row = {
            "model": model.name,
            "pass": turn + 1,
            "loss_m": float(np.mean(finite)),
            "diverged": len(losses) - len(finite),
            "validation_ratio": ratio,
            "prototypes": np.round(codebook.prototypes, 3).tolist(),
            "seconds": time.perf_counter() - began,
        }
        losses = []
        write_json(checkpoint(folder, model.name).with_suffix(f".pass{turn + 1}.json"), row)
        yield row


def held_out_error(anchored: AnchoredItem, codebook: Codebook | None) -> float:
    """Chamfer distance plus track error after the train frames, metres, with a prior or without; infinite where it
    diverges."""
    model = anchored.model if codebook is None else with_prior(anchored.model, codebook)[0]
    problem, episode = anchored.problem, anchored.episode
    frames = np.arange(episode.train_frames, len(episode.times))
    try:
        positions = predict(model, problem)[problem.first_frame :]
    except SimulationError:
        return np.inf
    errors, _ = errors_and_gradient(positions, model.graph.surface, problem, frames, fitted=len(frames))
    return float(np.nanmean(errors))


def feature_range(anchors: list[AnchoredItem]) -> FeatureRange:
    """How the features of coarse rollouts are spread, over all springs and some frames of each."""
    sampled = np.concatenate([_features(each) for each in anchors])
    low, high = np.percentile(sampled, [0.5, 99.5], axis=0)
    # Whether something is held or bends has its limits by itself, however rare.
    flags = np.isin(sampled, (0.0, 1.0)).all(axis=0)
    low, high = np.where(flags, 0.0, low), np.where(flags, 1.0, high)
    limited = np.clip(sampled, low, high)
    scale = np.maximum(limited.std(axis=0), 1e-6 + 1e-3 * np.abs(limited).max(axis=0))
    values = {"low": low, "high": high, "centre": limited.mean(axis=0), "scale": scale}
    return FeatureRange(**{name: each.astype(np.float32) for name, each in values.items()})


def _features(anchored: AnchoredItem) -> np.ndarray:
    """[M, F] features of an object's springs in some frames of its coarse rollout."""
    problem, model = anchored.problem, anchored.model
    graph, ground = model.graph, anchored.episode.ground_height
    controls = problem.train_controls()
    batch = batch_of_models([model], [controls], starts=[problem.start], ground_height=ground)
    engine, states = Engine(batch, "cpu"), []
    for frame in range(len(controls.times) - 1):
        engine.advance_frame(frame)
        held = held_nodes(engine.segments[-1].attachments, engine.nodes)
        states.append((engine.node_positions().copy(), engine.node_velocities().copy(), held))
    chosen = [states[index] for index in np.linspace(0, len(states) - 1, SAMPLED_FRAMES).astype(int)]
    positions, velocities, hands = (torch.tensor(np.concatenate(each)) for each in zip(*chosen, strict=True))
    dynamic, _ = dynamic_features(
        positions,
        velocities,
        hands,
        springs=torch.tensor(graph.springs.astype(np.int64)),
        rest_lengths=torch.tensor(graph.rest_lengths),
        contact_height=ground + model.parameters.contact_radius,
    )
    static = np.broadcast_to(static_features(graph), (len(chosen), len(graph.springs), len(STATIC)))
    return np.concatenate([static, dynamic.numpy()], axis=2).reshape(-1, len(FEATURES))


def _lesson(name: str, names: dict[str, Item], anchors: Path) -> Lesson:
    item = names[name]
    anchored = read_anchored(item, anchors)
    model, problem = anchored.model, anchored.problem
    order, frames = spring_order(model), problem.loss_frames(OPTIONS.frame_stride)
    ground = anchored.episode.ground_height
    batch = batch_of_models([model], [problem.train_controls()], starts=[problem.start], ground_height=ground)
    features = np.zeros((len(order), len(STATIC)), np.float32)
    features[order] = static_features(model.graph)
    target = np.zeros(len(order))
    target[order] = stiffness_taught(anchors, item)

    def loss(positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        errors, seeds = errors_and_gradient(positions[0], model.graph.surface, problem, frames, fitted=len(frames))
        return np.array([np.nanmean(errors)]), seeds[None]

    return Lesson(name=name, batch=batch, features=features, loss=loss, target=target)
