"""The loop: diagnose, choose a motion, have it done in a world, and diagnose again with what was recorded of it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from egophys_core.diagnosis.diagnose import Finding, diagnose
from egophys_core.diagnosis.diagnosis import NamedEffect, Outcome
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.diagnosis.thresholds import Thresholds
from egophys_core.effects import effect_named
from egophys_core.errors import PlanningError
from egophys_core.experiments.choice import Proposal, choose
from egophys_core.experiments.family import HandLimits
from egophys_core.experiments.open_questions import open_questions
from egophys_core.observation import AnyEpisode
from egophys_core.twin import Twin

LEAST_SCORE = 0.1
"""Of a proposal: what would lower limits by less than a tenth is not worth a motion."""

World = Callable[[Proposal, int], AnyEpisode]
"""Does a motion with the object, the how manieth, and records it."""

Progress = Callable[[str, float], None]


@dataclass(frozen=True, kw_only=True)
class Asked:
    """One round of the loop."""

    proposal: Proposal
    """What was done."""
    before: Finding
    """The diagnosis that left it open."""


@dataclass(frozen=True, kw_only=True)
class Conclusion:
    """How the loop ended."""

    finding: Finding
    """The last diagnosis, of all that was recorded."""
    recorded: tuple[AnyEpisode, ...]
    """These, in the order in which they were diagnosed."""
    asked: tuple[Asked, ...]
    """What was asked, in order."""
    ended: str
    """Why nothing more was asked, in words."""


def diagnose_and_ask(
    twin: Twin,
    episodes: Sequence[AnyEpisode],
    options: DiagnosisOptions,
    world: World | None,
    *,
    most: int,
    limits: HandLimits,
    loads: Mapping[str, float] | None = None,
    report_on: Sequence[AnyEpisode] = (),
    without: Sequence[str] = (),
    seed: int = 0,
    progress: Progress = lambda stage, share: None,
) -> Conclusion:
    """Diagnose, and as long as that does not decide ask for a motion and diagnose again.

    What residuals of the first recordings alone name has to hold in one motion that is asked for, if one may be: the
    mismatch of a sheet (57618) was named a repulsion there, with a gain of 173, in place of a tilt.

    Of the recordings those that were asked for come first, and the last third of all is not fitted: so what is named
    has to show in what was there before, too.

    Args:
        twin: to diagnose, as built.
        episodes: what was recorded before.
        options: of each diagnosis.
        world: does motions; None where nobody does: then nothing is asked.
        most: motions to ask for at most.
        limits: what hands can do.
        loads: N that hang at the free end of an object that is seen at a few markers, by name of the episode.
        report_on: episodes that have no part in it.
        without: effects of the library to leave out.
        seed: of each diagnosis.
        progress: called with stage and share done.

    Raises:
        EgophysError: as `diagnose`, or as the world does.
    """
    recorded, asked, rounds = list(episodes), list[Asked](), 1 + 2 * most

    def part(index: int) -> Progress:
        return lambda stage, share: progress(stage, (index + share) / rounds)

    def look(index: int) -> Finding:
        return diagnose(
            twin,
            recorded,
            options,
            asked=len(asked),
            loads=loads,
            report_on=report_on,
            without=without,
            seed=seed,
            progress=part(index),
        )

    finding, ended = look(0), ""
    while not ended:
        decided, may_ask = is_decided(finding), world is not None and len(asked) < most
        if decided and (asked or not may_ask or not rests_on_residuals(finding)):
            ended = "it is decided"
        elif world is None or not may_ask:
            ended = f"{len(asked)} motions were asked for, as many as allowed"
        else:
            proposal, refused = next_motion(
                finding,
                limits,
                without=without,
                done=[each.proposal.motion.name for each in asked],
                progress=part(2 * len(asked) + 1),
            )
            if proposal is None:
                ended = f"it is decided, and not asked about: {refused}" if decided else refused
            else:
                asked.append(Asked(proposal=proposal, before=finding))
                recorded.insert(0, world(proposal, len(asked)))
                finding = look(2 * len(asked))
    return Conclusion(
        finding=finding,
        recorded=tuple(recorded),
        asked=tuple(asked),
        ended=ended + _no_longer_named(asked, finding),
    )


def _no_longer_named(asked: Sequence[Asked], finding: Finding) -> str:
    """What to add to the end of a loop of effects that were named on the way and are not any more."""
    named = {each.name for each in finding.diagnosis.effects}
    before = {each.name: None for one in asked for each in one.before.diagnosis.effects if each.name not in named}
    return f"; no longer named with what was asked for: {', '.join(before)}" if before else ""


def is_decided(finding: Finding) -> bool:
    """Whether a diagnosis names what the twin lacks, and no motion would tell more.

    Effects that are one thing in every motion, as a steady force to the side and a tilted gravity, are all that can be
    said. To ask on would be for motions in which they look different because nothing is followed there: after two such
    swings a tilt was lost that had been found.
    """
    diagnosis = finding.diagnosis
    open_ones = diagnosis.ambiguous
    return diagnosis.outcome is Outcome.NAMED or (
        bool(open_ones) and _are_one_thing([each for each in diagnosis.effects if each.name in open_ones])
    )


def rests_on_residuals(finding: Finding) -> bool:
    """Whether a diagnosis names an effect that was not measured directly."""
    diagnosis = finding.diagnosis
    measured = {each.name for each in diagnosis.candidates if each.is_measured}
    return any(each.name not in measured for each in diagnosis.effects)


def _are_one_thing(effects: Sequence[NamedEffect]) -> bool:
    """Whether effects, with the values that were found, are the same in every motion."""
    traits = {each.name: effect_named(each.name).traits for each in effects}
    return all(
        traits.keys() - {each.name} <= set(traits[each.name].equivalent_to)
        and traits[each.name].is_horizontal(each.values)
        for each in effects
    )


def next_motion(
    finding: Finding,
    limits: HandLimits,
    *,
    without: Sequence[str] = (),
    done: Sequence[str] = (),
    progress: Progress = lambda stage, share: None,
) -> tuple[Proposal | None, str]:
    """The motion to do next, or why there is none.

    Args:
        finding: what is known, and the twin that follows from it.
        limits: what hands can do.
        without: effects that are not asked about.
        done: names of motions that were asked for already.
        progress: called with stage and share done.
    """
    questions = open_questions(finding.diagnosis.as_dict())
    try:
        (best,) = choose(
            finding.twin,
            [name for name in questions.effects if name not in without],
            limits,
            known=questions.limits,
            rivals=questions.ambiguous,
            done=done,
            needed_gain=Thresholds().least_gain,
            least_scale=questions.scale_m,
            most=1,
            progress=progress,
        )
    except PlanningError as error:
        return None, str(error)
    if best.score < LEAST_SCORE:
        return None, "no motion that hands can do would show much smaller effects"
    return best, ""
