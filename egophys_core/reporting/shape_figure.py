"""A picture of shapes side by side, seen from the same place at the same scale."""

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from egophys_core.files import write_atomically

VIEW = (22.0, -60.0)
"""Elevation and azimuth of the eye, degrees."""


def draw_shapes(
    path: Path, shapes: Mapping[str, np.ndarray], *, title: str, ghost: np.ndarray | None = None, ground: float = 0.0
) -> None:
    """Draw point sets next to each other and write a PNG.

    Points are coloured by height; the table is drawn as a grid.

    Args:
        path: the PNG to write.
        shapes: caption -> [P, 3] metres, world.
        title: above all of them.
        ghost: [P, 3] metres drawn in grey behind every shape, for example the target.
        ground: z of the table, metres.

    Raises:
        OSError: the file cannot be written.
    """
    # The Agg canvas needs no display; pyplot would keep global state.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    everything = np.concatenate([*shapes.values(), *([] if ghost is None else [ghost])])
    low, high = everything.min(axis=0), everything.max(axis=0)
    low[2] = min(low[2], ground)
    size = np.maximum(high - low, 0.05) * 1.05
    centre = (low + high) / 2
    figure = Figure(figsize=(4.4 * len(shapes), 3.9))
    FigureCanvasAgg(figure)
    figure.suptitle(title, y=0.98)
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.02, top=0.80, wspace=0.02)
    for index, (caption, points) in enumerate(shapes.items()):
        axes = figure.add_subplot(1, len(shapes), index + 1, projection="3d")
        x, y = np.meshgrid(*(centre[axis] + np.array([-0.5, 0.5]) * size[axis] for axis in (0, 1)))
        axes.plot_wireframe(x, y, np.full_like(x, ground), color="0.8", linewidth=0.8)
        if ghost is not None:
            axes.scatter(*ghost.T, s=3, color="0.7")
        axes.scatter(*points.T, s=9, c=points[:, 2], cmap="viridis", vmin=low[2], vmax=high[2])
        axes.set_title(caption, fontsize=10, pad=0)
        for axis, limits in enumerate((axes.set_xlim, axes.set_ylim, axes.set_zlim)):
            limits(centre[axis] - size[axis] / 2, centre[axis] + size[axis] / 2)
        axes.set_box_aspect(size, zoom=1.15)
        axes.view_init(*VIEW)
        axes.tick_params(labelsize=6)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=110)
    write_atomically(path, stream.getvalue())
