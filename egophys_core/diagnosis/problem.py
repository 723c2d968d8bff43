"""An inquiry: what stays the same over the searches of a diagnosis."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from egophys_core.diagnosis.evidence.residuals import Observation
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.diagnosis.verdict.thresholds import Thresholds

Progress = Callable[[str, float], None]
"""Called with stage and share of the whole done (0..1); may raise to stop."""


@dataclass(frozen=True, kw_only=True)
class Inquiry:
    """Episodes, options and seed."""

    observations: Sequence[Observation]
    """What is fitted."""
    proofs: Sequence[Observation]
    """Episodes that are not."""
    options: DiagnosisOptions
    seed: int
    thresholds: Thresholds = field(default_factory=Thresholds)
