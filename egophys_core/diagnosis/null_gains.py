"""What the best effect gains where nothing is lacking: learned from rehearsed sets, not assumed.

A refit from many starts finds more in a twin's own mismatch than surrogates of its slopes do: of 87 sets without an
effect surrogates said less than 0.05 in 43. The largest gain of such a set is spread exponentially: twice what a
likelihood gains by needless parameters is chi-squared (Wilks, 1938), and a mismatch that blocks of time and patches
share makes all of it so many times larger.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class NullGains:
    """The largest gains of sets that lack nothing."""

    mean: float
    """Log-likelihood."""

    def p(self, gain: float) -> float:
        """Share of these sets in which some effect gains as much."""
        return math.exp(-max(gain, 0.0) / self.mean)

    def gain_of(self, share: float) -> float:
        """The gain that such a share of them reaches."""
        return -self.mean * math.log(share)


RECORDED = NullGains(mean=41.0)
"""Of 20 rehearsed sheets, ellipsoids and boxes, three motions each (`benchmarks/results/injected.json`): between 9 and
172."""

ASKED = NullGains(mean=60.0)
"""Where a motion was asked for that shows effects, which shows a twin's mismatch, too: of 15 diagnoses of 11 rehearsed
sheets and ellipsoids after one or two such motions (`calibrated_on` of `benchmarks/results/asked.json`): between 7 and
159. By it the p of 25 other sets are even (0.77 by Kolmogorov and Smirnov; 0.02 by a lognormal learned from nine)."""


def null_gains(asked: int) -> NullGains:
    """Those of sets with so many motions that were asked for."""
    return ASKED if asked else RECORDED
