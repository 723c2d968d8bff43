"""Where on an object its prediction is off, and which way."""

import numpy as np

from egophys_core.reporting.canvas import new_figure, png_of

ARROWS = 300
"""At most; more would hide each other."""

ARROW_SHARE = 0.12
"""Length of a large arrow over that of the object."""

WIDTH = 8.0
"""Inches."""


def draw_residual(rest: np.ndarray, field: np.ndarray) -> bytes:
    """The object at rest seen from above and, below on the same scale, from the side, with its residual as arrows.

    Args:
        rest: [P, 3] metres, world.
        field: [P, 3] metres, measured minus predicted; not finite where it is not known.

    Returns:
        A PNG.
    """
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    # The palest colours of the map would be lost on white.
    colour_map = ListedColormap(colormaps["YlOrRd"](np.linspace(0.25, 1.0, 256)))
    known = np.isfinite(field).all(axis=1)
    size = 1000 * np.linalg.norm(np.where(known[:, None], field, 0.0), axis=1)
    across = int(np.argmax(np.ptp(rest[:, :2], axis=0)))
    length = max(float(np.ptp(rest[:, across])), 1e-3)
    enlarged = _round_down(1000 * ARROW_SHARE * length / max(float(np.quantile(size, 0.95)), 1e-6))
    ends = rest + enlarged * np.where(known[:, None], field, 0.0)
    views = [(across, 1 - across, "seen from above"), (across, 2, "seen from the side")]
    boxes = [_box(np.concatenate([rest, ends])[:, [right, up]], 0.06 * length) for right, up, _ in views]
    heights = [max(np.ptp(box[1]) / np.ptp(box[0]), 0.22) for box in boxes]
    figure = new_figure(WIDTH, 0.78 * WIDTH * sum(heights) + 1.3)
    panels = figure.subplots(2, 1, height_ratios=heights, sharex=True)
    order = np.argsort(size)
    drawn = order[known[order]][:: -(-max(int(known.sum()), 1) // ARROWS)]
    for axes, (right, up, title), box in zip(panels, views, boxes, strict=True):
        axes.scatter(rest[~known, right], rest[~known, up], s=8, color="0.8", linewidth=0)
        dots = axes.scatter(
            rest[order, right][known[order]],
            rest[order, up][known[order]],
            c=size[order][known[order]],
            s=22,
            cmap=colour_map,
            vmin=0.0,
            vmax=max(float(size.max()), 1e-3),
            linewidth=0,
        )
        axes.quiver(
            rest[drawn, right],
            rest[drawn, up],
            (ends - rest)[drawn, right],
            (ends - rest)[drawn, up],
            angles="xy",
            scale_units="xy",
            scale=1.0,
            width=0.0022,
            color="0.15",
        )
        axes.set_aspect("equal")
        axes.set_xlim(*boxes[0][0])
        axes.set_ylim(*box[1])
        axes.set_ylabel(f"{'xyz'[up]} in m")
        axes.set_title(title, loc="left", fontsize=10)
    if across == 1:
        # With y to the right, x points towards the reader who looks down; the other way round would be a mirror image.
        panels[0].invert_yaxis()
    panels[1].set_xlabel(f"{'xyz'[across]} in m")
    colours = figure.colorbar(dots, ax=list(panels), shrink=0.8, pad=0.02, aspect=30)
    colours.set_label(f"residual in mm (arrows: {enlarged:g} times as long)", fontsize=9)
    return png_of(figure)


def _box(points: np.ndarray, margin: float) -> np.ndarray:
    """[2, 2]: per axis the ends of what is drawn, metres."""
    return np.stack([points.min(axis=0) - margin, points.max(axis=0) + margin], axis=1)


def _round_down(value: float) -> float:
    """The next number of 1, 2, 5, 10, 20 and so on that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1, 2, 5) if step * power <= value * (1 + 1e-9)))
