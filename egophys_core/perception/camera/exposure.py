"""Whether the light flickers against the exposure: bands of brightness that run through the image."""

from collections.abc import Sequence

import numpy as np

BAND_TOLERANCE = 0.04
"""Share of the brightness: recorded videos change by 0.005 to 0.013 between frames, by what moves in them."""

_ROWS = 64
_EVERY_COLUMN = 8
_DARKEST = 8.0
"""Grey levels: what is darker is noise."""


def row_brightness(image: np.ndarray) -> np.ndarray:
    """[64] logarithm of the brightness along the rows of an image [H, W, 3] uint8."""
    rows = np.linspace(0, len(image) - 1, _ROWS).round().astype(int)
    # The median: a hand or a bright thing is in a part of a row, a flicker in all of it.
    return np.asarray(np.log(np.maximum(np.median(image[rows, ::_EVERY_COLUMN, 1], axis=1), _DARKEST)))


def flicker_note(brightness: Sequence[np.ndarray]) -> str | None:
    """What to tell the user of bands that change from frame to frame; None if there are none.

    Args:
        brightness: `row_brightness` of the frames in order.
    """
    if len(brightness) < 2:
        return None
    change = np.diff(np.array(brightness), axis=0)
    along = np.linspace(-1, 1, change.shape[1])
    slope = change @ along / (along @ along)
    bands = np.abs(change - change.mean(axis=1, keepdims=True) - slope[:, None] * along)
    strength = float(np.median(bands))
    if strength < BAND_TOLERANCE:
        return None
    return (
        f"brightness changes by {100 * strength:.0f} % between frames in bands that run through the image: lamps "
        "flicker while a rolling shutter reads it; use daylight, or an exposure of whole periods of the lamps' "
        "flicker (1/50 or 1/60 s)"
    )
