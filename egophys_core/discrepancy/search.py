"""One search: which effect, beside those a fitted twin carries, explains what it leaves unexplained."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from egophys_core.discrepancy.generic_law import Law, find_law
from egophys_core.discrepancy.judging import Judged, judge, proven
from egophys_core.discrepancy.leaps import Leap, leap_gains, leap_off
from egophys_core.discrepancy.linear import linear_problem
from egophys_core.discrepancy.options import DiagnosisOptions
from egophys_core.discrepancy.ranking import Probe, Ranked, Ranking, probe_effects, rank
from egophys_core.discrepancy.refit import Fitted, refit_further, residual_scale
from egophys_core.discrepancy.residuals import Observation
from egophys_core.discrepancy.starts import starts_beside, starts_from_rival
from egophys_core.discrepancy.verdict import LARGEST_P, LEAST_GAIN, Verdict, decide
from egophys_core.twin import ObjectKind, ObjectModel

Progress = Callable[[str, float], None]
"""Called with stage and share of the whole done (0..1); may raise to stop."""

WORTH_REFITTING = LEAST_GAIN / 6.0
"""Held-out gain of the linear problem below which a refit has never found what was asked for."""

FINER = 0.7
"""Of the scale of the residuals: where an effect leaves less, all are judged again by what it leaves."""

ALWAYS = {ObjectKind.SHEET: (), ObjectKind.SOLID: ("uneven_mass",)}
"""Effects that are refitted whatever their slopes say: a toy lies as it lies, with a little lump or none."""

MIMICS = 2
"""Effects beyond the shortlist that are refitted because they mimic the best of it."""

WORTH_ANOTHER = 0.3
"""Share of the best effect's gain from which one that mimics it is refitted from where the best one led, too."""


@dataclass(frozen=True, kw_only=True)
class Inquiry:
    """What stays the same over the searches of a diagnosis."""

    observations: Sequence[Observation]
    """What is fitted."""
    proofs: Sequence[Observation]
    """Episodes that are not."""
    options: DiagnosisOptions
    seed: int


@dataclass(frozen=True, kw_only=True)
class Search:
    """What one search found."""

    before: Fitted
    ranking: Ranking
    judged: list[Judged]
    law: Law
    verdict: Verdict


@dataclass(frozen=True, kw_only=True)
class Survey:
    """What the effects do, nearby and far off; simulated once for all scales of the residuals."""

    fitted: Fitted
    """Where from."""
    probes: list[Probe]
    leaps: list[Leap]

    def ranking(self, scale: float, *, shams: int, seed: int) -> tuple[Ranking, list[Ranked]]:
        """The effects ranked on a scale by their slopes, and the same in the order in which they are worth a refit."""
        problem = linear_problem(self.fitted.residuals, self.fitted.jacobian, scale)
        ranking = rank(problem, self.probes, shams=shams, seed=seed)
        leaps = leap_gains(problem, self.leaps)
        promise = {each.name: max(each.held_out_gain, leaps.get(each.name, 0.0)) for each in ranking.ranked}
        worth = [each for each in ranking.ranked if promise[each.name] >= WORTH_REFITTING]
        return ranking, sorted(worth, key=lambda each: -promise[each.name])


def search(
    inquiry: Inquiry,
    before: Fitted,
    without: Collection[str],
    progress: Progress,
    *,
    others: Sequence[ObjectModel] = (),
) -> Search:
    """Probe, rank, refit the shortlist and decide.

    An effect that explains much leaves residuals far smaller than those it was judged by. Then all are judged again on
    that scale: what was hidden in the large ones counts now.

    Args:
        before: the twin refitted without any further effect.
        without: names of effects that are left out.
        others: twins without the effect at which refits may start as well.
    """
    survey = _survey(inquiry, before, without, lambda share: progress("probe the effects", 0.3 * share))
    found = _judged(inquiry, survey, before, others, lambda stage, share: progress(stage, 0.3 + 0.4 * share))
    finest = min((residual_scale(each.fitted.residuals) for each in found.judged), default=before.scale)
    if finest < FINER * before.scale:
        finer = replace(before, scale=finest)
        before = refit_further(inquiry.observations, finer, iterations=inquiry.options.refit_iterations)
        earlier = {each.name: each.fitted.model for each in found.judged if each.gain >= WORTH_REFITTING}
        found = _judged(
            inquiry, survey, before, others, lambda stage, share: progress(stage, 0.7 + 0.3 * share), earlier=earlier
        )
    return found


