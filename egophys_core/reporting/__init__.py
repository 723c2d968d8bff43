"""Results as pictures."""

from egophys_core.reporting.shape_figure import draw_shapes

__all__ = ["draw_shapes"]
