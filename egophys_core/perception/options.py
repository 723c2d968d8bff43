"""Options of perception."""

from dataclasses import dataclass
from enum import StrEnum

from egophys_core.errors import OptionsError
from egophys_core.options import choice, number, text, validate


class ObjectKind(StrEnum):
    """What the object is taken for."""

    AUTO = "auto"
    """A sheet if it lies flat at rest, else a solid."""
    SHEET = "sheet"
    SOLID = "solid"


class Completion(StrEnum):
    """What is done about the side of a solid that is never seen."""

    SYMMETRIC = "symmetric"
    """The visible side turned about the middle of the body."""
    GENERATED = "generated"
    """What TRELLIS makes of the first view; a learned stage, that needs the others."""
    NONE = "none"


class Stages(StrEnum):
    """What finds masks, tracks and depth."""

    CLASSICAL = "classical"
    """Colours, patches and parallax: no weights."""
    LEARNED = "learned"
    """Grounding DINO with SAM 2, CoTracker3 and VGGT, as in the paper; hand and object are in view throughout."""


class HandCue(StrEnum):
    """What tells where a hand holds or pushes, and how deep in the view it is."""

    SHAPE = "shape"
    """The outline of the arm: no weights; also gloves and grippers."""
    MEDIAPIPE = "mediapipe"
    """Landmarks of MediaPipe Hands, for real hands; the outline where none are found."""


class Device(StrEnum):
    """Where learned stages run."""

    CPU = "cpu"
    CUDA = "cuda"


@dataclass(frozen=True, kw_only=True)
class PerceptionOptions:
    """Numbers and choices of the path from video to episode; defaults are the paper's where it has one."""

    side: int = number(518, low=128, high=2048, doc="side of the square views, pixels (paper: 518)")
    queries: int = number(5000, low=100, high=20000, doc="most points tracked on the object (paper: 5000)")
    spacing: float = number(5.0, low=3.0, high=40.0, doc="distance of the vertices of the surface, pixels")
    least_confidence: float = number(0.5, low=0.0, high=1.0, doc="from here on a point is sure (paper: 0.5)")
    kept_confidence: float = number(0.2, low=0.0, high=1.0, doc="points below are left out of the episode")
    nearest_m: float = number(0.2, low=0.01, high=10.0, doc="points nearer to the camera are left out, metres")
    farthest_m: float = number(1.5, low=0.1, high=20.0, doc="points farther from the camera are left out, metres")
    controllers: int = number(30, low=1, high=500, doc="controller points of all hands (paper: 30)")
    object_points: int = number(1000, low=20, high=20000, doc="most object points in the episode, spread evenly")
    still_s: float = number(1.0, low=0.1, high=10.0, doc="time at the start in which the object is seen at rest, s")
    camera_height_m: float = number(
        0.6, low=0.05, high=10.0, doc="without a tag board: height of the camera over the table at first, metres"
    )
    kind: ObjectKind = choice(ObjectKind.AUTO, doc="sheet, solid, or auto: by how flat it lies")  # noqa: RUF009
    completion: Completion = choice(  # noqa: RUF009
        Completion.SYMMETRIC,
        doc="hidden side of a solid: symmetric (the visible side turned about its middle), generated, none",
    )
    ground_margin_m: float = number(
        0.005, low=0.0, high=0.1, doc="points deeper in the table are left out (paper: 5 mm)"
    )
    object_box: tuple[float, float, float, float] = number(
        (0.0, 0.0, 0.0, 0.0), low=0.0, high=4096.0, doc="x0 y0 x1 y1 around the object in the first view; all 0: search"
    )
    object_point: tuple[float, float] = number(
        (0.0, 0.0), low=0.0, high=4096.0, doc="x y on the object in the first view; both 0: search"
    )

    stages: Stages = choice(  # noqa: RUF009
        Stages.CLASSICAL, doc="classical (no weights), or learned: the models of the paper, see docs/learned_models.md"
    )
    hands: HandCue = choice(  # noqa: RUF009
        HandCue.SHAPE,
        doc="shape (no weights), or mediapipe: landmarks of real hands, needs weights, see docs/learned_models.md",
    )
    weights: str = text("", doc="folder with the weights of learned stages and of mediapipe")
    object_prompt: str = text("object", doc="what learned stages look for, in words: 'a towel'")
    device: Device = choice(Device.CPU, doc="where learned stages run: cpu or cuda")  # noqa: RUF009

    def __post_init__(self) -> None:
        validate(self)
        if self.stages == Stages.LEARNED and not self.weights:
            raise OptionsError(
                "stages learned needs weights, the folder that holds them; docs/learned_models.md says which"
            )
        if self.hands == HandCue.MEDIAPIPE and not self.weights:
            raise OptionsError(
                "hands mediapipe needs weights, the folder that holds its two models; docs/learned_models.md says which"
            )
        if self.hands == HandCue.MEDIAPIPE and self.stages == Stages.LEARNED:
            raise OptionsError(
                "hands mediapipe goes with stages classical; learned stages find hands by themselves: leave one out"
            )
        if self.completion == Completion.GENERATED and self.stages != Stages.LEARNED:
            raise OptionsError("completion generated is a learned stage: it needs stages learned, and weights")
