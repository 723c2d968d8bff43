"""The coarse fit: CMA-ES over graph and global parameters, a whole population in one batch (paper, App. B.2)."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from egophys_core.cores import usable_cores
from egophys_core.errors import EpisodeError, TwinError
from egophys_core.identification.loss import TAIL_SHARE, rollout_loss
from egophys_core.identification.options import FitOptions
from egophys_core.identification.search_state import (
    START_ANEW,
    SearchState,
    load_search,
    save_search,
    search_identity,
)
from egophys_core.kinds import kind_named
from egophys_core.kinds.kind import RestShape, Searched
from egophys_core.kinds.rest_shape import surface_model
from egophys_core.observation.problem import FitProblem
from egophys_core.simulation import batch_of_models, filled_up, rollout
from egophys_core.twin import Codebook, ObjectModel

if TYPE_CHECKING:
    import cma

AT_BOUND = 0.01
"""Share of what is searched within which a number is at its end."""

WORST_LOSS = 1.0
"""Metres. What a candidate that diverges costs; CMA-ES needs finite numbers."""


@dataclass(frozen=True)
class Candidates:
    """The models that are searched among."""

    shape: RestShape
    codebook: Codebook | None = None
    """That each of them has."""

    def at(self, coordinates: np.ndarray, *, ground_height: float) -> ObjectModel:
        """The model at normalised coordinates [D]."""
        kind = surface_model(kind_named(self.shape.kind))
        return replace(kind.candidate(self.shape, coordinates, ground_height=ground_height), codebook=self.codebook)


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
    at_bounds: tuple[str, ...]
    """Which numbers ended at the end of what is searched, as sentences."""


def fit_coarse(
    problems: Sequence[FitProblem],
    shape: RestShape,
    options: FitOptions,
    *,
    seed: int,
    progress: Progress,
    checkpoint: Path | None = None,
    codebook: Codebook | None = None,
) -> CoarseFit:
    """Search graph and global parameters that make rollouts match the train frames of all episodes.

    Args:
        checkpoint: file that keeps the search after every generation. If it is there, the search goes on from
            it and ends, bit for bit, as one that was never stopped.
        codebook: that every candidate has, anchored at its own stiffness.

    Raises:
        EpisodeError: an episode has no contact in its train frames, or its object is not seen in them.
        TwinError: every candidate diverged, or the checkpoint cannot be gone on from.
        OutputError: the checkpoint cannot be written.
    """
    for problem in problems:
        problem.require_train_frames()
        _require_sight(problem, options.frame_stride)
    models = Candidates(shape, codebook)
    state = SearchState(identity=search_identity(problems, shape, options, seed=seed, codebook=codebook))
    if checkpoint is not None:
        state = load_search(checkpoint, state.identity)
        _require_same_loss(problems, models, options.frame_stride, state, checkpoint)
    strategy = _strategy(shape, options, seed)
    best_loss, best_coordinates = np.inf, None
    history = []
    for generation in range(options.generations):
        population = [np.asarray(coordinates) for coordinates in strategy.ask()]
        if generation < state.generations:
            if not np.array_equal(population, state.populations[generation]):
                raise _not_repeated(checkpoint, f"CMA-ES asks for other candidates in generation {generation}")
            losses = state.losses[generation]
        else:
            losses = evaluate_candidates(problems, models, population, options.frame_stride)
            state = state.followed_by(np.stack(population), losses)
            if checkpoint is not None:
                save_search(state, checkpoint)
        strategy.tell(population, np.minimum(losses, WORST_LOSS).tolist())
        winner = int(np.argmin(losses))
        if losses[winner] < best_loss:
            best_loss, best_coordinates = float(losses[winner]), population[winner].copy()
        history.append(best_loss)
        progress((generation + 1) / options.generations, best_loss)
    if best_coordinates is None:
        raise TwinError("every candidate of the coarse fit diverged; check the controller motion for jumps")
    return CoarseFit(
        model=models.at(best_coordinates, ground_height=problems[0].episode.ground_height),
        loss=best_loss,
        history=tuple(history),
        at_bounds=at_bounds(surface_model(kind_named(shape.kind)).numbers(shape), best_coordinates),
    )


def at_bounds(numbers: Sequence[Searched], coordinates: np.ndarray) -> tuple[str, ...]:
    """Which numbers, at normalised coordinates [D], ended at the end of what is searched, as sentences.

    Of shares and distances the ends are what nature allows; of what is searched by its magnitude they are guesses.
    """
    return tuple(
        f"{each.name} ended at {each.value(u):.3g}, the {'most' if u > 0.5 else 'least'} that is searched: the "
        "data ask for more of that, or lack what tells it"
        for each, u in zip(numbers, coordinates.tolist(), strict=True)
        if each.logarithmic and min(u, 1.0 - u) < AT_BOUND
    )


def _strategy(shape: RestShape, options: FitOptions, seed: int) -> "cma.CMAEvolutionStrategy":
    """CMA-ES at its start, with a random generator of its own."""
    # It brings pyplot: a second of imports, which nodes that only load a twin would wait for.
    import cma

    generator = np.random.default_rng(seed)
    start = [number.start_u for number in surface_model(kind_named(shape.kind)).numbers(shape)]
    # The usual 4 + 3 ln D (Hansen, "The CMA evolution strategy: a tutorial", 2016), and those that cost nothing more.
    usual = filled_up(4 + int(3 * np.log(len(start))))
    settings = {
        "bounds": [0.0, 1.0],
        # cma seeds NumPy's global generator unless it is given a generator of its own and no seed.
        "seed": np.nan,
        "randn": lambda *size: generator.standard_normal(size),
        "verbose": -9,
        "popsize": options.population or usual,
    }
    return cma.CMAEvolutionStrategy(start, options.step_size, settings)


def _require_sight(problem: FitProblem, stride: int) -> None:
    """Check that some track of frame 0 is seen in the last fitted frames, which count twice in the loss."""
    frames = problem.loss_frames(stride)
    frames = frames[int((1.0 - TAIL_SHARE) * len(frames)) :]
    if not problem.episode.visible[frames][:, problem.bound >= 0].any():
        raise EpisodeError(
            f"{problem.episode.name}: of the object points seen in frame 0 none is seen in frames {frames[0]} .. "
            f"{frames[-1]}, the last that are fitted; crop the episode to where the object is tracked"
        )


def _require_same_loss(
    problems: Sequence[FitProblem], models: Candidates, stride: int, state: SearchState, checkpoint: Path
) -> None:
    """Check that the stored losses are those that this code and machine compute, on the best candidate."""
    best = state.best()
    if best is None:
        return
    coordinates, stored = best
    loss = float(evaluate_candidates(problems, models, [coordinates], stride)[0])
    if loss != stored:
        raise _not_repeated(checkpoint, f"its best candidate has a loss of {loss!r} m, stored are {stored!r} m")


def _not_repeated(checkpoint: Path | None, what: str) -> TwinError:
    return TwinError(
        f"search state {checkpoint} cannot be gone on from: {what}; was it made by other code or on another "
        f"machine? If not, it is damaged: {START_ANEW}"
    )


def evaluate_candidates(
    problems: Sequence[FitProblem], candidates: Candidates, population: Sequence[np.ndarray], stride: int
) -> np.ndarray:
    """[K] metres: the loss of candidates at normalised coordinates, averaged over episodes."""
    losses = np.zeros(len(population))
    with ThreadPoolExecutor(usable_cores()) as pool:
        for problem in problems:
            ground = problem.episode.ground_height
            models = [candidates.at(coordinates, ground_height=ground) for coordinates in population]
            controls, starts = [problem.train_controls()] * len(models), [problem.start] * len(models)
            result = rollout(batch_of_models(models, controls, starts=starts, ground_height=ground))
            frames = problem.loss_frames(stride)
            predicted = result.positions[:, frames - problem.first_frame]
            observed = problem.episode.points[frames]
            losses += list(pool.map(partial(_loss, candidates.shape.surface, problem, observed), predicted))
    return losses / len(problems)


def _loss(surface: np.ndarray, problem: FitProblem, observed: np.ndarray, predicted: np.ndarray) -> float:
    return rollout_loss(predicted, surface, problem.bound, observed)