def _survey(inquiry: Inquiry, fitted: Fitted, without: Collection[str], progress: Callable[[float], None]) -> Survey:
    """Simulate the effects at all their starts, and farther off at the best of these."""
    progress(0.0)
    probes = probe_effects(
        inquiry.observations,
        fitted.model,
        fitted.residuals,
        without=without,
        progress=lambda share: progress(0.6 * share),
    )
    nearby = rank(linear_problem(fitted.residuals, fitted.jacobian, fitted.scale), probes, shams=0, seed=inquiry.seed)
    leaps = leap_off(
        inquiry.observations, fitted.model, nearby.ranked, progress=lambda share: progress(0.6 + 0.4 * share)
    )
    return Survey(fitted=fitted, probes=probes, leaps=leaps)


def _judged(
    inquiry: Inquiry,
    survey: Survey,
    before: Fitted,
    others: Sequence[ObjectModel],
    progress: Progress,
    *,
    earlier: Mapping[str, ObjectModel] = MappingProxyType({}),
) -> Search:
    """The effects judged on the scale of the residuals `before`.

    Args:
        earlier: models with effects that were refitted on a coarser scale: judged whatever the ranking says.
    """
    observations, options = inquiry.observations, inquiry.options
    problem = linear_problem(before.residuals, before.jacobian, before.scale)
    ranking, worth = survey.ranking(before.scale, shams=options.shams, seed=inquiry.seed)
    law = find_law(observations, before.model, before.residuals, problem)

    by_name = {each.name: each for each in ranking.ranked}

    def judged_from(name: str, starts: Sequence[ObjectModel]) -> Judged:
        return judge(
            observations,
            before,
            problem,
            name,
            starts,
            iterations=options.refit_iterations,
            bootstraps=options.bootstraps,
            seed=inquiry.seed,
        )

    def refitted(names: Sequence[str], begins: float) -> list[Judged]:
        found = []
        for index, name in enumerate(names):
            progress(f"refit with {name}", begins + (1.0 - begins) * index / (len(names) + MIMICS))
            starts = [earlier[name]] if name in earlier else starts_beside(observations, before, by_name[name], others)
            found.append(judged_from(name, starts))
        return found

    chosen = {*(each.name for each in worth[: options.shortlist]), *ALWAYS[before.model.kind], *earlier}
    judged = refitted([each.name for each in ranking.ranked if each.name in chosen], 0.0)
    best = max(judged, key=lambda each: each.gain, default=None)
    if best is not None and best.gain >= LEAST_GAIN:
        mimics = [each.name for each in worth if each.name in best.mimics and each.name not in chosen]
        judged += refitted(mimics[:MIMICS], 0.6)
        best = max(judged, key=lambda each: each.gain)
        for index, each in enumerate(judged):
            if each.name in best.mimics and each.gain >= WORTH_ANOTHER * best.gain:
                progress(f"refit with {each.name} from where {best.name} led", 0.8 + 0.2 * index / len(judged))
                starts = starts_from_rival(
                    observations, by_name[each.name], each.values, best.fitted.model, before.scale
                )
                again = judged_from(each.name, [each.fitted.model, *starts])
                judged[index] = min(each, again, key=lambda one: one.fitted.loss)
    if inquiry.proofs and judged:
        # The twin without an effect gets as many steps more.
        control = refit_further(observations, before, iterations=options.refit_iterations)
        judged = proven(judged, control, inquiry.proofs)
    p_null = {each.name: ranking.p_null(each.gain) for each in judged}
    second = bool(before.model.effects)
    law_gain = law.held_out_gain if ranking.p_null(law.held_out_gain) <= LARGEST_P else 0.0
    verdict = decide(judged, p_null, law_gain, len(observations), second=second)
    return Search(before=before, ranking=ranking, judged=judged, law=law, verdict=verdict)
