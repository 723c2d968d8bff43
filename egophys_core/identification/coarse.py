"""The coarse fit: CMA-ES over graph and global parameters, a whole population in one batch (paper, App. B.2)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cma
import numpy as np

from egophys_core.errors import TwinError
from egophys_core.identification.loss import rollout_loss
from egophys_core.identification.options import FitOptions
from egophys_core.identification.problem import FitProblem
from egophys_core.identification.rest_shape import RestShape
from egophys_core.identification.search_space import candidate, searched_numbers
from egophys_core.simulation import batch_of_models, rollout
from egophys_core.twin import ObjectModel

WORST_LOSS = 1.0
"""Metres. What a candidate that diverges costs; CMA-ES needs finite numbers."""

Progress = Callable[[float, float], None]
"""Called with the share done (0..1) and the best loss so far (metres); may raise to stop."""


@dataclass(frozen=True, kw_only=True)
class CoarseFit:
    """The best candidate found."""

    model: ObjectModel
    loss: float
    """Mean over episodes of the rollout loss, metres."""
    history: tuple[float, ...]
    """Best loss after each generation, metres."""


def fit_coarse(
    problems: Sequence[FitProblem], shape: RestShape, options: FitOptions, *, seed: int, progress: Progress
) -> CoarseFit:
    """Search graph and global parameters that make rollouts match the train frames of all episodes.

    Raises:
        EpisodeError: an episode has no contact in its train frames.
        TwinError: every candidate diverged.
    """
    for problem in problems:
        problem.require_train_frames()
    numbers = searched_numbers(shape.kind)
    generator = np.random.default_rng(seed)
    settings = {
        "bounds": [0.0, 1.0],
        # cma seeds NumPy's global generator unless it is given a generator of its own and no seed.
        "seed": np.nan,
        "randn": lambda *size: generator.standard_normal(size),
        "verbose": -9,
        **({"popsize": options.population} if options.population else {}),
    }
    strategy = cma.CMAEvolutionStrategy([number.start_u for number in numbers], options.step_size, settings)
    best_loss, best_coordinates = np.inf, None
    history = []
    for generation in range(options.generations):
        population = [np.asarray(coordinates) for coordinates in strategy.ask()]
        losses = evaluate_candidates(problems, shape, population, options.frame_stride)
        strategy.tell(population, np.minimum(losses, WORST_LOSS).tolist())
        winner = int(np.argmin(losses))
        if losses[winner] < best_loss:
            best_loss, best_coordinates = float(losses[winner]), population[winner].copy()
        history.append(best_loss)
        progress((generation + 1) / options.generations, best_loss)
    if best_coordinates is None:
        raise TwinError("every candidate of the coarse fit diverged; check the controller motion for jumps")
    return CoarseFit(
        model=candidate(shape, best_coordinates, ground_height=problems[0].episode.ground_height),
        loss=best_loss,
        history=tuple(history),
    )


def evaluate_candidates(
    problems: Sequence[FitProblem], shape: RestShape, population: Sequence[np.ndarray], stride: int
) -> np.ndarray:
    """[K] metres: the loss of candidates at normalised coordinates, averaged over episodes."""
    losses = np.zeros(len(population))
    for problem in problems:
        ground = problem.episode.ground_height
        models = [candidate(shape, coordinates, ground_height=ground) for coordinates in population]
        controls, starts = [problem.train_controls()] * len(models), [problem.start] * len(models)
        result = rollout(batch_of_models(models, controls, starts=starts, ground_height=ground))
        frames = problem.loss_frames(stride)
        for row, positions in enumerate(result.positions):
            losses[row] += rollout_loss(
                positions[frames - problem.first_frame],
                shape.surface,
                problem.bound,
                problem.episode.points[frames],
            )
    return losses / len(problems)
