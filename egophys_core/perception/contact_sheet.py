"""Pictures spread evenly over a run, on one sheet."""

from collections.abc import Sequence
from typing import Generic, TypeVar

import cv2
import numpy as np

from egophys_core.errors import EpisodeError
from egophys_core.perception.overlay import legend, write_text

PICTURES = 12
COLUMNS = 3
WIDEST = 777
"""Pixels: wider pictures are shrunk to this, so that a sheet of three columns fits a screen."""
_MARGIN = 4

T = TypeVar("T")


class EvenSample(Generic[T]):
    """Keeps some items of a sequence of unknown length, evenly spread, without keeping all."""

    def __init__(self, wanted: int = PICTURES) -> None:
        """Keep at most `4 * wanted` items at a time."""
        self._wanted = wanted
        self._stride = 1
        self._count = 0
        self._kept: list[T] = []

    def add(self, item: T) -> None:
        """Give the next item."""
        if self._count % self._stride == 0:
            self._kept.append(item)
            if len(self._kept) == 4 * self._wanted:
                self._kept = self._kept[::2]
                self._stride *= 2
        self._count += 1

    def items(self) -> list[T]:
        """The wanted number of items, or all if there were fewer, in order: the first, and others evenly after it."""
        if not self._kept:
            return []
        places = np.linspace(0, len(self._kept) - 1, min(self._wanted, len(self._kept)))
        return [self._kept[round(float(place))] for place in places]


def contact_sheet(pictures: Sequence[np.ndarray], *, title: str, columns: int = COLUMNS) -> np.ndarray:
    """Lay pictures in a grid, row by row, under a title and the legend of the overlays.

    Args:
        pictures: [H, W, 3] uint8 BGR, all of one size, at least one.
        title: ASCII.
        columns: pictures in a row.

    Returns:
        [.., .., 3] uint8 BGR; cells that no picture is left for are grey.

    Raises:
        EpisodeError: no pictures, or of different sizes.
    """
    sizes = {picture.shape for picture in pictures}
    if len(sizes) != 1:
        raise EpisodeError(f"a contact sheet needs pictures of one size, got {sorted(sizes) or 'none'}")
    height, width = pictures[0].shape[:2]
    if width > WIDEST:
        height, width = round(height * WIDEST / width), WIDEST
        pictures = [cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA) for picture in pictures]
    columns = min(columns, len(pictures))
    rows = -(-len(pictures) // columns)
    sheet = np.full((rows * (height + _MARGIN) + _MARGIN, columns * (width + _MARGIN) + _MARGIN, 3), 40, np.uint8)
    for index, picture in enumerate(pictures):
        y = _MARGIN + index // columns * (height + _MARGIN)
        x = _MARGIN + index % columns * (width + _MARGIN)
        sheet[y : y + height, x : x + width] = picture
    head = np.full((32, sheet.shape[1], 3), 40, np.uint8)
    write_text(head, title, (10, 21))
    return np.vstack([head, legend(sheet.shape[1]), sheet])
