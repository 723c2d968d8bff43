"""Small marks for the cells of a table, as inline SVG: a bar on a scale, and an interval with its best value."""

from dataclasses import dataclass

WIDTH, HEIGHT = 240.0, 18.0
"""Of a mark, in its own units; the page stretches it to the cell."""

BEFORE, AFTER, QUIET, BAND = "#d55e00", "#0072b2", "#9aa3ab", "#e9ecef"
"""Colours that people who do not see red and green tell apart (Okabe and Ito), and two greys."""


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Values at the left and right end of a mark."""

    low: float
    high: float

    def place(self, value: float) -> float:
        """Where a value is drawn; beyond an end, at that end."""
        share = (value - self.low) / (self.high - self.low) if self.high > self.low else 0.5
        return WIDTH * min(max(share, 0.0), 1.0)


def bar(value: float, scale: Scale, *, colour: str, band: tuple[float, float] | None = None) -> str:
    """A bar from zero to a value.

    Args:
        value: where the bar ends.
        scale: the same for all bars of a column.
        colour: of the bar.
        band: from where to where the background is grey.
    """
    left, right = sorted((scale.place(0.0), scale.place(value)))
    parts = [] if band is None else [_rectangle(scale.place(band[0]), scale.place(band[1]), 0.0, HEIGHT, BAND)]
    parts.append(_rectangle(left, max(right, left + 1.0), 4.0, HEIGHT - 8.0, colour))
    parts.append(_rectangle(scale.place(0.0) - 0.5, scale.place(0.0) + 0.5, 0.0, HEIGHT, QUIET))
    return _svg(parts)


def interval(low: float, value: float, high: float, *, null: float | None) -> str:
    """An interval as a line with its best value as a block; `null`, if there is one, as an upright stroke."""
    values = [low, value, high, *([] if null is None else [null])]
    margin = 0.08 * (max(values) - min(values)) or 1.0
    scale = Scale(low=min(values) - margin, high=max(values) + margin)
    parts = [_rectangle(0.0, WIDTH, HEIGHT / 2 - 0.5, 1.0, BAND)]
    if null is not None:
        parts.append(_rectangle(scale.place(null) - 1.0, scale.place(null) + 1.0, 1.0, HEIGHT - 2.0, QUIET))
    parts.append(_rectangle(scale.place(low), scale.place(high), HEIGHT / 2 - 1.5, 3.0, AFTER))
    parts.append(_rectangle(scale.place(value) - 3.0, scale.place(value) + 3.0, HEIGHT / 2 - 5.0, 10.0, AFTER))
    return _svg(parts)


def _rectangle(left: float, right: float, top: float, height: float, colour: str) -> str:
    return (
        f'<rect x="{left:.1f}" y="{top:.1f}" width="{max(right - left, 0.0):.1f}" height="{height:.1f}" '
        f'fill="{colour}"/>'
    )


def _svg(parts: list[str]) -> str:
    return (
        f'<svg class="mark" viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" preserveAspectRatio="none" aria-hidden="true">'
        f"{''.join(parts)}</svg>"
    )
