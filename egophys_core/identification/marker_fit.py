"""From episodes of an object with a few markers to its model: one stiffness, one damping, one drag.

Free rollouts tell them: markers are too few and too well measured for anything to be smoothed away. A ring-down that
has the wrong period looks as wrong as any other, so the static deflection under gravity tells the stiffness first, with
all motion damped away; then the period does, then all numbers are refined together.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from egophys_core.errors import OptionsError, TwinError
from egophys_core.identification.fit import Fit
from egophys_core.identification.options import FitOptions
from egophys_core.kinds import kind_named
from egophys_core.kinds.kind import MarkerBody
from egophys_core.kinds.marker_body import marker_body, marker_model
from egophys_core.kinds.template import parse_template
from egophys_core.observation import FitProblem, ObservedEpisode, place_model, require_carried
from egophys_core.simulation import batch_of_models, rollout
from egophys_core.twin import ObjectModel

NEAR = np.geomspace(0.75, 1.33, 32)
"""Times the stiffness by static deflection, within which that by the ring-down is looked for."""

REFINEMENTS = 20
"""Steps of the refinement at most."""

LM_DAMPINGS = (0.0, 0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0)
"""Of Levenberg and Marquardt's steps; all are tried, as one lane group."""

FINITE_DIFFERENCE_STEP = 0.1
"""Share of the first steps by which slopes are measured."""

LONGEST_STEP = 3.0
"""First steps that a refinement moves at most at once."""

WORTH_IT = 0.7
"""Times the error without them is left at most with numbers that join later, or these are not kept: of cables that are
alike all along, with an effect or none, 0.81 to 0.88; of a measured one that is not, 0.5."""

LEAST_GAIN = 1e-3
"""Share of the error that a step must save, or the refinement ends."""

Progress = Callable[[str, float, float], None]


