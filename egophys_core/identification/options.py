"""Options of the fit; the same names in YAML, on the command line and as ROS parameters."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from egophys_core.errors import OptionsError
from egophys_core.options import choice, number, text, to_mapping, validate

AUTO = "auto"

OF_MARKERS = ("template", "density")
"""Options of objects that are seen at a few markers; the others are of those whose surface is seen."""


class StiffnessOption(StrEnum):
    """How stiff the springs of a twin are."""

    UNIFORM = "uniform"
    """All of a kind alike, as the search finds it."""
    DENSE = "dense"
    """Each by itself, by gradients from there."""
    CODEBOOK = "codebook"
    """By the prior, anchored there."""


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """How a twin is fitted to episodes."""

    generations: int = number(50, low=1, high=10_000, doc="generations of CMA-ES")
    population: int = number(
        0, low=0, high=1000, doc="candidates per generation; 0 is what CMA-ES takes, and more where they cost nothing"
    )
    step_size: float = number(0.2, low=0.01, high=1.0, doc="initial step of CMA-ES in normalised coordinates")
    frame_stride: int = number(2, low=1, high=30, doc="every how many-th train frame the loss looks at")
    dense_steps: int = number(25, low=0, high=10_000, doc="steps of dense refinement after the search; 0 is none")
    dense_rate: float = number(0.1, low=1e-4, high=1.0, doc="step of dense refinement in logarithms of stiffness")
    stiffness: StiffnessOption = choice(  # noqa: RUF009
        StiffnessOption.DENSE,
        doc="of springs: uniform as the search finds it, dense by gradients for each, or by the learned codebook",
    )
    prior: str = text("", doc="checkpoint of the codebook; without one that of the project")
    max_nodes: int = number(400, low=4, high=5000, doc="most surface nodes of the graph")
    kind: str = text(AUTO, doc="kind of object by its name, as sheet or solid, or auto to tell by what is seen")

    template: str = text(
        "",
        doc="of an object that is seen at a few markers: box:LxWxH or an .obj or .stl file, in metres; without one a "
        "rod along markers that lie one after the other, else a bar from the held points to the markers",
    )
    density: float = number(
        1000.0, low=1.0, high=30_000.0, doc="of such an object, kg/m^3; gives a load in newtons its meaning"
    )

    def __post_init__(self) -> None:
        validate(self)
        if self.prior and self.stiffness is not StiffnessOption.CODEBOOK:
            raise OptionsError(
                f"prior {self.prior} is used for stiffness codebook only, not {self.stiffness}; choose codebook, "
                "or leave prior out"
            )
        if self.population == 1:
            raise OptionsError(
                "population must be 0 or in 2 .. 1000, got 1: CMA-ES learns from more than one candidate"
            )
        if self.kind != AUTO:
            # Kinds load SciPy, which the options, read for every `--help`, do without.
            from egophys_core.kinds import KINDS

            if self.kind not in KINDS:
                raise OptionsError(f"kind must be one of {', '.join((AUTO, *KINDS))}, got {self.kind!r}")

    @property
    def named_kind(self) -> str | None:
        """The kind that the user says it is, None to tell by what is seen."""
        return None if self.kind == AUTO else self.kind

    def settings(self, *, at_markers: bool) -> dict[str, Any]:
        """Names and plain values of the options that decide a fit, for provenance.

        Args:
            at_markers: whether the object is seen at a few markers, not all over its surface.
        """
        return {name: value for name, value in to_mapping(self).items() if (name in OF_MARKERS) == at_markers}
