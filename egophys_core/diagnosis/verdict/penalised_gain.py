"""What speaks for a candidate beside others, and when one explains clearly less than another."""

import numpy as np

from egophys_core.diagnosis.evidence.judging import RefittedEffect, interval_of_sum
from egophys_core.diagnosis.thresholds import Thresholds
from egophys_core.effects import effect_named

RESAMPLES = 500
"""Of the blocks, for the interval of a difference."""


def complexity_penalty(candidate: RefittedEffect, thresholds: Thresholds) -> float:
    """The gain that an effect's many parameters are asked for.

    What has a place, a time and a direction soaks up more of a mismatch.
    """
    return thresholds.parameter_gain * max(0, len(candidate.parameters) - thresholds.unpenalised_parameters)


def penalised_gain(candidate: RefittedEffect, thresholds: Thresholds) -> float:
    """Its gain less the complexity penalty, raised or lowered by validation episodes."""
    most = thresholds.validation_share * abs(candidate.gain)
    validated = float(np.clip(candidate.validation_gains.sum(), -most, most))
    return candidate.gain - complexity_penalty(candidate, thresholds) + validated


def needed_to_rival(candidate: RefittedEffect, best: RefittedEffect, thresholds: Thresholds) -> float:
    """The penalised gain from which a candidate is not told apart from the best."""
    needed = thresholds.rival_share * penalised_gain(best, thresholds)
    low, _ = interval_of_sum(best.block_gains - candidate.block_gains, RESAMPLES, seed=0)
    return max(needed, thresholds.equal_share * penalised_gain(best, thresholds)) if low > 0.0 else needed


def explains_less(candidate: RefittedEffect, best: RefittedEffect, thresholds: Thresholds) -> bool:
    """Whether a candidate explains clearly less than the best."""
    return penalised_gain(candidate, thresholds) < needed_to_rival(candidate, best, thresholds)


def simpler(name: str) -> set[str]:
    """Special cases of an effect that are simpler than it: not those that are one thing with it."""
    traits = effect_named(name).traits
    return set(traits.special_cases) - set(traits.equivalent_to)
