"""The baseline twin: a twin as good as it gets without any effect, before anything is blamed on one.

What a twin lacks shows only where it is otherwise right. A fit of free rollouts weighs the last, chaotic centimetres
of a fold; observers ask for graph and grasp that get the forces right. So graphs and grasps of a few sizes are tried
beside the twin's own, and the best is refitted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.diagnosis.evidence.fitted_parameters import baseline_parameters, with_effect
from egophys_core.diagnosis.evidence.refit import (
    Fitted,
    losses_of,
    refit,
    refit_from,
    refit_further,
    residual_scale,
    robust_loss,
)
from egophys_core.diagnosis.evidence.residuals import TrackedEpisode, residuals
from egophys_core.kinds import kind_of
from egophys_core.twin import ObjectModel

FIRST_STEPS, LATER_STEPS = 3, 5
"""Steps by which the starts are refitted at first, and those of the better half of them, again and again while more
than one is left. Where they begin says little of where they end: a toy's own twin, fitted before, began at 986 and
ended at 615; the third one began at 1283 and ended at 337. Of six starts of two rehearsed sheets the sixth won."""

LOST = 5.0
"""Times its residuals in what was fitted from which a twin has lost another episode: a toy that was pushed over lay
elsewhere than its twin (13.7 mm; 1.3, 1.1 and 0.7 in what was fitted), and could support nothing any more."""


@dataclass(frozen=True, kw_only=True)
class BaselineTwin:
    """The twin without an effect."""

    fitted: Fitted
    others: list[ObjectModel]
    """What it was chosen from. A twin bends to make up for an effect that it lacks; these did not, or otherwise."""


def fit_baseline(
    observations: Sequence[TrackedEpisode], model: ObjectModel, *, starts: int, iterations: int
) -> BaselineTwin:
    """The best of the twin and its variants, refitted; all begin some steps before the best is chosen.

    Args:
        starts: so many, those with the least residuals, are refitted.
        iterations: most steps of the last refit, that of the best.
    """
    kind = kind_of(model)
    own = [model, *kind.otherwise_at_rest(model)]
    models = [*own, *kind.variants(model)]
    found = residuals(observations, models)
    scale = residual_scale(observations, [each[0] for each in found])
    losses = [robust_loss([each[row] for each in found], scale) for row in range(len(models))]
    order = np.argsort(losses)
    scale = residual_scale(observations, [each[order[0]] for each in found])
    fits = [
        refit(observations, models[row], baseline_parameters(models[row]), iterations=FIRST_STEPS, scale=scale)
        for row in order[:starts]
    ]
    fits.sort(key=lambda each: each.loss)
    while len(fits) // 2 > 1:
        fits = [refit_further(observations, each, iterations=LATER_STEPS) for each in fits[: len(fits) // 2]]
        fits.sort(key=lambda each: each.loss)
    best, *runners_up = fits
    best = replace(best, scale=min(scale, residual_scale(observations, best.residuals)))
    fitted = refit_further(observations, best, iterations=iterations)
    return BaselineTwin(fitted=fitted, others=[*own, *(each.model for each in runners_up)])


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
    return BaselineTwin(fitted=fitted, others=starts[1:]), min(without, relieved, key=lambda each: each.loss)
