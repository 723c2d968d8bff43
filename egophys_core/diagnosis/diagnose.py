"""Diagnosis: from a twin and episodes of its object to what it lacks, and a better twin."""

import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from egophys_core import __version__
from egophys_core.diagnosis.diagnosis import (
    Candidate,
    DetectionLimit,
    Diagnosis,
    Evidence,
    NamedEffect,
    PredictionErrors,
)
from egophys_core.diagnosis.direct.measure import MeasuredEffect, measured_limits
from egophys_core.diagnosis.evidence.free_rollouts import FreeErrors, episode_error
from egophys_core.diagnosis.evidence.judging import RefittedEffect
from egophys_core.diagnosis.evidence.linear_problem import linear_problem
from egophys_core.diagnosis.evidence.marker_observations import observe_markers
from egophys_core.diagnosis.evidence.predicting_twin import predicting_pair
from egophys_core.diagnosis.evidence.refit import Fitted
from egophys_core.diagnosis.evidence.residuals import track_offsets
from egophys_core.diagnosis.evidence.where import where
from egophys_core.diagnosis.ground import Ground, prepare_ground
from egophys_core.diagnosis.hypotheses.attained_gain import AttainedGains
from egophys_core.diagnosis.hypotheses.detection_limits import detection_limits
from egophys_core.diagnosis.hypotheses.ranking import RankedEffect
from egophys_core.diagnosis.null_gains import NullGains, null_gains
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.diagnosis.problem import DiagnosisProblem, Progress
from egophys_core.diagnosis.tracked_episode import TrackedEpisode, observe
from egophys_core.diagnosis.unidentifiable import unidentifiable_effects, why_not_looked_for
from egophys_core.diagnosis.verdict.explain import explain
from egophys_core.diagnosis.verdict.search_verdict import Search
from egophys_core.effects import effect_named
from egophys_core.episode import Episode
from egophys_core.errors import DiscrepancyError, EpisodeError
from egophys_core.identification import episode_digest
from egophys_core.kinds import kind_of
from egophys_core.observation import AnyEpisode, ObservedEpisode, observe_episodes
from egophys_core.observation.unmoved import why_unmoved
from egophys_core.options import to_mapping
from egophys_core.twin import ObjectModel, Provenance, Twin

Item = TypeVar("Item")

VALIDATION = 3
"""Of so many episodes one is not fitted: whether an effect shows there, too, says more than any fit."""

LEAST_MOTION_S = 1.0
"""Seconds of handling below which an episode says nothing."""

