"""What the effects do to a fitted twin's residuals, nearby and far off, and what they promise by that."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

from egophys_core.diagnosis.criterion import CriterionResult, Direction, compare
from egophys_core.diagnosis.evidence.linear_problem import linear_problem
from egophys_core.diagnosis.evidence.refit import Fitted, robust_loss
from egophys_core.diagnosis.hypotheses.large_amplitude import (
    LargeAmplitudeProbe,
    large_amplitude_gains,
    probe_at_large_amplitude,
)
from egophys_core.diagnosis.hypotheses.ranking import Probe, RankedEffect, Ranking, probe_effects, rank
from egophys_core.diagnosis.hypotheses.rod_starts import RodStart, rod_starts
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.diagnosis.problem import DiagnosisProblem
from egophys_core.kinds import kind_of

Criteria = dict[str, tuple[CriterionResult, ...]]
"""Per effect what it was held against."""

OUT_OF_STEP_M = 0.002
"""Metres: scale of residuals from which a cable may be out of phase with its twin; then slopes there say nothing."""


@dataclass(frozen=True, kw_only=True)
class Promise:
    """What the effects may gain in a refit."""

    ranking: Ranking
    """By slopes alone."""
    gains: Mapping[str, float]
    """Per effect the largest held-out gain by its slopes, by large-amplitude probes, or on rods."""

    def worth_a_refit(self, refit_gain: float) -> list[RankedEffect]:
        """The effects that promise at least so much, the most promising first."""
        worth = [each for each in self.ranking.ranked if self.gains[each.name] >= refit_gain]
        return sorted(worth, key=lambda each: -self.gains[each.name])

    def criteria(self, worth: Sequence[RankedEffect], options: DiagnosisOptions, refit_gain: float) -> Criteria:
        """What keeps each effect from a refit, unless there is another reason for one.

        Args:
            worth: those that are worth it, the most promising first.
        """
        found: Criteria = {}
        for name, gain in self.gains.items():
            what, because = "held-out gain by slopes and large-amplitude probes:", " to be worth a refit"
            found[name] = (compare("worth_a_refit", what, gain, Direction.AT_LEAST, refit_gain, because=because),)
        for place, each in enumerate(worth, start=1):
            what = "place in the order of held-out gains by slopes and large-amplitude probes:"
            found[each.name] += (compare("shortlist", what, place, Direction.AT_MOST, options.shortlist, unit="1"),)
        return found


@dataclass(frozen=True, kw_only=True)
class Survey:
    """What the effects do, nearby and far off; simulated once for all scales of the residuals."""

    fitted: Fitted
    """Where from."""
    probes: list[Probe]
    large_amplitude_probes: list[LargeAmplitudeProbe]
    on_rods: dict[str, list[RodStart]]
    """Of a cable, by effect, the best first."""

    def promise(self, scale: float, *, surrogates: int, seed: int) -> Promise:
        """What the effects promise, judged by residuals of a scale."""
        linear = linear_problem(self.fitted.residuals, self.fitted.jacobian, scale)
        ranking = rank(linear, self.probes, surrogates=surrogates, seed=seed)
        far = large_amplitude_gains(linear, self.large_amplitude_probes)
        known = robust_loss(self.fitted.residuals, scale)
        rods = {name: known - min(start.loss(scale) for start in starts) for name, starts in self.on_rods.items()}
        gains = {
            each.name: max(each.held_out_gain, far.get(each.name, 0.0), rods.get(each.name, 0.0))
            for each in ranking.ranked
        }
        return Promise(ranking=ranking, gains=gains)


def survey_effects(
    problem: DiagnosisProblem, fitted: Fitted, without: Collection[str], progress: Callable[[float], None]
) -> Survey:
    """Simulate the effects at all their starts, and farther off at the best of these."""
    progress(0.0)
    probes = probe_effects(
        problem.observations,
        fitted.model,
        fitted.residuals,
        without=without,
        progress=lambda share: progress(0.6 * share),
    )
    nearby = rank(
        linear_problem(fitted.residuals, fitted.jacobian, fitted.scale), probes, surrogates=0, seed=problem.seed
    )
    large_amplitude_probes = probe_at_large_amplitude(
        problem.observations, fitted.model, nearby.ranked, progress=lambda share: progress(0.6 + 0.2 * share)
    )
    on_rods = {}
    if kind_of(fitted.model).is_line and fitted.scale > OUT_OF_STEP_M:
        on_rods = rod_starts(
            problem.observations,
            fitted.model,
            nearby.ranked,
            fitted.scale,
            progress=lambda share: progress(0.8 + 0.2 * share),
        )
    return Survey(fitted=fitted, probes=probes, large_amplitude_probes=large_amplitude_probes, on_rods=on_rods)
