"""Training the prior over objects: rollouts that match the record, and dense stiffness that is known (paper, App. B.3).

Gradients of rollouts come from the simulator's tape as derivatives by the stiffness of each spring in each frame; torch
takes them through the network to its weights, and to the state that its features are of.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save

from egophys_core.errors import OutputError, TwinError
from egophys_core.files import write_atomically
from egophys_core.prior.network import Assigned, StiffnessNetwork, dynamic_features
from egophys_core.simulation import BatchCodebook, RolloutBatch
from egophys_core.simulation.batch import LONGEST_HELD
from egophys_core.simulation.codebook_arrays import asked_frames
from egophys_core.simulation.gradients import Loss, differentiate

WINDOWS = 24
"""Windows of truncated back-propagation, of 0.2 s in a record of 7 s; a multiple of the lanes, so that they cost no
more. Over longer ones sheets are chaotic: gradients of different ones then have nothing in common
(docs/notes/prior.md)."""

LONGEST_GRADIENT = 0.01
"""Where a rollout is chaotic, its gradient is a thousand times as long as others (0.002 to 0.01 m), and means nothing:
unlimited, a few of them would decide how far Adam goes at all."""


@dataclass(frozen=True, kw_only=True)
class Weights:
    """Of the terms of the objective beside the rollout loss in metres (paper, App. B.3, but the first)."""

    distillation: float = 1e-3
    offset: float = 1e-2
    usage: float = 1e-3
    entropy: float = 1e-4
    residual: float = 1e-3


@dataclass(frozen=True, kw_only=True)
class Lesson:
    """One training sequence."""

    name: str
    batch: RolloutBatch
    """One rollout, of the object with the stiffness of its coarse fit."""
    features: np.ndarray
    """[E, S] float32, static features in the order of the batch's springs."""
    loss: Loss
    target: np.ndarray
    """[E] logarithm of the stiffness that dense refinement found over that of the coarse fit, in the same order."""


@dataclass(kw_only=True)
class Residual:
    """What one object's springs have beside what the network says; it helps in training and is then left out."""

    values: torch.nn.Parameter
    """[E] added to the logarithm of stiffness."""
    optimiser: torch.optim.Adam


@dataclass(kw_only=True)
class Training:
    """A network on its way, step by step."""

    network: StiffnessNetwork
    rate: float = 1e-3
    weights: Weights = field(default_factory=Weights)
    steps: int = 0
    """Done so far, over all lessons."""

    def __post_init__(self) -> None:
        self.optimiser = torch.optim.Adam(self.network.parameters(), lr=self.rate)
        self.residuals: dict[str, Residual] = {}

    def step(self, lesson: Lesson) -> float:
        """Roll out a lesson's object and go a step down the gradient; its rollout loss, metres.

        Nothing is learned from a rollout that diverges: its loss is infinite.
        """
        residual = self._residual(lesson)
        anchors = lesson.batch.stiffness * np.exp(residual.values.detach().numpy())
        used = BatchCodebook(codebook=self.network.codebook(), features=lesson.features[None], used=np.array([True]))
        self.optimiser.zero_grad()
        through = ThroughNetwork(self.network, lesson, anchors[0], self.weights)
        result, losses, gradient = differentiate(
            replace(lesson.batch, stiffness=anchors.astype(np.float32), codebook=used),
            lesson.loss,
            windows=WINDOWS,
            through_codebook=through,
        )
        self.steps += 1
        if result.failures[0] is not None or not np.isfinite(losses[0]):
            return float("inf")
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), LONGEST_GRADIENT)
        self.optimiser.step()
        by_values = gradient.stiffness[0] * anchors[0]
        by_values += 2.0 * self.weights.residual * residual.values.detach().numpy() / len(by_values)
        residual.values.grad = torch.tensor(by_values, dtype=torch.float32)
        residual.optimiser.step()
        return float(losses[0])

    def _residual(self, lesson: Lesson) -> Residual:
        if lesson.name not in self.residuals:
            values = torch.nn.Parameter(torch.zeros(lesson.batch.stiffness.shape[1]))
            self.residuals[lesson.name] = Residual(values=values, optimiser=torch.optim.Adam([values], lr=self.rate))
        return self.residuals[lesson.name]


