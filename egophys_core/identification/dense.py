"""Dense refinement: a stiffness per spring and contact parameters, by gradients of whole rollouts.

The second stage of PhysTwin's fit (paper, App. A), from the coarse fit on. Numbers are searched in coordinates
without bounds: logarithms of stiffness and friction over their coarse values, logits of restitution.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.errors import TwinError
from egophys_core.identification.adam import Adam
from egophys_core.identification.loss import TAIL_SHARE, errors_and_gradient
from egophys_core.identification.options import FitOptions
from egophys_core.kinds import kind_of
from egophys_core.observation.problem import FitProblem
from egophys_core.simulation import batch_of_models, spring_order
from egophys_core.simulation.gradients import differentiate
from egophys_core.twin import ObjectModel

FARTHEST = 1.4
"""Largest change of a logarithm: a factor of 4 up or down, so that the number of substeps at most doubles."""

CONTACT_NAMES = ("friction", "restitution", "controller_stiffness")
"""Global parameters that are refined beside the springs."""

WINDOWS = 8
"""Windows of truncated back-propagation; as many as there are lanes, so that they cost no more than one."""

SMALLEST = 1e-3
"""Friction and restitution are moved at least so far off 0, where their coordinates have no slope."""


@dataclass(frozen=True, kw_only=True)
class DenseStep:
    """Losses at one step, before its update, metres: Chamfer distance plus track error, mean over frames."""

    fitted: float
    """On the frames whose gradient is followed: of a sheet without the last quarter, else all."""
    validation: float
    """On the last quarter of the train frames, which choose the best step."""


def fit_dense(
    problems: Sequence[FitProblem],
    model: ObjectModel,
    options: FitOptions,
    *,
    progress: Callable[[float, float], None],
) -> ObjectModel:
    """The best model of `options.dense_steps` steps from a coarse model; the coarse one itself if none is better.

    Args:
        progress: called with the share done (0..1) and the least validation loss so far (metres); may raise to stop.
    """
    refinement = DenseRefinement(problems, model, options)
    for step in range(options.dense_steps):
        refinement.step()
        progress((step + 1) / options.dense_steps, refinement.best_validation)
    return refinement.best


class DenseRefinement:
    """Adam on whole rollouts of one or more episodes; `best` is the model with the least validation loss so far."""

    def __init__(self, problems: Sequence[FitProblem], model: ObjectModel, options: FitOptions) -> None:
        """Start at a coarse model."""
        self.problems, self.start, self.stride = tuple(problems), model, options.frame_stride
        self.coordinates = np.zeros(len(model.stiffness) + len(CONTACT_NAMES))
        self.adam = Adam(rate=options.dense_rate, size=len(self.coordinates))
        self.best, self.best_validation = model, np.inf
        self.history: list[DenseStep] = []

    def step(self) -> DenseStep:
        """Roll out, keep the model if it is the best so far, and go a step down the gradient.

        Raises:
            TwinError: the coarse model itself diverges.
        """
        model = model_at(self.start, self.coordinates)
        gradient = np.zeros_like(self.coordinates)
        steps = []
        for problem in self.problems:
            losses, derivative = self._derivative(problem, model)
            steps.append(losses)
            gradient += derivative / len(self.problems)
        step = DenseStep(
            fitted=float(np.mean([each.fitted for each in steps])),
            validation=float(np.mean([each.validation for each in steps])),
        )
        if not self.history and not np.isfinite(step.validation):
            raise TwinError("dense refinement: the coarse twin diverges; fit it again with softer bounds")
        self.history.append(step)
        if step.validation < self.best_validation:
            self.best, self.best_validation = model, step.validation
        self.coordinates = np.clip(self.coordinates - self.adam.step(gradient), -FARTHEST, FARTHEST)
        return step

    def _derivative(self, problem: FitProblem, model: ObjectModel) -> tuple[DenseStep, np.ndarray]:
        frames = problem.loss_frames(self.stride)
        tail = int((1.0 - TAIL_SHARE) * len(frames))
        # What buckles another way in the frames ahead is lost; what does not needs all frames that there are.
        fitted = tail if kind_of(model).lies_flat else len(frames)
        errors = np.full(len(frames), np.inf)

        def loss(positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            errors[:], seeds = errors_and_gradient(positions[0], model.graph.surface, problem, frames, fitted=fitted)
            return np.array([np.nanmean(errors[:fitted])]), seeds[None]

        ground = problem.episode.ground_height
        batch = batch_of_models([model], [problem.train_controls()], starts=[problem.start], ground_height=ground)
        _, _, gradient = differentiate(batch, loss, windows=WINDOWS)
        # The damping of a spring stays what it was, so only stiffness passes on its derivative.
        by_stiffness = gradient.stiffness[0, spring_order(model)] * model.stiffness
        friction, restitution = model.parameters.friction, model.parameters.restitution
        by_contact = [
            gradient.parameters["friction"][0] * friction,
            gradient.parameters["restitution"][0] * restitution * (1.0 - restitution),
            gradient.controller_stiffness[0] * model.parameters.controller_stiffness,
        ]
        losses = DenseStep(fitted=float(np.nanmean(errors[:fitted])), validation=float(np.nanmean(errors[tail:])))
        return losses, np.concatenate([by_stiffness, by_contact])


def model_at(start: ObjectModel, coordinates: np.ndarray) -> ObjectModel:
    """The model at coordinates [E + 3]: logarithms of stiffness over its start, then those of `CONTACT_NAMES`."""
    springs = len(start.stiffness)
    by_name = dict(zip(CONTACT_NAMES, coordinates[springs:], strict=True))
    alpha = start.parameters
    restitution = min(max(alpha.restitution, SMALLEST), 1.0 - SMALLEST)
    logit = np.log(restitution / (1.0 - restitution)) + by_name["restitution"]
    return replace(
        start,
        stiffness=(start.stiffness * np.exp(coordinates[:springs])).astype(np.float32),
        parameters=replace(
            alpha,
            friction=max(alpha.friction, SMALLEST) * float(np.exp(by_name["friction"])),
            restitution=float(1.0 / (1.0 + np.exp(-logit))),
            controller_stiffness=alpha.controller_stiffness * float(np.exp(by_name["controller_stiffness"])),
        ),
    )
