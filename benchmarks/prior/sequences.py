"""Which sequences the set consists of: objects, what hands do with them, and which are learned from.

No object of the held-out part is in the training part. Only held out are round cloths and toys of two lobes, and the
motions fold, double_pull and shake.
"""

from dataclasses import dataclass
from enum import StrEnum

from benchmarks.prior.objects import Shape
from benchmarks.prior.variations import Variation
from egophys_core.rehearsal import Motion


class Split(StrEnum):
    """What a sequence is for."""

    TRAINING = "training"
    HELD_OUT = "held_out"


@dataclass(frozen=True, kw_only=True)
class Sequence:
    """One handling of one object, and all that it is made from."""

    name: str
    """Of its episode's folder."""
    split: Split
    shape: Shape
    variation: Variation
    object_seed: int
    """Of the object; with shape and variation it is the object."""
    motion: Motion
    seed: int
    """Of the motion's details and of what is seen."""
    paper: bool
    """Whether it stands for one of the 8 and 11 sequences of the paper (its Tab. "dataset split")."""


TRAINING = """
towel    hem       lift         pull
towel    patch     pull         hang
towel    seam      double_lift  lift
towel    lining    lift         hang
towel    stuffing  pull         double_lift
towel    hem       hang         double_lift
towel    uniform   lift         pull
towel    uniform   double_lift  pull
towel    patch     lift         double_lift
mitt     lining    lift*        pull
mitt     lining    hang         double_lift
mitt     hem       lift         pull
mitt     stuffing  double_lift  lift
mitt     uniform   pull         lift
toy      core      double_lift* pull
toy      stuffing  double_lift* lift
toy      stuffing  lift*        push
toy      core      lift*        pull
toy      lining    pull*        lift
toy      stuffing  pull*        hang
toy      seam      lift         double_lift
toy      uniform   lift         push
toy      patch     push         lift
cushion  stuffing  lift         push
cushion  core      push         double_lift
cushion  lining    pull         lift
cushion  uniform   double_lift  pull
bag      skin      push*        lift
bag      skin      lift         pull
bag      stuffing  lift         push
bag      lining    double_lift  pull
bag      uniform   push         lift
"""
"""An object a line: shape, variation, two motions; * where the paper has one like it."""

HELD_OUT = """
towel          hem       fold*        lift
towel          patch     double_pull* hang
towel          lining    lift*        shake
round_cloth    hem       lift         pull
round_cloth    stuffing  fold         double_lift
mitt           lining    shake        pull
mitt           patch     lift         double_pull
toy            core      double_lift* lift*
toy            stuffing  lift*        pull*
toy            lining    pull*        push*
toy            stuffing  push*        shake
toy            uniform   push*        lift
two_lobed_toy  stuffing  lift         double_pull
two_lobed_toy  core      pull         double_lift
cushion        stuffing  fold         lift
bag            skin      shake        push
bag            uniform   lift         double_pull
"""

FIRST_OBJECT_SEED = {Split.TRAINING: 1000, Split.HELD_OUT: 2000}


def _listed(table: str, split: Split) -> tuple[Sequence, ...]:
    sequences = []
    for object_seed, line in enumerate(table.strip().splitlines(), FIRST_OBJECT_SEED[split]):
        shape, variation, *motions = line.split()
        for number, motion in enumerate(motions):
            sequences.append(
                Sequence(
                    name=f"{shape}_{object_seed}_{motion.rstrip('*')}",
                    split=split,
                    shape=Shape(shape),
                    variation=Variation(variation),
                    object_seed=object_seed,
                    motion=Motion(motion.rstrip("*")),
                    seed=10 * object_seed + number,
                    paper=motion.endswith("*"),
                )
            )
    return tuple(sequences)


SEQUENCES = _listed(TRAINING, Split.TRAINING) + _listed(HELD_OUT, Split.HELD_OUT)
"""64 of training, then 34 held out; no two of one name."""
