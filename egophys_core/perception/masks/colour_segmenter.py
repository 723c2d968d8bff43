"""The segmenter that needs no weights: the object is found in the first still views and followed by colour."""

import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain, islice

import numpy as np

from egophys_core.perception.masks.colour_model import is_black
from egophys_core.perception.masks.mask_tracker import MaskTracker
from egophys_core.perception.masks.object_finder import find_object
from egophys_core.perception.stages import Masks, View


@dataclass(frozen=True, kw_only=True)
class ColourSegmenter:
    """A `Segmenter` of colour, table background and flow; holds the first still views, then one at a time."""

    table_height: float = 0.0
    """z of the table, metres."""
    board_corners: np.ndarray | None = None
    """[N, 3] world points, metres, around the tag board; None if there is none."""
    object_box: tuple[float, float, float, float] | None = None
    """x0, y0, x1, y1 in pixels of the first view, around the object; None to find it."""
    object_point: tuple[float, float] | None = None
    """x, y in pixels of the first view, on the object; None to find it."""
    still_views: int = 25
    """First views in which the object lies still and no hand is seen."""

    def masks(self, views: Iterable[View]) -> Iterator[Masks]:
        """Masks of each view; empty for black ones, with which a video may begin.

        Raises:
            EpisodeError: no views that are not black, or no object in the first ones.

        Warns:
            UserWarning: more than one thing could be the object.
        """
        views = iter(views)
        for view in views:
            if not is_black(view):
                views = chain([view], views)
                break
            yield Masks(object=np.zeros(view.image.shape[:2], bool), hand=np.zeros(view.image.shape[:2], bool))
        first = list(islice(views, self.still_views))
        found = find_object(
            first,
            table_height=self.table_height,
            board_corners=self.board_corners,
            box=self.object_box,
            point=self.object_point,
        )
        if found.warning:
            warnings.warn(found.warning, stacklevel=2)
        tracker = MaskTracker(first[0], found.mask, table_height=self.table_height)
        for view in chain(first, views):
            yield tracker.next(view)
