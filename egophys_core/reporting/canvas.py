"""A figure in the report's style, and its PNG."""

import io
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DOTS_PER_INCH = 120
"""A quarter more than a page shows, for dense screens, and a file that stays small."""


def new_figure(width: float, height: float) -> "Figure":
    """An empty figure, inches; what is drawn in it is laid out without overlap."""
    # The Agg canvas needs no display; pyplot would keep global state.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def png_of(figure: "Figure") -> bytes:
    """The figure as a PNG; all its axes get the report's small type and open frame."""
    for axes in figure.axes:
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
        # The number of ticks must not follow from the size that the layout gives, or labels of the last are cut.
        axes.locator_params(nbins=6)
        for label in (axes.xaxis.label, axes.yaxis.label):
            label.set_fontsize(9)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=DOTS_PER_INCH)
    return stream.getvalue()
