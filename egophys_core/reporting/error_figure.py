"""The error of a prediction over time, before and after."""

import numpy as np

from egophys_core.reporting.canvas import new_figure, png_of
from egophys_core.reporting.marks import AFTER, BEFORE


def draw_errors(times: np.ndarray, before: np.ndarray, after: np.ndarray, *, highest: float) -> bytes:
    """Two errors of one episode.

    Args:
        times: [T] seconds.
        before: [T] metres; not finite where there is none.
        after: [T] metres.
        highest: metres at the top; the same for all episodes, so that pictures compare.

    Returns:
        A PNG.
    """
    figure = new_figure(5.6, 2.5)
    axes = figure.add_subplot()
    before, after = (1000 * np.where(np.isfinite(each), each, np.nan) for each in (before, after))
    axes.fill_between(times, before, after, where=after < before, color=AFTER, alpha=0.10, linewidth=0)
    axes.plot(times, before, color=BEFORE, linewidth=1.6, label="before")
    axes.plot(times, after, color=AFTER, linewidth=1.6, label="after")
    axes.set_xlim(times[0], times[-1])
    axes.set_ylim(0.0, 1000 * highest)
    axes.set_xlabel("time in s")
    axes.set_ylabel("track error in mm")
    axes.legend(loc="upper left", ncols=2, frameon=False)
    axes.grid(axis="y", color="0.9", linewidth=0.8)
    return png_of(figure)
