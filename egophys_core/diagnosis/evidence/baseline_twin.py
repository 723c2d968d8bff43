"""The baseline twin: a twin as good as it gets without any effect, before anything is blamed on one.

What a twin lacks shows only where it is otherwise right. A fit of free rollouts weighs the last, chaotic centimetres
of a fold; observers ask for graph and grasp that get the forces right. So graphs and grasps of a few sizes are tried
beside the twin's own, each from the best of its plain parameters, and the best is refitted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from egophys_core.diagnosis.evidence.fitted_parameters import baseline_parameters, with_effect
from egophys_core.diagnosis.evidence.refit import (
    Fitted,
    best_of_each,
    losses_by_residuals,
    losses_of,
    refit,
    refit_from,
    refit_further,
    residual_scale,
)
from egophys_core.diagnosis.evidence.residuals import residuals
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.effects import TwinEffect
from egophys_core.kinds import kind_of
from egophys_core.twin import ObjectModel

FIRST_STEPS, LATER_STEPS = 3, 5
"""Steps by which the starts are refitted at first, and those of the better half of them, again and again while more
than one is left. Where they begin says little of where they end: a toy's own twin, fitted before, began at 986 and
ended at 615; the third one began at 1283 and ended at 337. Of six starts of two rehearsed sheets the sixth won."""

LOST = 5.0
"""Times its residuals in what was fitted from which a twin has lost another episode: a toy that was pushed over lay
elsewhere than its twin (13.7 mm; 1.3, 1.1 and 0.7 in what was fitted), and could support nothing any more."""


RUNNERS_UP = 2
"""Of the graphs and grasps that were not chosen so many, the best, are starts of refits with an effect."""


@dataclass(frozen=True, kw_only=True)
class TriedTwin:
    """A twin with one of the graphs and grasps that were tried."""

    plain: ObjectModel
    """Before it was refitted: it has not bent to make up for what it lacks."""
    refitted: ObjectModel
    """By a few steps, or some more where it looked well."""

    def carrying(self, effects: tuple[TwinEffect, ...]) -> Self:
        """The twin with these effects and no others."""
        return replace(
            self, plain=replace(self.plain, effects=effects), refitted=replace(self.refitted, effects=effects)
        )


@dataclass(frozen=True, kw_only=True)
class BaselineTwin:
    """The twin without an effect."""

    fitted: Fitted
    own: list[ObjectModel]
    """The twin as it was built, and as it may be better known."""
    tried: list[TriedTwin]
    """What it was chosen from, the best first; one of each graph and grasp."""

    @property
    def others(self) -> list[ObjectModel]:
        """Twins that did not bend to make up for an effect that they lack, or otherwise."""
        return [*self.own, *(each.refitted for each in self.tried[1 : 1 + RUNNERS_UP])]


def fit_baseline(
    observations: Sequence[TrackedEpisode], model: ObjectModel, *, starts: int, iterations: int
) -> BaselineTwin:
    """The best of the twin and its variants, refitted; all begin some steps before the best is chosen.

    Args:
        starts: so many graphs and grasps, those with the least residuals, are refitted.
        iterations: most steps of the last refit, that of the best.
    """
    kind = kind_of(model)
    own = [model, *kind.otherwise_at_rest(model)]
    made_alike = [own, *kind.variants(model)]
    models = [each for group in made_alike for each in group]
    found = residuals(observations, models)
    scale = residual_scale(observations, [each[0] for each in found])
    losses = losses_by_residuals(found, scale)
    scale = residual_scale(observations, [each[np.argmin(losses)] for each in found])
    plain = best_of_each(made_alike, losses)[:starts]
    fits = [
        (each, refit(observations, each, baseline_parameters(each), iterations=FIRST_STEPS, scale=scale))
        for each in plain
    ]
    fits.sort(key=_loss)
    left = len(fits)
    while (left := left // 2) > 1:
        further = [(each, refit_further(observations, fit, iterations=LATER_STEPS)) for each, fit in fits[:left]]
        fits = [*sorted(further, key=_loss), *fits[left:]]
    best = fits[0][1]
    best = replace(best, scale=min(scale, residual_scale(observations, best.residuals)))
    return BaselineTwin(
        fitted=refit_further(observations, best, iterations=iterations),
        own=own,
        tried=[TriedTwin(plain=each, refitted=fit.model) for each, fit in fits],
    )


def _loss(tried: tuple[ObjectModel, Fitted]) -> float:
    return tried[1].loss


def follows(fitted: Fitted, observations: Sequence[TrackedEpisode]) -> list[bool]:
    """Per episode that was not fitted, whether a twin follows it well enough to tell what it lacks there.

    A few markers always tell it: what is rolled out freely is not chaotic, and may be far off for lack of the effect.
    """
    if not observations or observations[0].free:
        return [True] * len(observations)
    most = LOST * residual_scale(observations, fitted.residuals)
    return [bool(np.nanmedian(np.abs(found)) <= most) for found in residuals(observations, [fitted.model])]


def baseline_beside(
    observations: Sequence[TrackedEpisode],
    baseline: BaselineTwin,
    effects: Mapping[str, Mapping[str, float]],
    *,
    iterations: int,
) -> tuple[BaselineTwin, Fitted]:
    """The baseline twin beside effects whose parameters are known, and the one without, from where these led as well.

    Args:
        baseline: the twin without them.
        effects: values by effect and parameter; they are kept.
        iterations: most steps of each refit.
    """

    def beside(model: ObjectModel) -> ObjectModel:
        for name, values in effects.items():
            model = with_effect(model, name, dict(values))
        return model

    without = baseline.fitted
    starts = [beside(model) for model in (without.model, *baseline.others)]
    order = np.argsort(losses_of(observations, starts, without.scale))
    best = refit_from(
        observations, [starts[row] for row in order], without.parameters, scale=without.scale, iterations=iterations
    )
    bare = [replace(best.model, effects=())]
    relieved = refit_from(observations, bare, without.parameters, scale=without.scale, iterations=iterations)
    # What they explain is gone from the residuals: what remains is judged on its own scale.
    best = replace(best, scale=min(best.scale, residual_scale(observations, best.residuals)))
    fitted = refit_further(observations, best, iterations=iterations)
    found = BaselineTwin(
        fitted=fitted,
        own=[beside(each) for each in baseline.own],
        tried=[each.carrying(fitted.model.effects) for each in baseline.tried],
    )
    return found, min(without, relieved, key=lambda each: each.loss)
