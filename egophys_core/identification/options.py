"""Options of the fit; the same names in YAML, on the command line and as ROS parameters."""

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from egophys_core.options import choice, number, validate

if TYPE_CHECKING:
    from egophys_core.twin import ObjectKind


class KindChoice(StrEnum):
    """What the user says of the object."""

    AUTO = "auto"
    SHEET = "sheet"
    SOLID = "solid"

    @property
    def kind(self) -> "ObjectKind | None":
        """The kind, or None to find it from the shape."""
        # The twin loads scipy, which the options, read for every `--help`, do without.
        from egophys_core.twin import ObjectKind

        return None if self is KindChoice.AUTO else ObjectKind(self.value)


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """How a twin is fitted to episodes."""

    generations: int = number(50, low=1, high=10_000, doc="generations of CMA-ES")
    population: int = number(0, low=0, high=1000, doc="candidates per generation; 0 is the default of CMA-ES")
    step_size: float = number(0.2, low=0.01, high=1.0, doc="initial step of CMA-ES in normalised coordinates")
    frame_stride: int = number(2, low=1, high=30, doc="every how many-th train frame the loss looks at")
    dense_steps: int = number(25, low=0, high=10_000, doc="steps of dense refinement after the search; 0 is none")
    dense_rate: float = number(0.1, low=1e-4, high=1.0, doc="step of dense refinement in logarithms of stiffness")
    max_nodes: int = number(400, low=4, high=5000, doc="most surface nodes of the graph")
    kind: KindChoice = choice(KindChoice.AUTO, doc="sheet, solid, or auto to tell by the shape")  # noqa: RUF009

    def __post_init__(self) -> None:
        validate(self)
