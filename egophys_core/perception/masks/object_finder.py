"""Find the object that lies on the table in the first still views, or take it from a box or a point the user gives."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from egophys_core.errors import EpisodeError
from egophys_core.perception.masks.colour_model import is_black, log_features
from egophys_core.perception.masks.region_cut import box_of, cut_region, main_parts
from egophys_core.perception.masks.table_background import has_pose, table_homography, table_places
from egophys_core.perception.robust import robust_scale
from egophys_core.perception.stages import View

SEARCH_HALF_SIDE_M = 0.8
"""Half side of the part of the table that is searched, around the place the camera looks at or the board."""
_SMALLEST_SHARE = 5e-4
"""Smallest candidate, share of the image."""
_UNLIKE = 3.5
"""Robust standard deviations from the table's colour that make a pixel unlike it."""
_RIVAL_SHARE = 0.15
"""A candidate whose score is this share of the best one's is a rival that the user is told of."""


@dataclass(frozen=True, kw_only=True)
class ObjectCandidate:
    """A connected region that may be the object."""

    mask: np.ndarray
    """[S, S] bool, in the first view."""
    box: tuple[int, int, int, int]
    """x0, y0, x1, y1 in pixels of the first view, the last two exclusive."""
    score: float
    """Share of the image, halved for each third of the image's half diagonal it is away from the centre."""


@dataclass(frozen=True, kw_only=True)
class FoundObject:
    """The object in the first view, and what else it could have been."""

    mask: np.ndarray
    """[S, S] bool, in the first view."""
    box: tuple[int, int, int, int]
    """x0, y0, x1, y1 in pixels of the first view, the last two exclusive."""
    others: tuple[ObjectCandidate, ...]
    """The candidates that were not chosen, best first."""
    warning: str
    """What the user should check; empty if the choice was clear."""


