"""What the best effect gains where nothing is lacking: learned from rehearsed sets, not assumed.

A refit from many starts finds more in a twin's own mismatch than surrogates of its slopes do: of 87 sets without an
effect surrogates said less than 0.05 in 43. The largest gain of such a set is spread like a lognormal number.
"""

import math
from dataclasses import dataclass
from statistics import NormalDist


@dataclass(frozen=True, kw_only=True)
class NullGains:
    """The largest gains of sets that lack nothing."""

    median: float
    """Log-likelihood."""
    spread: float
    """Standard deviation of their logarithms."""

    def p(self, gain: float) -> float:
        """Share of these sets in which some effect gains as much."""
        if gain <= 0.0:
            return 1.0
        return 0.5 * math.erfc((math.log(gain) - math.log(self.median)) / (self.spread * math.sqrt(2.0)))

    def gain_of(self, share: float) -> float:
        """The gain that such a share of them reaches."""
        return self.median * math.exp(self.spread * NormalDist().inv_cdf(1.0 - share))


RECORDED = NullGains(median=31.0, spread=0.74)
"""Of 20 rehearsed sheets, ellipsoids and boxes, three motions each (`benchmarks/results/injected.json`): between 9 and
172. Shapiro and Wilk's test finds nothing against a lognormal (0.77)."""

ASKED = NullGains(median=50.0, spread=0.63)
"""Where a motion was asked for that shows effects, which shows a twin's mismatch, too: of 9 diagnoses of 5 rehearsed
sheets and ellipsoids after one or two such motions (`calibrated_on` of `benchmarks/results/asked.json`): between 23 and
116."""


def null_gains(asked: int) -> NullGains:
    """Those of sets with so many motions that were asked for."""
    return ASKED if asked else RECORDED
