"""From episodes of an object with a few markers to a twin: one stiffness, one damping, one drag.

Free rollouts tell them: markers are too few and too well measured for anything to be smoothed away. A swing that has
the wrong period looks as wrong as any other, so the sag under gravity tells the stiffness first, with the swing
damped away; then its period does, then all numbers are refined together.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from egophys_core import __version__
from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError, OptionsError, TwinError
from egophys_core.evaluation import score
from egophys_core.identification.build import episode_digest, predict
from egophys_core.identification.marker_unknowns import unknowns_of
from egophys_core.kinds.template import Template
from egophys_core.observation.checks import require_fittable
from egophys_core.observation.markers import MarkerBody, marker_body, place_markers
from egophys_core.observation.problem import FitProblem
from egophys_core.simulation import batch_of_models, rollout
from egophys_core.twin import ObjectKind, ObjectModel, Provenance, Twin

DENSITY = 1000.0
"""kg/m^3, of most that is soft."""

NEAR = np.geomspace(0.75, 1.33, 32)
"""Times the stiffness of the sag, within which that of the swing is looked for."""

REFINEMENTS = 20
"""Steps of the refinement at most."""

DAMPINGS = (0.0, 0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0)
"""Of Levenberg and Marquardt's steps; all are tried, as one lane group."""

NUDGE = 0.1
"""Share of the first steps by which slopes are measured."""

LONGEST_STEP = 3.0
"""First steps that a refinement moves at most at once."""

LEAST_GAIN = 1e-3
"""Share of the error that a step must save, or the refinement ends."""

Progress = Callable[[str, float, float], None]


def build_marker_twin(
    episodes: Sequence[Episode],
    template: Template | None,
    *,
    density: float = DENSITY,
    loads: Mapping[str, float] | None = None,
    progress: Progress = lambda stage, share, loss: None,
) -> Twin:
    """Fit a twin to the train frames of episodes in which an object is seen at a few markers.

    Args:
        template: what the object looks like; by default a bar between held points and markers.
        density: kg/m^3; gives a load in newtons its meaning.
        loads: per name of an episode the weight in N of what hangs at the free end.

    Raises:
        EpisodeError: no held points, or episodes with different markers.
        OptionsError: a load for no episode, or on a rod of no known weight; or a density that is not positive.
        TwinError: all rollouts diverged.
    """
    if not episodes:
        raise EpisodeError("no episode given; a twin is built from at least one")
    if not density > 0:
        raise OptionsError(f"density must be positive, got {density} kg/m^3")
    hung = dict(loads or {})
    require_loads_of(hung, episodes)
    for episode in episodes:
        require_fittable(episode)
    progress("prepare", 0.0, float("nan"))
    body = marker_body(episodes[0], template)
    if body.kind == ObjectKind.ROD and template is None and any(hung.values()):
        raise OptionsError(
            "a load on a cable means nothing without its weight; give its size, as in --template box:0.8x0.01x0.01"
        )
    fit = MarkerSearch(body, episodes, hung, density).run(progress)
    model, problem = fit.model, fit.problems[0]
    scores = score(predict(model, problem), model.graph.surface, problem.episode)
    return Twin(
        model=model,
        grasp=fit.body.grasp,
        ground_height=problem.episode.ground_height,
        provenance=Provenance(
            episodes=tuple({"name": each.name, "sha256": episode_digest(each)} for each in episodes),
            settings={
                "density": density,
                "loads": hung,
                "assumed": list(fit.body.notes),
                "rmse_m": fit.error,
            },
            seed=0,
            code_version=__version__,
            scores=scores.as_dict(),
        ),
    )


def require_loads_of(loads: Mapping[str, float], episodes: Sequence[Episode]) -> None:
    """Check that every load belongs to an episode and has a size.

    Raises:
        OptionsError: it does not.
    """
    names = [episode.name for episode in episodes]
    for name, newtons in loads.items():
        if name not in names:
            raise OptionsError(f"a load is given for {name}, which is not among the episodes {', '.join(names)}")
        if not 0.0 <= newtons < np.inf:
            raise OptionsError(f"the load of {name} must be newtons, not negative, got {newtons}")


@dataclass(frozen=True, kw_only=True)
class MarkerFit:
    """Where a fit of markers stands."""

    model: ObjectModel
    body: MarkerBody
    """As it is placed."""
    problems: tuple[FitProblem, ...]
    """The model in each episode."""
    error: float = np.inf
    """Root mean square distance of the markers in all train frames, metres."""


