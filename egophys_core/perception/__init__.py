"""RGB frames -> masks -> tracks -> 3D points -> Episode; `perceive` is in the module of that name."""

from typing import TYPE_CHECKING

from egophys_core.on_demand import names_on_demand

if TYPE_CHECKING:
    from egophys_core.perception.camera.board import Board, TagFamily
    from egophys_core.perception.camera.lens import SquareView
    from egophys_core.perception.camera.video import open_video
    from egophys_core.perception.live import LiveObserver, require_live
    from egophys_core.perception.observation import Observation
    from egophys_core.perception.options import Completion, ObjectKind, PerceptionOptions
    from egophys_core.perception.overlay import draw_picture
    from egophys_core.perception.overlay_video import OverlayVideo
    from egophys_core.perception.perceive import Perceived, PerceptionReport

__all__ = [
    "Board",
    "Completion",
    "LiveObserver",
    "ObjectKind",
    "Observation",
    "OverlayVideo",
    "Perceived",
    "PerceptionOptions",
    "PerceptionReport",
    "SquareView",
    "TagFamily",
    "draw_picture",
    "open_video",
    "require_live",
]

__getattr__ = names_on_demand(
    __name__,
    "options",
    "observation",
    "camera.board",
    "camera.lens",
    "camera.video",
    "live",
    "overlay",
    "overlay_video",
    "perceive",
)
