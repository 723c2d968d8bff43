"""From observed episodes to a twin: the whole of the identification."""

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from egophys_core import __version__
from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError
from egophys_core.evaluation import Scores, score
from egophys_core.identification.coarse import fit_coarse
from egophys_core.identification.dense import fit_dense
from egophys_core.identification.options import FitOptions
from egophys_core.kinds.rest_shape import rest_shape
from egophys_core.observation.at_rest import observed_at_rest
from egophys_core.observation.checks import require_fittable
from egophys_core.observation.contact import find_hands
from egophys_core.observation.placing import place_twin
from egophys_core.observation.problem import FitProblem, prepare
from egophys_core.options import to_mapping
from egophys_core.simulation import ContactKind, batch_of_models, rollout
from egophys_core.twin import ObjectModel, Provenance, Twin

Progress = Callable[[str, float, float], None]
"""Called with stage, share of the whole done (0..1), best loss so far (metres); may raise to stop the build."""

SEARCH_SHARE, DENSE_SHARE = 0.6, 0.35
"""Parts of the progress bar that the search and the dense refinement take; without the latter the search has both."""


def build_twin(
    episodes: Sequence[Episode],
    options: FitOptions,
    *,
    seed: int,
    parent_id: str = "",
    progress: Progress = lambda stage, share, loss: None,
    checkpoint: Path | None = None,
) -> Twin:
    """Fit a twin to the train frames of one or more episodes of one object.

    The nodes come from the first episode; in the others the object is found by registration. On the CPU the
    same episodes, options and seed give the same twin, bit for bit.

    Args:
        checkpoint: file that keeps the search; a build that was stopped goes on from it (see `fit_coarse`).

    Raises:
        EpisodeError: an episode cannot be fitted (no contact, too few points or frames, another unit).
        TwinError: no candidate survived, or the checkpoint is of another build.
        OutputError: the checkpoint cannot be written.
    """
    if not episodes:
        raise EpisodeError("no episode given; a twin is built from at least one")
    for episode in episodes:
        require_fittable(episode)
    progress("prepare", 0.0, float("nan"))
    first = episodes[0]
    shape = rest_shape(
        observed_at_rest(first, find_hands(first))[1],
        name=first.name,
        ground=first.ground_height,
        max_nodes=options.max_nodes,
        kind=options.kind.kind,
    )
    problems = [prepare(episode, shape.positions, shape.surface, spacing=shape.spacing) for episode in episodes]
    search_share = SEARCH_SHARE if options.dense_steps else SEARCH_SHARE + DENSE_SHARE
    coarse = fit_coarse(
        problems,
        shape,
        options,
        seed=seed,
        progress=lambda share, loss: progress("search", search_share * share, loss),
        checkpoint=checkpoint,
    )
    model = fit_dense(
        problems,
        coarse.model,
        options,
        progress=lambda share, loss: progress("refine", SEARCH_SHARE + DENSE_SHARE * share, loss),
    )
    progress("evaluate", SEARCH_SHARE + DENSE_SHARE, coarse.loss)
    scores = score(predict(model, problems[0]), shape.surface, episodes[0])
    twin = Twin(
        model=model,
        grasp=first_grasp(problems[0]),
        ground_height=episodes[0].ground_height,
        provenance=Provenance(
            episodes=tuple({"name": each.name, "sha256": episode_digest(each)} for each in episodes),
            settings=to_mapping(options),
            seed=seed,
            code_version=__version__,
            parent_id=parent_id,
            scores=scores.as_dict(),
        ),
    )
    progress("done", 1.0, coarse.loss)
    return twin


def predict(model: ObjectModel, problem: FitProblem) -> np.ndarray:
    """[T, N, 3] metres: the model driven by an episode's controllers from its first frame.

    Raises:
        SimulationError: the rollout diverged.
    """
    result = rollout(
        batch_of_models(
            [model],
            [problem.controls],
            starts=[problem.start],
            velocities=[problem.velocities],
            ground_height=problem.episode.ground_height,
        )
    )
    result.raise_on_failure()
    return result.positions[0]


def evaluate_twin(twin: Twin, episode: Episode) -> tuple[Scores, np.ndarray]:
    """Errors of a twin on an episode of its object, and the predicted nodes [T, N, 3] in metres."""
    problem = place_twin(twin, episode)
    predicted = predict(twin.model, problem)
    return score(predicted, twin.model.graph.surface, problem.episode), predicted


def first_grasp(problem: FitProblem) -> np.ndarray:
    """[C, 3] float32 metres, world: a hand's points as it first takes hold, or presses if none ever holds."""
    contacts = [(contact, hand) for hand in problem.hands for contact in hand.contacts]
    contact, hand = min(contacts, key=lambda pair: (pair[0].kind != ContactKind.HOLD, pair[0].first))
    return problem.episode.controllers[contact.first, hand.controllers].astype(np.float32)


def episode_digest(episode: Episode) -> str:
    """SHA-256 of what a fit sees of an episode: times, points and controllers."""
    digest = hashlib.sha256()
    for array in (episode.times, episode.points, episode.controllers):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