class MarkerSearch:
    """The object in its episodes, with numbers to be found."""

    def __init__(self, body: MarkerBody, episodes: Sequence[Episode], loads: Mapping[str, float], density: float):
        self.episodes, self.loads = episodes, loads
        known = episodes[0].controllers.shape[1] + episodes[0].points.shape[1]
        self.unknowns = unknowns_of(body, known, density)

    def at(self, numbers: np.ndarray) -> MarkerFit:
        """What numbers [D] make of the object."""
        body, model = self.unknowns.model(numbers)
        problems = tuple(
            place_markers(model, body.grasp, each, load=self.loads.get(each.name, 0.0)) for each in self.episodes
        )
        return MarkerFit(model=model, body=body, problems=problems)

    def best(self, candidates: np.ndarray) -> tuple[np.ndarray, float]:
        """The best of numbers [K, D], and its error in metres.

        Raises:
            TwinError: all rollouts diverged.
        """
        fits = [self.at(numbers) for numbers in candidates]
        errors = marker_errors(fits)
        row = int(np.argmin(errors))
        if not np.isfinite(errors[row]):
            raise TwinError(f"none of {len(fits)} stiffnesses could be simulated; check the template's size")
        return candidates[row], float(errors[row])

    def run(self, progress: Progress = lambda stage, share, error: None) -> MarkerFit:
        """The sag, the swing, then all together.

        Raises:
            TwinError: all rollouts diverged.
        """
        here, error = self.best(self.unknowns.sags)
        progress("sag", 0.2, error)
        here, error = self.best(self.unknowns.about(here, NEAR))
        progress("swing", 0.3, error)
        for round_ in range(REFINEMENTS):
            found, its_error = self.best(self._steps_from(here))
            progress("refine", 0.3 + 0.7 * (round_ + 1) / REFINEMENTS, min(error, its_error))
            if its_error >= (1.0 - LEAST_GAIN) * error:
                break
            here, error = found, its_error
        return replace(self.at(here), error=error)

    def _steps_from(self, here: np.ndarray) -> np.ndarray:
        """[K, D] where steps of Levenberg and Marquardt with several dampings lead from numbers [D]."""
        steps = self.unknowns.steps
        sides = NUDGE * np.diag(steps)
        misses = marker_misses([self.at(each) for each in np.concatenate([[here], here + sides])])
        # What diverges when it is turned is left where it is.
        slopes = np.nan_to_num((misses[1:] - misses[0]) / NUDGE, nan=0.0, posinf=0.0, neginf=0.0)
        squares, downhill = slopes @ slopes.T, -slopes @ misses[0]
        ways = [
            np.linalg.lstsq(squares + np.diag(damping * np.diag(squares)), downhill, rcond=None)[0]
            for damping in DAMPINGS
        ]
        return np.maximum(here + steps * np.clip(ways, -LONGEST_STEP, LONGEST_STEP), self.unknowns.low)


def marker_errors(fits: Sequence[MarkerFit]) -> np.ndarray:
    """[K] metres: root mean square distance of the markers in the train frames of all episodes; inf if diverged."""
    errors = np.linalg.norm(marker_misses(fits), axis=1)
    return np.where(np.isfinite(errors), errors, np.inf)


def marker_misses(fits: Sequence[MarkerFit]) -> np.ndarray:
    """[K, M] metres, by which markers are missed in the train frames of all episodes, over the root of their number.

    Their squares sum up to the mean square distance of a marker; not finite where a rollout diverged.
    """
    misses, count = [], 0
    for problems in zip(*(fit.problems for fit in fits), strict=True):
        controls = [problem.train_controls() for problem in problems]
        result = rollout(
            batch_of_models(
                [fit.model for fit in fits],
                controls,
                starts=[problem.start for problem in problems],
                velocities=[problem.velocities for problem in problems],
                ground_height=problems[0].episode.ground_height,
            )
        )
        observed = problems[0].episode.points[: len(controls[0].times)]
        seen = np.isfinite(observed).all(axis=2)
        misses.append((result.positions[:, :, problems[0].bound] - observed[None])[:, seen].reshape(len(fits), -1))
        count += int(seen.sum())
    return np.concatenate(misses, axis=1).astype(np.float64) / np.sqrt(max(count, 1))
