"""Model selection: effects that are worth it are refitted, then confounders of the best, then the twin without any.

A refit ends in the nearest of many optima. So that none wins by a better start alone, a confounder of the best
effect starts from where that one led as well, and so does, at last, the twin without an effect.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from egophys_core.diagnosis.evidence.fitted_parameters import effect_parameters, effect_values
from egophys_core.diagnosis.evidence.judging import gain_on_left_out_data
from egophys_core.diagnosis.evidence.linear_problem import linear_problem
from egophys_core.diagnosis.evidence.refit import Fitted, refit_from
from egophys_core.diagnosis.hypotheses.ranking import RankedEffect
from egophys_core.diagnosis.hypotheses.starts import starts_beside, starts_from_rival
from egophys_core.diagnosis.problem import DiagnosisProblem, Progress
from egophys_core.effects import effect_named, nested
from egophys_core.twin import ObjectModel

MOST_CONFOUNDERS = 2
"""Effects beyond the shortlist that are refitted as confounders of the best of it."""

HOPE = 0.5
"""Share of the gain that is needed to be named, or of the best effect's, that the first steps of a refit must find, or
it ends with them. What gains less than half of another is no rival of it."""

NEARLY = 0.45
"""Share of the gain that is needed to be named from which the best effect has its rivals refitted."""

RELIEVED = 3
"""Starts of the last refit without an effect; in a sheet the third of them ended 11 lower than the first two."""

WORTH_ANOTHER = 0.3
"""Share of the best effect's gain from which its confounder is refitted from where the best one led, too."""


@dataclass(frozen=True, kw_only=True)
class ModelSelection:
    """How it ended."""

    before: Fitted
    """Without an effect."""
    fits: dict[str, Fitted]
    """With each effect by name."""


def select_models(
    problem: DiagnosisProblem,
    before: Fitted,
    effects: Mapping[str, RankedEffect],
    chosen: Collection[str],
    reserve: Sequence[str],
    progress: Progress,
    *,
    earlier: Mapping[str, ObjectModel],
    others: Sequence[ObjectModel],
    far: Mapping[str, Sequence[ObjectModel]],
) -> ModelSelection:
    """Refit the effects, those that turn out to be like the best, and the twin without any.

    Args:
        before: the twin without an effect.
        effects: the whole library, by name.
        chosen: names of those that are refitted in any case.
        reserve: names of those that are if they are confounders of the best of these, the likeliest first.
        earlier: by name, where refits ended on a coarser scale, after all this; these start there, and there alone.
        others: twins without an effect at which refits may start as well.
        far: by name, twins with an effect at which its refit may start as well.
    """
    refits = _Refits(problem, before, effects, earlier=earlier, others=others, far=far)
    for index, name in enumerate(chosen):
        progress(f"refit with {name}", 0.5 * index / len(chosen))
        refits.refit(name)
    if refits.gains and refits.gains[refits.best] >= NEARLY * refits.needed:
        confounders = [each for each in reserve if each in effect_named(refits.best).traits.confounders]
        for name in confounders[:MOST_CONFOUNDERS]:
            progress(f"refit with {name}", 0.5)
            refits.refit(name)
        had, in_the_air = set(earlier), problem.observations[0].free
        while again := _again(best := refits.best, refits.gains, in_the_air) & effects.keys() - had:
            had |= again
            for name in sorted(again):
                progress(f"refit with {name} from where {best} led", 0.7)
                refits.refit_from_where_led(name, best)
    if refits.fits:
        progress("refit without an effect from where effects led", 0.9)
        before = min(before, refits.relieved(), key=lambda each: each.loss)
    return ModelSelection(before=before, fits=refits.fits)


class _Refits:
    """The effects that were refitted so far, by name."""

    def __init__(
        self,
        problem: DiagnosisProblem,
        before: Fitted,
        effects: Mapping[str, RankedEffect],
        *,
        earlier: Mapping[str, ObjectModel],
        others: Sequence[ObjectModel],
        far: Mapping[str, Sequence[ObjectModel]],
    ) -> None:
        """None yet; arguments as of `select_models`."""
        self._observations, self._iterations = problem.observations, problem.options.refit_iterations
        self._before, self._effects = before, effects
        self._earlier, self._others, self._far = earlier, others, far
        self._without = linear_problem(before.residuals, before.jacobian, before.scale)
        self.needed = problem.thresholds.gain_alone(
            fitted=len(problem.observations), validated=bool(problem.validation)
        )
        """Gain from which one may be named."""
        if before.model.effects:
            self.needed = max(self.needed, problem.thresholds.second_gain)
        self.fits: dict[str, Fitted] = {}
        self.gains: dict[str, float] = {}
        """On left-out data."""

    @property
    def best(self) -> str:
        """The one that gains most."""
        return max(self.gains, key=lambda name: self.gains[name])

    def refit(self, name: str) -> None:
        """Refit an effect from starts of its own, or from where a coarser scale left it."""
        if name in self._earlier:
            starts = [self._earlier[name]]
        else:
            far = self._far.get(name, ())
            starts = starts_beside(self._observations, self._before, self._effects[name], self._others, far)
        self._refit(name, starts)

    def refit_from_where_led(self, name: str, best: str) -> None:
        """Refit an effect from the twin which the best one led to."""
        effect, scale = self._effects[name], self._before.scale
        ends = [self.fits[name].model] if name in self.fits else []
        values = effect_values(ends[0], name) if ends else effect.values
        starts = starts_from_rival(self._observations, effect, values, self.fits[best].model, scale)
        self._refit(name, [*ends, *starts])

    def relieved(self) -> Fitted:
        """The twin without any effect, refitted from where effects led."""
        led = sorted(self.fits.values(), key=lambda each: each.loss)
        starts = [replace(each.model, effects=each.model.effects[:-1]) for each in led]
        return refit_from(
            self._observations,
            starts,
            self._before.parameters,
            scale=self._before.scale,
            iterations=self._iterations,
            finalists=RELIEVED,
        )

    def _refit(self, name: str, starts: Sequence[ObjectModel]) -> None:
        hope = HOPE * max([self.needed, *self.gains.values()])
        self.fits[name] = refit_from(
            self._observations,
            starts,
            (*self._before.parameters, *effect_parameters(effect_named(name))),
            scale=self._before.scale,
            iterations=self._iterations,
            hopeless=self._before.loss - hope,
        )
        self.gains[name] = gain_on_left_out_data(self.fits[name], self._before, self._without)


def _again(best: str, gains: Mapping[str, float], in_the_air: bool) -> set[str]:
    """Effects that start where the best one led: nested ones, and its confounders that gain much."""
    near = {name for name, gain in gains.items() if gain >= WORTH_ANOTHER * gains[best]}
    found = nested(best) | near.intersection(effect_named(best).traits.confounders)
    if in_the_air:
        # Without a table that lies aslant, too, a tilted frame is tilted gravity.
        found |= {other for name in near for other in effect_named(name).traits.equivalent_in_air}
    return found
