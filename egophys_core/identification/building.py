"""From observed episodes to a twin: the whole of the identification, whatever the object is and however it is seen."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from egophys_core import __version__
from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError
from egophys_core.evaluation import Scores, baseline_scores, lost_to, score
from egophys_core.identification.fit import Progress
from egophys_core.identification.marker_fit import fit_markers
from egophys_core.identification.options import FitOptions
from egophys_core.identification.surface_fit import fit_surface
from egophys_core.observation import AnyEpisode, FitProblem, ObservedEpisode, observe_episodes, place_twin
from egophys_core.simulation import batch_of_models, rollout
from egophys_core.twin import ObjectModel, Provenance, Twin

EVALUATE_AT = 0.95
"""Share of the progress bar after which the twin is only scored."""

DEFAULTS = FitOptions()


def build(
    episodes: Sequence[AnyEpisode],
    options: FitOptions = DEFAULTS,
    *,
    loads: Mapping[str, float] | None = None,
    seed: int = 0,
    parent_id: str = "",
    progress: Progress = lambda stage, share, loss: None,
    checkpoint: Path | None = None,
) -> Twin:
    """Fit a twin to the train frames of one or more episodes of one object.

    How it is fitted follows from how it is seen: its surface, handled on a table, by search and refinement; a few
    markers on it, held in clamps, by free rollouts of very few numbers. On the CPU the same episodes, options and seed
    give the same twin, bit for bit.

    Args:
        episodes: as recorded, or observed already (`observe_episodes`, which then takes the loads).
        loads: N that hang at the free end of an object that is seen at a few markers, by name of the episode.
        checkpoint: file that keeps the search; a build that was stopped goes on from it (see `fit_coarse`).

    Raises:
        EpisodeError: an episode cannot be fitted (no contact, too few points or frames, another unit).
        OptionsError: options that do not go with what is seen.
        TwinError: no candidate survived, or the checkpoint is of another build.
        OutputError: the checkpoint cannot be written.
    """
    if not episodes:
        raise EpisodeError("no episode given; a twin is built from at least one")
    progress("prepare", 0.0, float("nan"))
    observed = observe_episodes(episodes, loads)
    fit_seen = fit_markers if observed[0].is_sparse else fit_surface
    fit = fit_seen(observed, options, seed=seed, progress=progress, checkpoint=checkpoint)
    progress("evaluate", EVALUATE_AT, fit.loss)
    first = fit.problem.episode
    scores = score(predict(fit.model, fit.problem), fit.model.graph.surface, first)
    twin = Twin(
        model=fit.model,
        grasp=fit.grasp,
        ground_height=first.ground_height,
        provenance=Provenance(
            episodes=tuple({"name": each.name, "sha256": episode_digest(each.source)} for each in observed),
            settings=fit.settings,
            seed=seed,
            code_version=__version__,
            parent_id=parent_id,
            scores=scores.as_dict(),
        ),
    )
    progress("done", 1.0, fit.loss)
    return twin


def predict(model: ObjectModel, problem: FitProblem) -> np.ndarray:
    """[T, N, 3] metres: the model driven by an episode's controllers; until shortly before contact it is at rest.

    Raises:
        SimulationError: the rollout diverged.
    """
    first = problem.first_frame
    result = rollout(
        batch_of_models(
            [model],
            [problem.controls.part(slice(first, None))],
            starts=[problem.start],
            velocities=[problem.velocities],
            ground_height=problem.episode.ground_height,
        )
    )
    result.raise_on_failure()
    return np.concatenate([np.repeat(problem.start[None], first, axis=0), result.positions[0]])


def evaluate_twin(twin: Twin, episode: AnyEpisode) -> tuple[Scores, np.ndarray]:
    """Errors of a twin on an episode of its object, and the predicted nodes [T, N, 3] in metres."""
    problem = place_twin(twin, episode)
    predicted = predict(twin.model, problem)
    return score(predicted, twin.model.graph.surface, problem.episode), predicted


def beside_baselines(twin: Twin, observed: ObservedEpisode) -> tuple[dict[str, Scores], str]:
    """Scores of a twin and of predictions without physics, by name, and what `lost_to` says of them.

    Args:
        observed: the first episode that the twin was fitted to. Of a few markers there are no such predictions.
    """
    fitted = Scores(**twin.provenance.scores)
    baselines = {} if observed.is_sparse else baseline_scores(observed.episode, observed.contact)
    return {"twin": fitted, **baselines}, lost_to(fitted, baselines, observed.episode)


def episode_digest(episode: Episode) -> str:
    """SHA-256 of what a fit sees of an episode: times, points and controllers."""
    digest = hashlib.sha256()
    for array in (episode.times, episode.points, episode.controllers):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