def fit_markers(
    observed: Sequence[ObservedEpisode],
    options: FitOptions,
    *,
    seed: int,
    progress: Progress,
    checkpoint: Path | None,
) -> Fit:
    """Fit a model to the train frames of episodes in which an object is seen at a few markers; nothing is random.

    Raises:
        EpisodeError: episodes with different markers, or markers that do not tell a direction or that no clamp holds.
        OptionsError: a load on what has no known weight, or what only a search takes.
        TwinError: all rollouts diverged.
    """
    if checkpoint is not None:
        raise OptionsError(
            f"{observed[0].name}: at markers there is no search to keep in {checkpoint}; leave the checkpoint out"
        )
    template = parse_template(options.template) if options.template else None
    seen = observed[0].markers
    if seen is None:
        raise TwinError(f"{observed[0].name} shows a surface, and is to be fitted at markers")
    body = marker_body(seen, template, options.named_kind)
    if not body.is_size_known and any(each.load for each in observed):
        raise OptionsError(
            "a load on a cable means nothing without its weight; give its size, as in --template box:0.8x0.01x0.01"
        )
    if not marker_model(kind_named(body.kind)).starts_as_seen:
        for each in observed:
            if each.markers is not None:
                require_carried(each.record, each.markers)
    found = MarkerSearch(body, observed, options.density).run(progress)
    return Fit(
        model=found.model,
        grasp=found.body.grasp,
        problem=found.problems[0],
        loss=found.error,
        settings={
            **options.settings(at_markers=True),
            "loads": {each.name: each.load for each in observed if each.load},
            "assumed": list(found.body.notes),
            "rmse_m": found.error,
        },
    )


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

    def __init__(self, body: MarkerBody, observed: Sequence[ObservedEpisode], density: float):
        """Of a density in kg/m^3."""
        self.observed = observed
        first, from_markers = observed[0].episode, marker_model(kind_named(body.kind))
        self.unknowns = from_markers.unknowns(body, first.controllers.shape[1] + first.points.shape[1], density)
        self._starts_as_seen = from_markers.starts_as_seen
        self._placed: tuple[FitProblem, ...] | None = None

    def at(self, numbers: np.ndarray) -> MarkerFit:
        """What numbers [D] make of the object."""
        body, model = self.unknowns.model(numbers)
        # What begins along what is seen is placed once: its numbers have no part in it.
        problems = self._placed or tuple(place_model(model, body.grasp, each) for each in self.observed)
        if self._starts_as_seen:
            self._placed = problems
        return MarkerFit(model=model, body=body, problems=problems)

    def best(self, candidates: np.ndarray, prior: float = 0.0) -> tuple[np.ndarray, float]:
        """The best of numbers [K, D], and its error in metres.

        Args:
            prior: metres, the weight of what is known of numbers beforehand; the error counts it.

        Raises:
            TwinError: all rollouts diverged.
        """
        errors = np.linalg.norm(self._residuals(candidates, prior), axis=1)
        errors = np.where(np.isfinite(errors), errors, np.inf)
        row = int(np.argmin(errors))
        if not np.isfinite(errors[row]):
            raise TwinError(f"none of {len(candidates)} stiffnesses could be simulated; check the template's size")
        return candidates[row], float(errors[row])

    def run(self, progress: Progress = lambda stage, share, error: None) -> MarkerFit:
        """By the static deflection, by the ring-down, then all together.

        Raises:
            TwinError: all rollouts diverged.
        """
        here, error = self.best(self.unknowns.static_deflection)
        progress("static deflection", 0.2, error)
        here, error = self.best(self.unknowns.about(here, NEAR))
        progress("ring-down", 0.3, error)
        later = self.unknowns.later
        now = np.ones(len(here), bool) if later is None else ~later
        here, error = self._refined(here, error, now, 0.0, partial(_refining, progress, 0.3, 0.6))
        if later is not None:
            everything = np.ones(len(here), bool)
            found, its_error = self._refined(here, error, everything, error, partial(_refining, progress, 0.6, 1.0))
            here = found if its_error < WORTH_IT * error else here
        fit = self.at(here)
        return replace(fit, error=float(np.linalg.norm(marker_residuals([fit]))))

    def _refined(
        self,
        here: np.ndarray,
        error: float,
        searched: np.ndarray,
        prior: float,
        report: Callable[[int, float], None],
    ) -> tuple[np.ndarray, float]:
        """From numbers [D] with an error on, by those that are searched [D]."""
        for round_ in range(REFINEMENTS):
            found, its_error = self.best(self._steps_from(here, searched, prior), prior)
            report(round_, min(error, its_error))
            if its_error >= (1.0 - LEAST_GAIN) * error:
                break
            here, error = found, its_error
        return here, error

    def _steps_from(self, here: np.ndarray, searched: np.ndarray, prior: float) -> np.ndarray:
        """[K, D] where steps of Levenberg and Marquardt with several dampings lead from numbers [D]."""
        steps = self.unknowns.steps[searched]
        sides = FINITE_DIFFERENCE_STEP * np.diag(self.unknowns.steps)[searched]
        residuals = self._residuals(np.concatenate([[here], here + sides]), prior)
        # What diverges when it is changed is left where it is.
        slopes = np.nan_to_num((residuals[1:] - residuals[0]) / FINITE_DIFFERENCE_STEP, nan=0.0, posinf=0.0, neginf=0.0)
        squares, downhill = slopes @ slopes.T, -slopes @ residuals[0]
        moves = [
            np.linalg.lstsq(squares + np.diag(damping * np.diag(squares)), downhill, rcond=None)[0]
            for damping in LM_DAMPINGS
        ]
        found = np.tile(here, (len(moves), 1))
        found[:, searched] += steps * np.clip(moves, -LONGEST_STEP, LONGEST_STEP)
        return np.maximum(found, self.unknowns.low)

    def _residuals(self, candidates: np.ndarray, prior: float) -> np.ndarray:
        """[K, M] metres, of the markers at numbers [K, D] and of a prior of some weight in metres."""
        residuals = marker_residuals([self.at(numbers) for numbers in candidates])
        if self.unknowns.prior is None or not prior:
            return residuals
        return np.concatenate([residuals, prior * candidates @ self.unknowns.prior.T], axis=1)


def _refining(progress: Progress, begins: float, ends: float, round_: int, error: float) -> None:
    """Tell how far a refinement is, by shares of all that is done."""
    progress("refine", begins + (ends - begins) * (round_ + 1) / REFINEMENTS, error)


def marker_residuals(fits: Sequence[MarkerFit]) -> np.ndarray:
    """[K, M] metres, residuals of the markers in the train frames of all episodes, over the root of their number.

    Their squares sum up to the mean square distance of a marker; not finite where a rollout diverged.
    """
    residuals, count = [], 0
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
        residuals.append((result.positions[:, :, problems[0].bound] - observed[None])[:, seen].reshape(len(fits), -1))
        count += int(seen.sum())
    return np.concatenate(residuals, axis=1).astype(np.float64) / np.sqrt(max(count, 1))
