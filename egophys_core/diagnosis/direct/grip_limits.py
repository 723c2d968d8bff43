"""How large what grips tell must be to show: a size is put into the tracks that are held; what does it gain there?"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from egophys_core.diagnosis.diagnosis import DetectionLimit
from egophys_core.diagnosis.direct.grip_fit import explained, gains
from egophys_core.diagnosis.direct.grips import GripRecord, held_displacements
from egophys_core.diagnosis.direct.measured import Recordings
from egophys_core.diagnosis.direct.size_limits import size_limits
from egophys_core.effects import Effect


def grip_limits(
    names: Sequence[str], known: Mapping[str, Mapping[str, float]], recordings: Recordings
) -> list[DetectionLimit]:
    """The limit of every size of some effects beside what is known; nothing without grips in two episodes.

    Args:
        names: of effects.
        known: values by effect and parameter of those that show.
        recordings: the episodes.
    """
    if recordings.fitted[0].observed.is_sparse:
        return []
    episodes = recordings.fitted_grips
    if len(episodes) < 2:
        return []
    grips = [grip for each in episodes for grip in each]
    return limits_in_grips(grips, names, known, needed=recordings.thresholds.measured_gain)


def limits_in_grips(
    grips: Sequence[GripRecord], names: Sequence[str], known: Mapping[str, Mapping[str, float]], *, needed: float
) -> list[DetectionLimit]:
    """The same of given grips.

    Args:
        grips: of all episodes.
        names: of effects.
        known: values by effect and parameter.
        needed: gain in log-likelihood from which an effect shows.
    """

    def gain(effect: Effect, size: str, off: float) -> float:
        return _gain(grips, effect, size, off, known)

    return size_limits(names, gain, needed=needed, one_thing=False)


def _gain(
    grips: Sequence[GripRecord], effect: Effect, size: str, off: float, known: Mapping[str, Mapping[str, float]]
) -> float:
    """What an effect of a size gains in grips into which it was put, held against the same without it."""
    injected = [_with_effect(grip, effect, size, off, known) for grip in grips]
    before = explained([grip for grip, _ in injected], known)
    after = [explained([grip], {**known, effect.name: values}).squares[0] for grip, values in injected]
    return float(gains(grips, before, replace(before, squares=np.array(after))).sum())


def _with_effect(
    grip: GripRecord, effect: Effect, size: str, off: float, known: Mapping[str, Mapping[str, float]]
) -> tuple[GripRecord, dict[str, float]]:
    """The grip as it would be with so much more of an effect than is known, from its middle on if it begins at a time;
    and the values that explain that."""
    there = dict(known.get(effect.name, {}))
    values = {
        each.name: there.get(each.name, float(grip.times.mean()) if each.null is None else each.null)
        for each in effect.parameters
    }
    values[size] += off
    apart = held_displacements(grip, {**known, effect.name: values}) - held_displacements(grip, known)
    return replace(grip, tracks=grip.tracks + apart), values
