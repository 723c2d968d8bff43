"""A diagnosis problem: what stays the same over the searches of a diagnosis."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.diagnosis.thresholds import Thresholds
from egophys_core.diagnosis.tracked_episode import TrackedEpisode

Progress = Callable[[str, float], None]
"""Called with stage and share of the whole done (0..1); may raise to stop."""


@dataclass(frozen=True, kw_only=True)
class DiagnosisProblem:
    """Episodes, options and seed."""

    observations: Sequence[TrackedEpisode]
    """What is fitted."""
    validation: Sequence[TrackedEpisode]
    """Episodes that are not."""
    options: DiagnosisOptions
    seed: int
    thresholds: Thresholds = field(default_factory=Thresholds)
