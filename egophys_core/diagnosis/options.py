"""Options of a diagnosis; the same names in YAML, on the command line and as ROS parameters."""

from dataclasses import dataclass

from egophys_core.options import number, validate


@dataclass(frozen=True, kw_only=True)
class DiagnosisOptions:
    """How much a diagnosis looks for, and how sure it must be."""

    baseline_starts: int = number(6, low=1, high=40, doc="graphs and grasps that are refitted before one is taken")
    refit_iterations: int = number(8, low=1, high=50, doc="most steps of each refit, with and without an effect")
    shortlist: int = number(5, low=1, high=24, doc="effects that are refitted after the linear ranking")
    surrogates: int = number(100, low=20, high=10_000, doc="shifted regressors that say what chance gains")
    bootstraps: int = number(500, low=50, high=10_000, doc="resamples of episodes and blocks for intervals")

    def __post_init__(self) -> None:
        validate(self)
