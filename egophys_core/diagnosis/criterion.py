"""One criterion that a candidate was held against: what was found, what was asked, and whether it passed."""

from dataclasses import dataclass
from enum import StrEnum


class Direction(StrEnum):
    """On which side of its threshold a statistic passes."""

    AT_LEAST = "at least"
    ABOVE = "more than"
    AT_MOST = "at most"
    BELOW = "less than"


@dataclass(frozen=True, kw_only=True)
class CriterionResult:
    """The result of one named test of one candidate."""

    name: str
    sentence: str
    """What was found and what was asked, with the numbers."""
    statistic: float | None
    """In `unit`; None where the criterion has no number, or does not apply."""
    direction: Direction
    threshold: float | None
    """In `unit`."""
    unit: str
    """Of statistic and threshold; "1" for counts and shares."""
    applied: bool
    """Whether the criterion was asked of this candidate."""
    passed: bool
    """True as well where it was not asked."""


def compare(
    name: str,
    what: str,
    statistic: float,
    direction: Direction,
    threshold: float,
    *,
    unit: str = "log-likelihood",
    because: str = "",
) -> CriterionResult:
    """A statistic held against its threshold; one that is no number passes nothing.

    Args:
        what: the statistic in words.
        because: what the threshold follows from, or what passing would mean.
    """
    passed = {
        Direction.AT_LEAST: statistic >= threshold,
        Direction.ABOVE: statistic > threshold,
        Direction.AT_MOST: statistic <= threshold,
        Direction.BELOW: statistic < threshold,
    }[direction]
    shown = "" if unit in ("1", "log-likelihood") else f" {unit}"
    return CriterionResult(
        name=name,
        sentence=f"{what} {_figures(statistic)}{shown}, needs {direction} {_figures(threshold)}{shown}{because}",
        statistic=float(statistic),
        direction=direction,
        threshold=float(threshold),
        unit=unit,
        applied=True,
        passed=bool(passed),
    )


def state(name: str, sentence: str, *, passed: bool) -> CriterionResult:
    """A criterion without a number."""
    return CriterionResult(
        name=name,
        sentence=sentence,
        statistic=None,
        direction=Direction.AT_LEAST,
        threshold=None,
        unit="1",
        applied=True,
        passed=passed,
    )


def not_asked(name: str, sentence: str) -> CriterionResult:
    """A criterion that does not apply to this candidate."""
    return CriterionResult(
        name=name,
        sentence=sentence,
        statistic=None,
        direction=Direction.AT_LEAST,
        threshold=None,
        unit="1",
        applied=False,
        passed=True,
    )


def _figures(value: float) -> str:
    """Three figures, whole numbers from 100 on, and no sign of a zero."""
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
