"""What an episode must have before anything is fitted to it or compared with it."""

import warnings

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from egophys_core.constants import LARGEST_OBJECT_M, SMALLEST_OBJECT_M
from egophys_core.episode import Episode, EpisodeWarning
from egophys_core.errors import EpisodeError
from egophys_core.geometry import farthest_points, spacing
from egophys_core.observation.delay import LARGEST_DELAY_S

GAP, LEAST_GAP_M, SMALL_PIECE = 4.0, 0.06, 0.1
"""Times the spacing of points, and metres, from which a gap parts two objects, and the share of the points of a piece
that may be a wrong one. Gaps within objects are up to 2 spacings wide (100 recordings, hidden parts and all)."""

MOST_IN_PIECES, FEWEST_IN_PIECES = 400, 20
"""Points of which pieces are told."""

MOST_BELOW_TABLE_M, MOST_ABOVE_TABLE_M = 0.02, 0.1
"""Metres by which all of an object at rest may lie below the table, and over it; of one that is larger, its size. A
table that was found in pictures is a centimetre off, and of a tall thing the top may be all that is seen."""


def require_fittable(episode: Episode) -> None:
    """Check that something can move the object, and that its size is one in metres.

    Raises:
        EpisodeError: no controllers, or the points are in another unit.
    """
    if episode.controllers.shape[1] == 0:
        raise EpisodeError(
            f"{episode.name}: no controller points, so nothing moves the object; record the points of the hands, or of "
            "a clamp"
        )
    size = object_size(episode)
    if not SMALLEST_OBJECT_M <= size <= LARGEST_OBJECT_M:
        too_large = "divide millimetres by 1000, centimetres by 100"
        remedy = too_large if size > LARGEST_OBJECT_M else "if they were divided by 1000 twice, do it once"
        raise EpisodeError(
            f"{episode.name}: the object is {size:.3g} m across, a twin is built of objects of {SMALLEST_OBJECT_M:g} "
            f".. {LARGEST_OBJECT_M:g} m; points must be in metres: {remedy}"
        )


def require_one_clock(name: str, delay: float, drift: float) -> None:
    """Check that points are recorded no later after the hands, seconds, than can be taken off, and warn of a drift.

    Raises:
        EpisodeError: they are.
    """
    if drift:
        warnings.warn(
            f"{name}: the clocks of hands and points drift apart by {100 * drift:+.1f} %: their delay of {delay:.2f} s "
            "changes over the record, and is taken off as it is in the middle; stamp both by one clock",
            EpisodeWarning,
            stacklevel=2,
        )
    if abs(delay) > LARGEST_DELAY_S:
        raise EpisodeError(
            f"{name}: its points follow the hands {abs(delay):.2f} s {'later' if delay > 0 else 'earlier'} than "
            f"recorded; up to {LARGEST_DELAY_S:g} s are taken off. Stamp hands and points by one clock, or shift one "
            "of the topics"
        )


def require_one_object(name: str, at_rest: np.ndarray) -> None:
    """Check that points at rest [P, 3], metres, are of one piece.

    Raises:
        EpisodeError: a gap parts them.
    """
    points = at_rest[farthest_points(at_rest, MOST_IN_PIECES)]
    if len(points) < FEWEST_IN_PIECES:
        return
    neighbours = spacing(points)
    gap = max(GAP * neighbours, LEAST_GAP_M)
    pairs = cKDTree(points).query_pairs(gap, output_type="ndarray")
    links = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    pieces, which = connected_components(links, directed=False)
    shares = np.bincount(which) / len(points)
    if pieces > 1 and np.sort(shares)[-2] > SMALL_PIECE:
        first, second = np.argsort(-shares)[:2]
        apart = cKDTree(points[which == first]).query(points[which == second])[0].min()
        raise EpisodeError(
            f"{name}: the points at rest are of {np.count_nonzero(shares > SMALL_PIECE)} pieces, {100 * apart:.0f} cm "
            f"apart, where their neighbours are {100 * neighbours:.0f} cm from each other; a twin is of one object: "
            "leave out the points of the others"
        )


def require_on_table(name: str, at_rest: np.ndarray, ground_height: float) -> None:
    """Check that points at rest [P, 3], metres, that no hand holds lie near the table.

    Raises:
        EpisodeError: they lie below it, or hover.
    """
    low, high = (float(each) - ground_height for each in np.percentile(at_rest[:, 2], [5, 95]))
    size = float(np.linalg.norm(np.ptp(at_rest, axis=0)))
    if high >= -MOST_BELOW_TABLE_M and low <= max(MOST_ABOVE_TABLE_M, size):
        return
    where = f"{-high:.2f} m below" if high < 0.0 else f"{low:.2f} m above"
    raise EpisodeError(
        f"{name}: the object rests {where} the table, which is taken to be at z = {ground_height:g} m; shift points "
        "and hands so that the table is z = 0, or say that there is none (--no-table)"
    )


def object_size(episode: Episode) -> float:
    """Metres: diagonal of the box around the visible points, median over the frames that have any."""
    points = episode.points[episode.visible.any(axis=1)]
    return float(np.median(np.linalg.norm(np.nanmax(points, axis=1) - np.nanmin(points, axis=1), axis=1)))