def find_object(
    views: Sequence[View],
    *,
    table_height: float = 0.0,
    board_corners: np.ndarray | None = None,
    box: tuple[float, float, float, float] | None = None,
    point: tuple[float, float] | None = None,
) -> FoundObject:
    """Find the object in the first view.

    Without box and point: what is unlike the table (or, where the pose is unknown, unlike the border of the image), is
    no shadow of it and stays where it is over the views. Of several the one with the largest score is chosen.

    Args:
        views: first still views, in order; the first, the middle and the last are looked at.
        table_height: z of the table, metres.
        board_corners: [N, 3] world points, metres, whose convex hull is the tag board; None if there is none.
        box: x0, y0, x1, y1 in pixels of the first view; the object is inside.
        point: x, y in pixels of the first view, on the object.

    Raises:
        EpisodeError: no views, the first is black, nothing unlike the table, or nothing at the box or point.
    """
    if len(views) == 0:
        raise EpisodeError("no views to find the object in; the video must have at least one frame")
    image = views[0].image
    if is_black(views[0]):
        raise EpisodeError("the first view is black, so no object can be found in it; start with a view that shows it")
    if box is not None:
        return _from_box(image, box, _unlike_table(views[0], table_height, board_corners)[0])
    if point is not None:
        return _from_point(image, point, _unlike_table(views[0], table_height, board_corners)[0])
    picked = list({0: None, len(views) // 2: None, len(views) - 1: None})
    regions = [_unlike_table(views[index], table_height, board_corners) for index in picked]
    candidates = _candidates(*regions[0])
    if has_pose(views[0]):
        for index, (later, _) in zip(picked[1:], regions[1:], strict=True):
            if has_pose(views[index]) and not is_black(views[index]):
                candidates = [one for one in candidates if _stays(one, views[0], views[index], later, table_height)]
    if not candidates:
        raise EpisodeError(
            f"no object found in the first {len(views)} views: nothing on the table differs from it in colour; "
            "give its place with --object-box X0 Y0 X1 Y1 (pixels of the first view)"
        )
    best, others = candidates[0], tuple(candidates[1:])
    # Between object and board is table; its edge with the board is the sharper one.
    mask = cut_region(image, best.mask, background=_board(views[0], board_corners))
    rivals = [one for one in others if one.score > _RIVAL_SHARE * best.score]
    warning = ""
    if rivals:
        places = ", ".join(_text(one.box) for one in rivals)
        warning = (
            f"{len(rivals) + 1} things on the table could be the object; took the one at box {_text(best.box)}, large "
            f"and near the centre; for another pass --object-box with one of: {places}"
        )
    return FoundObject(mask=mask, box=box_of(mask), others=others, warning=warning)


def _unlike_table(view: View, table_height: float, board_corners: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Pixels unlike the table that are no shadow, small gaps closed, and those of the table; [S, S] bool each."""
    side = view.image.shape[0]
    features = log_features(cv2.GaussianBlur(view.image, (0, 0), side / 400))
    contrast = cv2.cvtColor(view.image, cv2.COLOR_BGR2GRAY).astype(np.float32)
    contrast = cv2.GaussianBlur(np.abs(contrast - cv2.GaussianBlur(contrast, (0, 0), side / 250)), (0, 0), side / 150)
    features = np.dstack([features, np.log(contrast + 2)])
    table = _table(view, table_height)
    searched = table & ~_board(view, board_corners)
    if np.count_nonzero(searched) < 0.01 * side * side:
        return np.zeros((side, side), bool), table
    off, sigma = _residual(features, searched if has_pose(view) else _border(side))
    scaled = off / sigma
    distance = np.sqrt((scaled[..., :3] ** 2).sum(axis=-1) + 0.5 * np.clip(scaled[..., 3], 0, None) ** 2)
    chroma = np.hypot(scaled[..., 0], scaled[..., 1])
    is_shadow = (chroma < _UNLIKE) & (off[..., 2] < 0) & (off[..., 2] > -math.log(4)) & (scaled[..., 3] < _UNLIKE)
    sure = (distance > _UNLIKE) & searched & ~is_shadow
    radius = max(1, side // 170)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    opened = cv2.morphologyEx(sure.astype(np.uint8), cv2.MORPH_OPEN, kernel)
    closed = cv2.morphologyEx(opened, cv2.MORPH_CLOSE, kernel, iterations=2)
    return np.asarray(ndimage.binary_fill_holes(closed)) & searched, table


def _table(view: View, table_height: float) -> np.ndarray:
    """[S, S] bool: pixels on the table that are searched; all without a pose."""
    side = view.image.shape[0]
    if not has_pose(view):
        return np.ones((side, side), bool)
    y, x = np.mgrid[:side, :side]
    places = table_places(view, np.column_stack([x.ravel(), y.ravel()]), table_height).reshape(side, side, 2)
    if np.isnan(places).all():
        return np.zeros((side, side), bool)
    looked_at = places[int(0.55 * side), side // 2]
    centre = looked_at if np.isfinite(looked_at).all() else np.nanmean(places[-side // 4 :], axis=(0, 1))
    with np.errstate(invalid="ignore"):
        within_reach = np.asarray((np.abs(places - centre) < SEARCH_HALF_SIDE_M).all(axis=-1))
    # What is black up to the border of the image is unlit background, not a dark thing on the table.
    black = (cv2.GaussianBlur(view.image.max(axis=-1), (0, 0), side / 170) <= 12).astype(np.uint8)
    labels = cv2.connectedComponents(black, connectivity=4)[1]
    at_border = np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))
    return within_reach & ~(np.isin(labels, at_border) & (black > 0))


def _board(view: View, corners: np.ndarray | None) -> np.ndarray:
    """[S, S] bool: pixels in the convex hull of world points [N, 3], and a margin; none without points or a pose."""
    side = view.image.shape[0]
    board = np.zeros((side, side), np.uint8)
    if corners is not None and has_pose(view):
        points = np.column_stack([corners, np.ones(len(corners))]) @ np.linalg.inv(view.world_from_camera).T
        pixels = points[:, :3] @ view.camera_matrix.T
        if (points[:, 2] > 0).all():
            hull = cv2.convexHull((pixels[:, :2] / pixels[:, 2:]).astype(np.float32))
            cv2.fillConvexPoly(board, np.round(hull).astype(np.int32), 1)
    width = 2 * (side // 100) + 1
    return np.asarray(cv2.dilate(board, np.ones((width, width), np.uint8))) > 0


def _border(side: int) -> np.ndarray:
    width = side // 8
    border = np.ones((side, side), bool)
    border[width:-width, width:-width] = False
    return border


def _residual(features: np.ndarray, fitted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Features [S, S, 4] less what the table has there, and their robust standard deviation [4] over the table.

    The table's features are a quadratic over the image, for the light falls off; fitted to its pixels by iteratively
    reweighted least squares (Tukey's biweight).
    """
    side = features.shape[0]
    y, x = np.mgrid[:side, :side].astype(np.float32) / side - 0.5
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    step = max(1, side // 130)
    chosen = np.zeros_like(fitted)
    chosen[::step, ::step] = fitted[::step, ::step]
    samples, rows = features[chosen].astype(float), basis[chosen].astype(float)
    off = samples - np.median(samples, axis=0)
    for _ in range(12):
        spread = robust_scale(off, axis=0) + 1e-3
        inside = np.clip(1 - ((off / (4 * spread)) ** 2).max(axis=1), 0, None) ** 2
        scaled = rows * inside[:, None]
        solution = np.linalg.solve(scaled.T @ rows + 1e-6 * np.eye(6), scaled.T @ samples)
        off = samples - rows @ solution
    kept = inside > 0
    sigma = robust_scale(off[kept], axis=0) + np.array([0.02, 0.02, 0.03, 0.1])
    return features - basis @ solution.astype(np.float32), sigma


def _candidates(region: np.ndarray, table: np.ndarray) -> list[ObjectCandidate]:
    """Connected regions [S, S] bool, best first, without tiny ones and those along the end of the table or image."""
    side = region.shape[0]
    count, labels, stats, centroids = cv2.connectedComponentsWithStats(region.astype(np.uint8), connectivity=8)
    kernel = np.ones((3, 3), np.uint8)
    inside = cv2.erode(table.astype(np.uint8), kernel, iterations=3, borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
    found = []
    for label in range(1, count):
        x, y, width, height, area = (int(each) for each in stats[label])
        mask = labels == label
        at_end = np.count_nonzero(mask & ~inside)
        if area < _SMALLEST_SHARE * side * side or at_end > 0.25 * 2 * (width + height):
            continue
        away = float(np.hypot(*(centroids[label] - (side - 1) / 2))) / (side / math.sqrt(2))
        score = area / side**2 * 0.5 ** (3 * away)
        found.append(ObjectCandidate(mask=mask, box=(x, y, x + width, y + height), score=score))
    return sorted(found, key=lambda one: -one.score)


def _stays(one: ObjectCandidate, first: View, later: View, region: np.ndarray, table_height: float) -> bool:
    """Whether most of a candidate is, seen from a later view, where it was on the table."""
    move = table_homography(later, table_height) @ np.linalg.inv(table_homography(first, table_height))
    side = region.shape[::-1]
    moved = cv2.warpPerspective(one.mask.astype(np.uint8), move, side, flags=cv2.INTER_NEAREST) > 0
    return np.count_nonzero(moved & region) >= 0.5 * np.count_nonzero(moved) > 0


def _from_box(image: np.ndarray, box: tuple[float, float, float, float], unlike: np.ndarray) -> FoundObject:
    side = image.shape[0]
    x0, y0, x1, y1 = box
    if not (np.isfinite(box).all() and 0 <= x0 < x1 <= side and 0 <= y0 < y1 <= side) or min(x1 - x0, y1 - y0) < 4:
        raise EpisodeError(
            f"object box {tuple(box)} must be x0 y0 x1 y1 in pixels, at least 4 wide and high, "
            f"in a view of {side} x {side}"
        )
    left, top, right, bottom = (round(each) for each in box)
    inside = np.zeros((side, side), bool)
    inside[top:bottom, left:right] = True
    unlike = unlike & inside
    # The box says more than the table's colour: where hardly anything in it is unlike the table, GrabCut decides.
    if np.count_nonzero(unlike) > 0.1 * np.count_nonzero(inside):
        mask = cut_region(image, main_parts(unlike)) & inside
    else:
        mask = cut_region(image, inside, outside=True)
    if np.count_nonzero(mask) < 16:
        raise EpisodeError(
            f"nothing in the object box {_text((left, top, right, bottom))} differs from what is around it; "
            "give a box that holds the whole object and some table"
        )
    return FoundObject(mask=mask, box=box_of(mask), others=(), warning="")


def _from_point(image: np.ndarray, point: tuple[float, float], unlike: np.ndarray) -> FoundObject:
    side = image.shape[0]
    x, y = point
    if not (np.isfinite(point).all() and 0 <= x <= side - 1 and 0 <= y <= side - 1):
        raise EpisodeError(f"object point {tuple(point)} must be x y in pixels of a view of {side} x {side}")
    at = (round(x), round(y))
    seed = np.zeros((side, side), np.uint8)
    cv2.circle(seed, at, max(3, side // 50), 1, -1)
    labels = cv2.connectedComponents(unlike.astype(np.uint8))[1]
    hit = np.bincount(labels[seed > 0], minlength=2)[1:]
    if hit.any():
        mask = cut_region(image, labels == 1 + int(hit.argmax()))
    else:
        near = np.zeros((side, side), np.uint8)
        cv2.circle(near, at, side // 8, 1, -1)
        mask = cut_region(image, near > 0, outside=True, sure=seed > 0)
    return FoundObject(mask=mask, box=box_of(mask), others=(), warning="")


def _text(box: tuple[int, int, int, int]) -> str:
    return " ".join(str(each) for each in box)