class ThroughNetwork:
    """Takes derivatives by stiffness, frame by frame, to a network's weights and to the state (`ThroughCodebook`)."""

    def __init__(self, network: StiffnessNetwork, lesson: Lesson, anchors: np.ndarray, weights: Weights) -> None:
        batch = lesson.batch
        self.network, self.weights = network, weights
        self.static = torch.tensor(lesson.features)
        self.springs = torch.tensor(batch.springs.astype(np.int64))
        self.rest_lengths = torch.tensor(batch.rest_lengths[0].astype(np.float32))
        self.contact_height = batch.ground_height + batch.parameters[0].contact_radius
        self.anchors = torch.tensor(anchors.astype(np.float32))
        self.target = torch.tensor(lesson.target.astype(np.float32))
        self.questions = len(np.unique(asked_frames(batch.controls[0].times, LONGEST_HELD)))

    def __call__(
        self, positions: np.ndarray, velocities: np.ndarray, held: np.ndarray, by_stiffness: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Add to the gradients of the network; derivatives [R, N, 3] by positions and velocities."""
        places, speeds = (
            torch.tensor(each, dtype=torch.float32, requires_grad=True) for each in (positions, velocities)
        )
        dynamic, stretched = dynamic_features(
            places,
            speeds,
            torch.tensor(held),
            springs=self.springs,
            rest_lengths=self.rest_lengths,
            contact_height=self.contact_height,
        )
        assigned = self.network(self.static, dynamic, stretched)
        stiffness = self.anchors * assigned.offset.exp()
        pulled = (torch.tensor(by_stiffness, dtype=torch.float32) * stiffness).sum()
        share = len(positions) / self.questions
        (pulled + share * regulariser(assigned, self.target, self.weights)).backward()
        # What is the same in every state has no derivatives by it.
        by_state = (torch.zeros_like(each) if each.grad is None else each.grad for each in (places, speeds))
        by_places, by_speeds = (each.numpy().astype(np.float64) for each in by_state)
        return by_places, by_speeds


def regulariser(assigned: Assigned, target: torch.Tensor, weights: Weights) -> torch.Tensor:
    """Distance from dense stiffness, size of offsets, how unevenly prototypes are used, and how undecidedly."""
    offset, shares = assigned.offset, assigned.shares
    total = weights.distillation * ((target - offset) ** 2).mean() + weights.offset * (offset**2).mean()
    if shares is None:
        return total
    used = shares.mean(dim=(0, 1))
    unevenness = (used * (used * len(used)).clamp_min(1e-9).log()).sum()
    indecision = -(shares * shares.clamp_min(1e-9).log()).sum(dim=2).mean()
    return total + weights.usage * unevenness + weights.entropy * indecision


def train(
    training: Training,
    lessons: Sequence[str],
    read: Callable[[str], Lesson],
    *,
    passes: int,
    iterations: int,
    state: Path,
) -> Iterator[tuple[int, str, float]]:
    """Go over all lessons in order, again and again, with some iterations each; save after each lesson.

    If the file `state` is there, training goes on from it and ends as one that was never stopped.

    Args:
        read: a lesson by its name; asked for anew in each pass.

    Yields:
        Pass, lesson and its mean loss in metres, as each is done.

    Raises:
        TwinError: the state is damaged or of another training.
        OutputError: it cannot be written.
    """
    plan = {"lessons": json.dumps(list(lessons)), "iterations": str(iterations)}
    done = load_state(training, state, plan) if state.exists() else 0
    for turn in range(passes):
        for number, name in enumerate(lessons):
            if turn * len(lessons) + number < done:
                continue
            lesson = read(name)
            losses = [training.step(lesson) for _ in range(iterations)]
            save_state(training, state, turn * len(lessons) + number + 1, plan)
            yield turn, name, float(np.mean(losses))


def save_state(training: Training, path: Path, done: int, plan: dict[str, str]) -> None:
    """Write all that training goes on from, atomically, and what its lessons are; no pickle."""
    tensors = {f"network.{name}": each for name, each in training.network.state_dict().items()}
    tensors |= _of_optimiser("adam", training.optimiser)
    for name, residual in training.residuals.items():
        tensors[f"residual.{name}"] = residual.values.detach()
        tensors |= _of_optimiser(f"adam of residual.{name}", residual.optimiser)
    tensors["done"] = torch.tensor([done, training.steps])
    try:
        write_atomically(path, save({name: each.contiguous() for name, each in tensors.items()}, metadata=plan))
    except OSError as error:
        raise OutputError(f"cannot write training state {path}: {error.strerror}") from error


def load_state(training: Training, path: Path, plan: dict[str, str]) -> int:
    """Take up a training where it was; how many lessons it has done.

    Raises:
        TwinError: the state is damaged, of another network, or of other lessons.
    """
    try:
        with safe_open(path, "pt") as file:
            planned = file.metadata()
        tensors = load_file(path)
        network = {key.removeprefix("network."): tensors[key] for key in tensors if key.startswith("network.")}
        training.network.load_state_dict(network)
        _into_optimiser(training.optimiser, "adam", tensors)
        for key in [key for key in tensors if key.startswith("residual.")]:
            values = torch.nn.Parameter(tensors[key].clone())
            residual = Residual(values=values, optimiser=torch.optim.Adam([values], lr=training.rate))
            _into_optimiser(residual.optimiser, f"adam of {key}", tensors)
            training.residuals[key.removeprefix("residual.")] = residual
        done, training.steps = (int(each) for each in tensors["done"])
    except (SafetensorError, OSError, KeyError, RuntimeError, ValueError) as error:
        raise TwinError(f"training state {path} is damaged or of another network ({error}); remove it") from error
    if planned != plan:
        raise TwinError(f"training state {path} is of other lessons, or of more or fewer steps in each; remove it")
    return done


def _of_optimiser(name: str, optimiser: torch.optim.Adam) -> dict[str, torch.Tensor]:
    """What Adam remembers, as tensors by name."""
    state = optimiser.state_dict()["state"]
    return {f"{name}.{index}.{key}": each.reshape(-1) for index, kept in state.items() for key, each in kept.items()}


def _into_optimiser(optimiser: torch.optim.Adam, name: str, tensors: dict[str, torch.Tensor]) -> None:
    """The reverse of `_of_optimiser`; of what never had a gradient Adam remembers nothing."""
    whole = optimiser.state_dict()
    parameters = [each for group in optimiser.param_groups for each in group["params"]]
    whole["state"] = {
        index: {
            key: tensors[f"{name}.{index}.{key}"].reshape(shape)
            for key, shape in (("step", ()), ("exp_avg", each.shape), ("exp_avg_sq", each.shape))
        }
        for index, each in enumerate(parameters)
        if f"{name}.{index}.step" in tensors
    }
    optimiser.load_state_dict(whole)
