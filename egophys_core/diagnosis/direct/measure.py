"""Effects that are measured directly, before any physics of the object.

Grips tell whether the record of the hands is early, too small or too large, and whether the object slips; what lies
flat tells whether the tracking frame is level; what hangs, where gravity points in it; what falls, all that pulls at
it, and the air; what swings in a clamp, whether its material relaxes. The twin, which is never right, has no part in
it.
"""

from collections.abc import Collection, Sequence

from egophys_core.diagnosis.diagnosis import DetectionLimit
from egophys_core.diagnosis.direct.free_fall_effects import fall_limits, free_fall_effects, measured_by_falls
from egophys_core.diagnosis.direct.grip_effects import grip_effects
from egophys_core.diagnosis.direct.grip_limits import grip_limits
from egophys_core.diagnosis.direct.measured import Estimator, MeasuredEffect, Recordings
from egophys_core.diagnosis.direct.plumb_line import plumb_line_effects
from egophys_core.diagnosis.direct.ring_down_effects import ring_down_effects
from egophys_core.diagnosis.direct.table_level import table_level_effects
from egophys_core.diagnosis.thresholds import Thresholds
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.effects import LIBRARY, effect_named
from egophys_core.effects.traits import Measurement

ESTIMATORS: dict[Measurement, Estimator] = {
    Measurement.TABLE_LEVEL: table_level_effects,
    Measurement.PLUMB_LINE: plumb_line_effects,
    Measurement.GRIPS: grip_effects,
    Measurement.FREE_FALL: free_fall_effects,
    Measurement.RING_DOWN: ring_down_effects,
}
"""How each kind of measurement is made, of whatever effects say that they are measured by it."""


def measured_limits(
    observations: Sequence[TrackedEpisode],
    measured: Sequence[MeasuredEffect],
    *,
    lies_flat: bool,
    thresholds: Thresholds,
) -> list[DetectionLimit]:
    """How large the effects must be that grips and falls tell, beside those that show.

    Args:
        observations: what was measured.
        measured: what was found there.
        lies_flat: whether the object lies flat when it lies.
        thresholds: what an effect must reach.
    """
    recordings = Recordings(
        fitted=observations, validation=(), lies_flat=lies_flat, resamples=0, seed=0, thresholds=thresholds
    )
    by_grips = [each for each in measured if Measurement.GRIPS in effect_named(each.name).traits.measured_by]
    known = {each.name: each.values for each in by_grips if each.shows}
    by_falls = measured_by_falls([each.name for each in measured])
    return [
        *(grip_limits([each.name for each in by_grips], known, recordings) if by_grips else []),
        *fall_limits(by_falls, observations, lies_flat=lies_flat, needed=thresholds.measured_gain),
    ]


def measure(
    observations: Sequence[TrackedEpisode],
    validation: Sequence[TrackedEpisode],
    *,
    lies_flat: bool,
    without: Collection[str],
    resamples: int,
    seed: int,
    thresholds: Thresholds | None = None,
) -> list[MeasuredEffect]:
    """The effects that two episodes or more tell directly: those that show, the clearest first, and those that do not.

    Args:
        observations: what is fitted.
        validation: episodes that are not, in which an effect has to show, too.
        lies_flat: whether the object lies flat when it lies.
        without: names of effects that are left out.
        resamples: for intervals.
        seed: of resamples and surrogates.
        thresholds: what an effect must reach; by default those of the project.
    """
    if len(observations) < 2:
        return []
    recordings = Recordings(
        fitted=observations,
        validation=validation,
        lies_flat=lies_flat,
        resamples=resamples,
        seed=seed,
        thresholds=thresholds or Thresholds(),
    )
    found = list[MeasuredEffect]()
    for measurement, estimate in ESTIMATORS.items():
        known = {*without, *(each.name for each in found)}
        names = [
            effect.name
            for effect in LIBRARY.values()
            if measurement in effect.traits.measured_by and effect.name not in known
        ]
        found += estimate(names, recordings) if names else []
    return sorted(found, key=lambda each: (not each.shows, -each.fitted_gain))
