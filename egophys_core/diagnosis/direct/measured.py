"""An effect that was measured directly, and the criteria that it is held against."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

from egophys_core.diagnosis.criterion import CriterionResult, Direction, compare, not_asked
from egophys_core.diagnosis.diagnosis import Estimate
from egophys_core.diagnosis.direct.grips import GripRecord, grips_of
from egophys_core.diagnosis.thresholds import Thresholds
from egophys_core.diagnosis.tracked_episode import TrackedEpisode
from egophys_core.effects import effect_named


@dataclass(frozen=True, kw_only=True)
class Recordings:
    """From what effects are measured, and how."""

    fitted: Sequence[TrackedEpisode]
    validation: Sequence[TrackedEpisode]
    """Episodes that are not fitted, in which an effect has to show, too."""
    lies_flat: bool
    """Whether the object lies flat when it lies."""
    resamples: int
    """For intervals."""
    seed: int
    """Of resamples and surrogates."""
    thresholds: Thresholds

    @cached_property
    def fitted_grips(self) -> list[list[GripRecord]]:
        """Of each fitted episode that has grips, those."""
        return [grips for grips in map(grips_of, self.fitted) if grips]

    @cached_property
    def validation_grips(self) -> list[GripRecord]:
        """Of all validation episodes."""
        return [grip for each in self.validation for grip in grips_of(each)]


@dataclass(frozen=True, kw_only=True)
class MeasuredEffect:
    """An effect that was measured directly, and shows or does not."""

    name: str
    parameters: dict[str, Estimate]
    fitted_gain: float
    held_out_gain: float
    """Each episode by the parameters of the others; of falls each of these, of a single one each half of its tracks."""
    validation_gain: float | None
    """In validation episodes; None without any."""
    p_null: float
    """How likely so large a gain is without it."""
    episodes_agree: bool
    """Whether it gains in all that was left out."""
    reason: str
    criteria: tuple[CriterionResult, ...]
    """What it was held against."""
    alike: tuple["MeasuredEffect", ...] = ()
    """Effects that explain what was measured about as well."""

    @property
    def shows(self) -> bool:
        """Whether it passes all of them: beyond chance, in what was left out, and in what was not fitted."""
        return all(each.passed for each in self.criteria)

    @property
    def values(self) -> dict[str, float]:
        """The parameters alone."""
        return {name: each.value for name, each in self.parameters.items()}


Estimator = Callable[[Sequence[str], Recordings], list[MeasuredEffect]]
"""Measures the effects of some names, if recordings tell them; nothing of those that they do not tell."""


def measured(
    name: str,
    *,
    parameters: dict[str, Estimate],
    fitted_gain: float,
    held_out_gains: Sequence[float],
    validation_gain: float | None,
    p_null: float,
    reason: str,
    thresholds: Thresholds,
    chance: str = "share of surrogates that gain as much",
    left_out: str = "an episode left out as a whole",
    further: Sequence[CriterionResult] = (),
) -> MeasuredEffect:
    """An effect with all of its criteria.

    Args:
        held_out_gains: of each episode by the parameters of the others.
        chance: what `p_null` is.
        left_out: of what each of these gains is.
        further: criteria of this way of measuring.
    """
    held_out_gain, least = float(sum(held_out_gains)), float(min(held_out_gains))
    both, what = min(fitted_gain, held_out_gain), "lesser of the fitted and the left-out gain"
    return MeasuredEffect(
        name=name,
        parameters=parameters,
        fitted_gain=fitted_gain,
        held_out_gain=held_out_gain,
        validation_gain=validation_gain,
        p_null=p_null,
        episodes_agree=least > 0.0,
        reason=reason,
        criteria=(
            compare("measured_gain", what, both, Direction.AT_LEAST, thresholds.measured_gain),
            compare("surrogates", chance, p_null, Direction.AT_MOST, thresholds.largest_p, unit="1"),
            compare("every_episode", f"least gain of {left_out}", least, Direction.ABOVE, 0.0),
            _validation(name, validation_gain),
            *further,
        ),
    )


def _validation(name: str, gain: float | None) -> CriterionResult:
    """Whether validation episodes do not speak against it."""
    what = "gain in validation episodes"
    if gain is None:
        return not_asked("validation", f"{what}: there are none")
    if effect_named(name).traits.is_event:
        return not_asked("validation", f"{what}: not asked of what happens in some episodes only")
    return compare("validation", what, gain, Direction.ABOVE, 0.0)