WHAT_TO_DO = "`egophys experiment TWIN --out DIR` says which motion shows most, to a person and to an arm"


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What a diagnosis found, and the twin that follows from it."""

    diagnosis: Diagnosis
    twin: Twin
    """A new version that names its parent."""
    before: ObjectModel
    """Refitted without any effect: what errors before are of."""
    evidence: Evidence
    searches: tuple[Search, ...]
    """The one beside the twin with what was measured, and, after it named an effect, the one beside that."""


def diagnose(
    twin: Twin,
    episodes: Sequence[AnyEpisode],
    options: DiagnosisOptions,
    *,
    asked: int = 0,
    loads: Mapping[str, float] | None = None,
    report_on: Sequence[AnyEpisode] = (),
    without: Collection[str] = (),
    seed: int = 0,
    progress: Progress = lambda stage, share: None,
) -> Finding:
    """Find what a twin lacks.

    Args:
        episodes: two motions or more, to tell the object from the motion. Of three or more the last third is not
            fitted: what is named has to show there, too. As recorded, or observed already (`observe_episodes`, which
            then takes the loads).
        asked: how many of them are motions that were chosen to show effects.
        loads: N that hang at the free end of an object that is seen at a few markers, by name of the episode.
        report_on: further episodes of the object, which have no part in what is found: errors are reported on them.
        without: effects of the library to leave out.
        seed: of surrogates and resamples.
        progress: called with stage and share done.

    Raises:
        EpisodeError: in an episode no hand moves the object, or it is another one.
        OptionsError: a load for no episode, or on what is seen all over.
        DiscrepancyError: no episode, or one that is too short to say anything.
        TwinError: `without` names no effect.
    """
    if not episodes:
        raise DiscrepancyError("no episode given; a diagnosis compares a twin with at least one, better two motions")
    progress("observe", 0.0)
    looked_at = observe_episodes([*episodes, *report_on], loads)
    _require_distinct([each.source for each in looked_at])
    found = [_observed(twin, each) for each in looked_at]
    fitted, others = found[: len(episodes)], found[len(episodes) :]
    return _diagnose_observed(
        twin,
        fitted,
        options,
        asked=asked,
        report_on=others,
        without=(*without, *unidentifiable_effects(twin.model, fitted)),
        seed=seed,
        progress=progress,
    )


def _diagnose_observed(
    twin: Twin,
    observations: Sequence[TrackedEpisode],
    options: DiagnosisOptions,
    *,
    asked: int,
    report_on: Sequence[TrackedEpisode],
    without: Collection[str],
    seed: int,
    progress: Progress,
) -> Finding:
    """As `diagnose`, from episodes in which the twin has its place already."""
    started, null = time.monotonic(), null_gains(asked)
    for name in without:
        effect_named(name)
    fitted, validation = fitted_and_validation(observations)
    ground = prepare_ground(
        twin.model,
        fitted,
        validation,
        options,
        null=null,
        without=without,
        seed=seed,
        progress=lambda stage, share: progress(stage, 0.05 + 0.15 * share),
    )
    found = explain(
        ground.problem,
        ground.baseline,
        ground.measured,
        without,
        lambda stage, share: progress(stage, 0.2 + 0.7 * share),
    )
    first = found.searches[0]
    progress("roll out before and after", 0.9)
    everywhere = [*observations, *report_on]
    # Refitted for as many steps as with the effects, from where these led as well.
    bare = (ground.bare or first.before).model
    before, after, errors = predicting_pair(bare, found.fitted.model, everywhere, given=len(observations))
    offsets = [track_offsets(each, [before])[0][0] for each in fitted]
    error = tuple(
        episode_error(each, *pair, fitted=index < len(fitted))
        for index, (each, pair) in enumerate(zip(everywhere, errors, strict=True))
    )
    improved = _new_version(twin, after, [each.episode for each in fitted], options, seed)
    diagnosis = Diagnosis(
        outcome=found.outcome,
        effects=tuple(
            NamedEffect(name=each.name, parameters=each.parameters, episodes_agree=each.episodes_agree)
            for each in found.named
        ),
        ambiguous=found.ambiguous,
        candidates=_candidates(first, ground.measured, null),
        decisions=found.decisions,
        limits=_limits(ground, first, found.fitted),
        experiment=found.experiment,
        scale_m=first.before.scale,
        where=where(fitted, offsets, first.law.formula),
        error=error,
        seconds=time.monotonic() - started,
        reason=found.reason
        + _lost(each.episode.name for each in ground.lost)
        + why_not_looked_for(twin.model, fitted)
        + (_changed(error) if found.named else "")
        + _beaten(error),
        twin_id=twin.twin_id,
        improved_twin_id=improved.twin_id,
    )
    progress("done", 1.0)
    structure_gain = ground.problem.thresholds.structure_gain
    return Finding(
        diagnosis=diagnosis,
        twin=improved,
        before=before,
        evidence=_evidence(everywhere, errors, fitted[0], offsets[0], structure_gain),
        searches=found.searches,
    )


def fitted_and_validation(episodes: Sequence[Item]) -> tuple[Sequence[Item], Sequence[Item]]:
    """The episodes that a diagnosis fits, and the last ones, in which what it names has to show."""
    fitted = len(episodes) - len(episodes) // VALIDATION
    return episodes[:fitted], episodes[fitted:]


def _require_distinct(episodes: Sequence[Episode]) -> None:
    """Check that no episode counts twice.

    Raises:
        DiscrepancyError: two are the same, or have one name.
    """
    for index, one in enumerate(episodes):
        for other in episodes[:index]:
            if one.name == other.name or episode_digest(one) == episode_digest(other):
                raise DiscrepancyError(
                    f"{other.name} and {one.name} are the same episode, or have the same name; give each once, and "
                    "files of different names"
                )


def _observed(twin: Twin, observed: ObservedEpisode) -> TrackedEpisode:
    """The twin in an episode that lasts long enough.

    Raises:
        EpisodeError: no hand moves the object.
        DiscrepancyError: too little handling.
    """
    if observed.is_sparse:
        return observe_markers(twin, observed)
    if not any(hand.touches for hand in observed.hands):
        raise EpisodeError(f"{observed.name}: {why_unmoved(observed.episode)}. If it lies still there, {WHAT_TO_DO}")
    episode, observation = observed.episode, observe(replace(twin.model, effects=()), observed)
    handled = float(episode.times[-1] - episode.times[observation.touched])
    if handled < LEAST_MOTION_S:
        raise DiscrepancyError(
            f"{episode.name}: {handled:.2f} s of handling after first contact say nothing of what a twin lacks; "
            f"record some seconds of two motions: {WHAT_TO_DO}"
        )
    if not np.isfinite(observation.tracks.positions[observation.touched :]).any():
        raise DiscrepancyError(
            f"{episode.name}: no point is seen after the first contact (frame {observation.touched}); "
            "record again with the object in view"
        )
    return observation


def _lost(names: Iterable[str]) -> str:
    """What to add to a reason of episodes that could not be followed."""
    listed = ", ".join(names)
    return f"; without any effect the twin does not follow {listed}, so nothing was tried there" if listed else ""


def _changed(errors: Sequence[PredictionErrors]) -> str:
    """What to add to a reason of what is named: the predictions that it makes better, and those that it does not."""
    worse = [each for each in errors if each.track_after_m > each.track_before_m]
    better = [each for each in errors if each.track_after_m < each.track_before_m]
    parts = [
        f"{what} in "
        + ", ".join(
            f"{each.episode} ({1e3 * each.track_before_m:.2f} to {1e3 * each.track_after_m:.2f} mm)" for each in group
        )
        for what, group in (("better", better), ("worse", worse))
        if group
    ]
    return f"; with it free rollouts are {' and '.join(parts)}" if parts else ""


def _beaten(errors: Sequence[PredictionErrors]) -> str:
    """What to add to a reason of episodes that are predicted better without physics."""
    worse = [each for each in errors if each.follow_track_m < each.track_after_m]
    if not worse:
        return ""
    listed = ", ".join(
        f"{each.episode} ({1e3 * each.track_after_m:.0f} mm, {1e3 * each.follow_track_m:.0f} without physics)"
        for each in worse
    )
    return (
        f"; the improved twin predicts worse than points that move with the nearest hand in {listed}: do not plan such "
        "motions with it, but build it from one of these, too"
    )


def _limits(ground: Ground, first: Search, fitted: Fitted) -> tuple[DetectionLimit, ...]:
    """What the fitted episodes could have shown beside all that was found.

    Args:
        ground: what was measured.
        first: the search that probed the effects.
        fitted: how it ended; its first parameters are those of the baseline.
    """
    problem = ground.problem
    by_measurement = measured_limits(
        problem.observations,
        ground.measured,
        lies_flat=kind_of(fitted.model).lies_flat,
        thresholds=problem.thresholds,
    )
    return (*_searched_limits(problem, first, fitted), *by_measurement)


def _searched_limits(problem: DiagnosisProblem, first: Search, fitted: Fitted) -> tuple[DetectionLimit, ...]:
    """Those of effects that are searched for; none of one episode, which can name nothing."""
    count, own = len(problem.observations), len(first.before.parameters)
    if count < 2:
        return ()
    twin = replace(fitted, parameters=fitted.parameters[:own], jacobian=[each[..., :own] for each in fitted.jacobian])
    return detection_limits(
        linear_problem(twin.residuals, twin.jacobian, twin.scale),
        first.probes,
        needed_gain=problem.thresholds.gain_alone(fitted=count, validated=bool(problem.validation)),
        attained=AttainedGains(problem.observations, twin),
    )


def _candidates(first: Search, measured: Sequence[MeasuredEffect], null: NullGains) -> tuple[Candidate, ...]:
    """All effects: those that were measured, and those that were refitted, with the figures of that."""
    ranking, refitted = first.ranking, {each.name: each for each in first.refitted}
    found = [
        Candidate(
            name=each.name,
            held_out_gain=each.held_out_gain,
            p_null=each.p_null,
            fitted_gain=each.fitted_gain,
            validation_gain=each.validation_gain,
            values=each.values,
            criteria=each.criteria,
            is_measured=True,
        )
        for each in measured
    ]
    for linear in ranking.ranked:
        name = linear.name
        each: RankedEffect | RefittedEffect = refitted.get(name, linear)
        gain = each.gain if isinstance(each, RefittedEffect) else each.held_out_gain
        found.append(
            Candidate(
                name=name,
                held_out_gain=gain,
                p_null=null.p(gain),
                fitted_gain=each.fitted_gain,
                validation_gain=float(each.validation_gains.sum())
                if isinstance(each, RefittedEffect) and len(each.validation_gains)
                else None,
                values=each.values,
                criteria=first.criteria[name],
                is_measured=False,
            )
        )
    return tuple(sorted(found, key=lambda each: -each.held_out_gain))


def _new_version(
    twin: Twin, model: ObjectModel, episodes: Sequence[Episode], options: DiagnosisOptions, seed: int
) -> Twin:
    """The twin with another model, and whence it came."""
    return replace(
        twin,
        model=model,
        provenance=Provenance(
            episodes=tuple({"name": each.name, "sha256": episode_digest(each)} for each in episodes),
            settings=to_mapping(options),
            seed=seed,
            code_version=__version__,
            parent_id=twin.twin_id,
            scores={},
        ),
    )


def _evidence(
    observations: Sequence[TrackedEpisode],
    errors: Sequence[Sequence[FreeErrors]],
    first: TrackedEpisode,
    offsets: np.ndarray,
    mismatch_gain: float,
) -> Evidence:
    """What the report draws."""
    names = [each.episode.name for each in observations]
    seen = np.isfinite(offsets).all(axis=2)
    count = np.where(seen.any(axis=0), seen.sum(axis=0), np.nan)
    field = np.where(seen[..., None], offsets, 0.0).sum(axis=0) / count[:, None]
    return Evidence(
        times={name: each.episode.times for name, each in zip(names, observations, strict=True)},
        before={name: pair[0].track for name, pair in zip(names, errors, strict=True)},
        after={name: pair[1].track for name, pair in zip(names, errors, strict=True)},
        rest=first.rest,
        field=field,
        mismatch_gain=mismatch_gain,
    )
