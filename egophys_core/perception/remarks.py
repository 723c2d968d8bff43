"""What was looked at in a video, how good it is, and what to film differently: lines that a user acts on."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

KEEP_THE_BOARD = "lay the printed board (`egophys board`) flat beside the object, wholly in view and lit, all the time"
RECALIBRATE = "calibrate at the setting you film with: `egophys calibrate-camera`, then give --intrinsics"
NAME_IT = 'take other things off the table, or say which one: --object "x y", pixels of the picture\'s first view'
MARK_IT = "use an object with a pattern, or put dots, stripes or stickers on it; light from the side helps a knit"
HANDLE_IT = "handle the object in view: without a hand there is nothing to fit"
"""What to do differently, said by more than one look at a video."""


def rest_first(still_s: float) -> str:
    """What to do where the object does not rest for so many seconds at first."""
    return f"do not touch the object for the first {max(still_s, 1):g} to 2 s, and wait until it lies still"


class Level(StrEnum):
    """How good something is, the best first."""

    OK = "ok"
    DOUBTFUL = "doubtful"
    BAD = "bad"


@dataclass(frozen=True, kw_only=True)
class Remark:
    """One thing that was looked at."""

    name: str
    """A word or two."""
    level: Level
    """How good it is."""
    text: str
    """What was measured, with its unit."""
    advice: str = ""
    """What to do; empty where all is well."""


def graded(name: str, value: float, *, ok: float, bad: float, text: str, advice: str) -> Remark:
    """A remark by one number.

    Args:
        name: of the remark.
        value: measured; NaN is bad.
        ok: from here on all is well; smaller than `bad` where little is good.
        bad: from here on it is bad.
        text: of the remark.
        advice: unless it is ok.
    """
    sign = 1.0 if ok > bad else -1.0
    if sign * value >= sign * ok:
        return Remark(name=name, level=Level.OK, text=text)
    level = Level.DOUBTFUL if sign * value > sign * bad else Level.BAD
    return Remark(name=name, level=level, text=text, advice=advice)


def worst(remarks: Sequence[Remark]) -> Level:
    """The worst level there is; OK of none."""
    levels = list(Level)
    return max((each.level for each in remarks), key=levels.index, default=Level.OK)


def verdict_of(remarks: Sequence[Remark]) -> str:
    """`good`, `usable` or `poor`: as its worst remark is."""
    return {Level.OK: "good", Level.DOUBTFUL: "usable", Level.BAD: "poor"}[worst(remarks)]


def sentences(remarks: Sequence[Remark], level: Level) -> str:
    """What is as bad as this and what to do about it, in one text."""
    return "; ".join(f"{each.text}: {each.advice}" for each in remarks if each.level == level)
