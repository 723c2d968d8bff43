"""Whether the board lies on the table: the table's own texture says where the table is."""

from dataclasses import dataclass

import cv2
import numpy as np

from egophys_core.perception.camera.board import Board
from egophys_core.perception.check.point_heights import explained, follow
from egophys_core.perception.robust import cauchy_weights
from egophys_core.perception.scene_observer import board_outline
from egophys_core.perception.stages import View
from egophys_core.perception.surface.surface_render import project

_HEIGHTS_M = np.arange(-0.15, 0.1505, 0.0025)
_FITS_PX = 0.5
"""Pixels, median over the views: points that rest at one place."""
_MARGIN = 21
"""Pixels: width of what is left out around the object and the board."""
_FEWEST = 30
_SCATTER_M = 0.005
"""Metres: usual error of a point's height."""
_ITERATIONS = 10


@dataclass(frozen=True, kw_only=True)
class TablePlane:
    """The table in the world of the board."""

    tilt_deg: float
    """Degrees between the table and the board."""
    height_m: float
    """Metres: the table over z = 0 in the middle of its points."""
    tilt_sigma_deg: float
    """Degrees: standard deviation of the tilt."""


def free_table(view: View, object_mask: np.ndarray, board: Board) -> np.ndarray:
    """[S, S] bool: pixels of a view that are neither object nor board, nor near them."""
    taken = object_mask.astype(np.uint8)
    corners = project(board_outline(board), view.camera_matrix, view.world_from_camera)
    if (corners[:, 2] > 0).all():
        cv2.fillConvexPoly(taken, cv2.convexHull(np.round(corners[:, :2]).astype(np.int32)), 1)
    return np.asarray(cv2.dilate(taken, np.ones((_MARGIN, _MARGIN), np.uint8)) == 0)


def table_plane(views: tuple[View, ...], free: np.ndarray) -> TablePlane | None:
    """Fit a plane to points on the table.

    Args:
        views: half a second and more, with poses, before a hand comes: what moves with its shadow is no table.
        free: [S, S] bool: pixels of the first view that show the table, neither object nor board.

    Returns:
        None where too few points are followed, as on a table of one colour.
    """
    tracks = follow(views, free)
    found = explained(views, tracks, len(views) // 2, _HEIGHTS_M)
    with np.errstate(invalid="ignore"):
        off = np.nanmedian(np.where(np.isfinite(found.off_px).any(axis=0), found.off_px, np.inf), axis=0)
    inside = np.abs(found.places[:, 2]) < _HEIGHTS_M[-1] - 0.005
    places = found.places[(off < _FITS_PX) & inside & np.isfinite(found.places).all(axis=1)]
    if len(places) < _FEWEST:
        return None
    centre = np.median(places, axis=0)
    rows = np.column_stack([places[:, :2] - centre[:2], np.ones(len(places))])
    weights = np.ones(len(places))
    for _ in range(_ITERATIONS):
        normal = rows.T * weights @ rows
        plane = np.linalg.solve(normal, rows.T * weights @ places[:, 2])
        weights = cauchy_weights((places[:, 2] - rows @ plane) ** 2, _SCATTER_M)
    scatter = float(np.sqrt(np.average((places[:, 2] - rows @ plane) ** 2, weights=weights)))
    deviation = scatter * np.sqrt(np.linalg.eigvalsh(np.linalg.inv(normal)[:2, :2])[-1])
    return TablePlane(
        tilt_deg=float(np.degrees(np.arctan(np.hypot(*plane[:2])))),
        height_m=float(plane[2]),
        tilt_sigma_deg=float(np.degrees(deviation)),
    )
