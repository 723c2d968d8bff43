"""What is rehearsed, and how it is observed."""

from dataclasses import dataclass
from enum import StrEnum

from egophys_core.options import choice, number, validate


class RehearsalObject(StrEnum):
    """What lies on the table."""

    SHEET = "sheet"
    ELLIPSOID = "ellipsoid"
    BOX = "box"


class Motion(StrEnum):
    """What the scripted hands do with it; all come from away and touch it after about one second."""

    LIFT = "lift"
    PULL = "pull"
    DOUBLE_LIFT = "double_lift"
    DOUBLE_PULL = "double_pull"
    FOLD = "fold"
    PUSH = "push"
    SHAKE = "shake"
    """Lift, then shake."""
    HANG = "hang"
    """Lift, hold still for some seconds, lower: shows creep."""


@dataclass(frozen=True, kw_only=True)
class RehearsalOptions:
    """The object, how much objects differ, and how well they are seen."""

    object: RehearsalObject = choice(RehearsalObject.SHEET, doc="what lies on the table")  # noqa: RUF009
    duration_s: float = number(7.0, low=0.1, high=120.0, doc="length of an episode, s")
    rate_hz: float = number(30.0, low=5.0, high=200.0, doc="frames per second")
    points: int = number(350, low=3, high=2000, doc="tracked points on the object's surface")
    noise_m: float = number(0.0015, low=0.0, high=0.05, doc="standard deviation of a point's coordinate, m")
    dropout: float = number(0.04, low=0.0, high=0.9, doc="share of the points that a frame lacks by chance")
    occlusion: bool = choice(True, doc="leave out points that the camera does not see")
    spread: float = number(0.2, low=0.0, high=0.6, doc="by how much size, mass, stiffness and friction differ")

    def __post_init__(self) -> None:
        validate(self)
