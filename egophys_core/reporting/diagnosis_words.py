"""A diagnosis in words: the one sentence that someone who runs the robot reads first, and numbers as text."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeGuard

UNKNOWN = "-"
"""Shown where there is no number."""

NO_CHANGE = "0 %"
"""Less than half a per cent."""


@dataclass(frozen=True, kw_only=True)
class EffectText:
    """What a reader needs to know of an effect."""

    summary: str
    """What it is; what follows a colon or semicolon explains."""
    equation: str
    nulls: Mapping[str, float]
    """By parameter: its value where the effect vanishes; parameters that tell where or when have none."""

    @property
    def phrase(self) -> str:
        """The summary up to its explanation, for use within a sentence."""
        return self.summary.partition(":")[0].partition(";")[0]


@dataclass(frozen=True, kw_only=True)
class TrackErrors:
    """Mean track error over episodes, metres; None where a rollout diverged."""

    before: float | None
    after: float | None
    held_out: bool
    """Whether the episodes are those that were not fitted; with none of these they are those that were."""

    @property
    def whose(self) -> str:
        """Which episodes, for a sentence."""
        return "on episodes it was not fitted to" if self.held_out else "on the episodes it was fitted to"


def headline(content: Mapping[str, Any], texts: Mapping[str, EffectText]) -> str:
    """The outcome in one or two plain sentences.

    Args:
        content: of `diagnosis.json`.
        texts: per effect name; an effect without a text is called by its name.
    """
    names = [each["name"] for each in content["effects"]]
    phrases = [texts[name].phrase if name in texts else name for name in names]
    lacks, either = join(phrases, "and"), join(phrases, "or")
    gain = _gain(track_errors(content["error"]))
    match content["outcome"]:
        case "none":
            return f"No effect found: what the twin gets wrong looks like noise and a coarse model.{_left(content)}"
        case "named":
            return f"The twin lacks {_count(names)}: {lacks}. {gain}"
        case "ambiguous" if len(names) > 1:
            return f"The twin lacks something, and these recordings cannot tell what: {either}."
        case "ambiguous":
            return f"The twin lacks something, perhaps this: {lacks}. These recordings are too few to be sure."
        case "named_and_unexplained":
            return f"The twin lacks {_count(names)}: {lacks}. {gain} The rest has a cause that is not known."
        case "named_and_ambiguous":
            known = len(names) - len(content["ambiguous"])
            lacks, either = join(phrases[:known], "and"), join(phrases[known:], "or")
            return (
                f"The twin lacks {_count(names[:known])}: {lacks}. It lacks one more, and these recordings cannot tell "
                f"which: {either}. {gain}"
            )
        case _:
            return f"The twin is wrong in a way that no known effect explains.{_left(content)}"


def track_errors(errors: Sequence[Mapping[str, Any]]) -> TrackErrors:
    """Means over the episodes that were not fitted, or over all if every one was."""
    held_out = [each for each in errors if not each["fitted"]]
    before, after = ([each[f"track_{when}_m"] for each in held_out or errors] for when in ("before", "after"))
    return TrackErrors(before=_mean(before), after=_mean(after), held_out=bool(held_out))


def millimetres(metres: float | None) -> str:
    """A length for a table."""
    return f"{1000 * metres:.1f}" if finite(metres) else UNKNOWN


def change(before: float | None, after: float | None) -> str:
    """From before to after in per cent, with its sign."""
    if not finite(before) or not finite(after) or before <= 0.0:
        return UNKNOWN
    percent = round(100 * (after / before - 1))
    return f"{percent:+d} %" if percent else NO_CHANGE


def figures(value: float | None) -> str:
    """Any number with three figures."""
    return f"{value:.3g}" if finite(value) else UNKNOWN


def join(words: Sequence[str], last: str) -> str:
    """ "a, b and c"; semicolons where a word has a comma of its own."""
    if len(words) < 2:
        return "".join(words)
    if any("," in word for word in words):
        return f"{'; '.join(words[:-1])}; {last} {words[-1]}"
    return f"{', '.join(words[:-1])} {last} {words[-1]}"


def finite(value: float | None) -> TypeGuard[float]:
    """Whether there is a number."""
    return value is not None and abs(value) < float("inf")


def _count(names: Sequence[str]) -> str:
    return "one thing" if len(names) == 1 else f"{len(names)} things"


def _gain(errors: TrackErrors) -> str:
    if errors.before is None or errors.after is None:
        return "Without it or with it, the simulation does not stay stable to the end."
    verb = "falls" if errors.after < errors.before else "goes"
    return (
        f"With it, the error {errors.whose} {verb} from {millimetres(errors.before)} to {millimetres(errors.after)} mm."
    )


def _left(content: Mapping[str, Any]) -> str:
    errors = track_errors(content["error"])
    if errors.before is None:
        return ""
    return f" It is off by {millimetres(errors.before)} mm {errors.whose}."


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None and finite(value)]
    return sum(known) / len(known) if values and len(known) == len(values) else None
