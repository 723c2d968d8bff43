"""The effects that ring-downs tell: whether a material relaxes, by how it swings that is let go in a clamp."""

from collections.abc import Sequence

import numpy as np

from egophys_core.diagnosis.criterion import Direction, compare
from egophys_core.diagnosis.diagnosis import Estimate
from egophys_core.diagnosis.direct.measured import MeasuredEffect, Recordings, measured
from egophys_core.diagnosis.direct.ring_down import RingDown, ring_down_of
from egophys_core.diagnosis.direct.ring_down_fit import (
    FLOOR,
    RingDownFit,
    counts,
    explained_ring_downs,
    fit_ring_downs,
    ring_down_gains,
)
from egophys_core.diagnosis.direct.surrogates import shifted_p
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.effects import Parameter, effect_named

OSCILLATES = 0.1
"""Of a ring-down's range, root mean square, that an oscillator may leave: what leaves more is none."""

SEEN_TO_END = 0.5
"""Of the shortest record, that relaxation may take: what goes on and on may as well be flow."""


def ring_down_effects(names: Sequence[str], recordings: Recordings) -> list[MeasuredEffect]:
    """What ring-downs tell of the effects of some names, where every record is one."""
    records = _told_by_ring_downs(recordings.fitted)
    if len(records) < len(recordings.fitted):
        return []
    before, after = explained_ring_downs(records), fit_ring_downs(records)
    return [_measured(name, records, before, after, recordings) for name in names]


def _measured(
    name: str, records: Sequence[RingDown], before: RingDownFit, after: RingDownFit, recordings: Recordings
) -> MeasuredEffect:
    """One effect whose material relaxes, held against an oscillator that does not."""
    held_out = []
    for index, own in enumerate(records):
        others = fit_ring_downs([*records[:index], *records[index + 1 :]])
        held_out.append(_gain([own], others.ratio, others.time))
    changes = [one - other for one, other in zip(before.left, after.left, strict=True)]
    lasting = [record.times[-1] for record in records]
    validation = _told_by_ring_downs(recordings.validation)
    left = [1e3 * float(np.sqrt(each.squares.mean())) for each in (before, after)]
    longest = SEEN_TO_END * min(lasting)
    what, because = "relaxation time", ", half of the shortest record, to be told from flow"
    return measured(
        name,
        parameters={each.name: _estimate(name, each, after) for each in effect_named(name).parameters},
        fitted_gain=float(ring_down_gains(records, before, after).sum()),
        held_out_gains=held_out,
        validation_gain=_gain(validation, after.ratio, after.time) if validation else None,
        p_null=shifted_p(before.left, changes, counts(records), lasting, floor=FLOOR, seed=recordings.seed),
        reason=f"{name} is measured in {len(records)} ring-downs: an oscillator is off them by {left[0]:.2f} mm "
        f"without it, by {left[1]:.2f} mm with it",
        thresholds=recordings.thresholds,
        further=(
            compare("seen_to_end", what, after.time, Direction.AT_MOST, float(longest), unit="s", because=because),
        ),
    )


def _estimate(name: str, parameter: Parameter, fit: RingDownFit) -> Estimate:
    """A parameter of the effect: how much relaxes, or, at whose bounds it is a damper, how fast."""
    which = "time" if parameter.name == effect_named(name).traits.degenerate_parameter else "ratio"
    return Estimate(value=getattr(fit, which), unit=parameter.unit, ci95=fit.ci95[which])


def _told_by_ring_downs(observations: Sequence[TrackedEpisode]) -> list[RingDown]:
    """The ring-downs of those records in which an object swings as an oscillator does."""
    found = [ring_down_of(each.observed.record) for each in observations if each.observed.is_sparse]
    records = [each for each in found if each is not None]
    most = [OSCILLATES * np.ptp(each.places) for each in records]
    return [
        each for each, bound in zip(records, most, strict=True) if explained_ring_downs([each]).squares[0] < bound**2
    ]


def _gain(records: Sequence[RingDown], ratio: float, time: float) -> float:
    """What given parameters gain in ring-downs."""
    return float(
        ring_down_gains(records, explained_ring_downs(records), explained_ring_downs(records, ratio, time)).sum()
    )
