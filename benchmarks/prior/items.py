"""All episodes of the comparison: the rehearsed set, and what was recorded elsewhere and is never trained on."""

from dataclasses import dataclass
from pathlib import Path

from benchmarks.prior.dataset import place
from benchmarks.prior.sequences import SEQUENCES, Split

RECORDED = Path(__file__).resolve().parents[3] / "shared/data"
RECORDED_SETS = ("open", "blind")

TOWEL_LIKE = ("towel", "cloth", "mitt")
"""In the names of items that are thin."""


@dataclass(frozen=True, kw_only=True)
class Item:
    """One episode."""

    name: str
    path: Path
    split: Split
    group: str
    """`rehearsed`, or the set that it was recorded in."""
    object_seed: int
    """Of a rehearsed one; -1 of others."""
    paper: bool
    """Whether it stands for one of the paper's sequences."""


def all_items(data: Path) -> list[Item]:
    """Training items, then held-out ones, then recorded ones where they are there."""
    rehearsed = [
        Item(
            name=each.name,
            path=place(each, data),
            split=each.split,
            group="rehearsed",
            object_seed=each.object_seed,
            paper=each.paper,
        )
        for each in SEQUENCES
    ]
    recorded = [
        Item(
            name=".".join(path.with_suffix("").parts[-3:]),
            path=path,
            split=Split.HELD_OUT,
            group=group,
            object_seed=-1,
            paper=False,
        )
        for group in RECORDED_SETS
        for path in sorted((RECORDED / group).glob("*/episode_*.mcap"))
    ]
    return [*(each for each in rehearsed if each.split is Split.TRAINING), *_held_out(rehearsed), *recorded]


def _held_out(items: list[Item]) -> list[Item]:
    """Those of the paper first, since a part of the table shall have all of them."""
    return sorted((each for each in items if each.split is Split.HELD_OUT), key=lambda each: not each.paper)
