"""Corners of tags to hundredths of a pixel: where straight lines along their four black edges meet.

Detectors give corners that are off by up to half a pixel, always to the same side (docs/notes/board_pose.md); that is
too much for a calibration, while the print cannot be fitted before the lens is known.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from egophys_core.perception.camera.board import Board

_SAMPLES = 24
"""Profiles across each edge."""
_SPARED = 0.12
"""Share of an edge at either end that the neighbouring edge's blur reaches."""
_REACH_CELLS = 0.45
"""Half length of a profile, cells of the tag: what lies beyond may be another edge."""
_LONGEST_REACH = 4.0
"""Pixels."""
_STEPS = 17
"""Samples of a profile."""
_LEAST_CONTRAST = 20.0
"""Grey levels from black to white."""
_FARTHEST = 3.0
"""Pixels that a corner may lie from where it was detected."""
_SMALLEST_SIDE = 14.0
"""Pixels; edges of smaller tags are blurred into each other."""


@dataclass(frozen=True, kw_only=True)
class SeenTags:
    """Tags of a board in one image."""

    stamp_ns: int
    """Of the image, nanoseconds."""
    tags: np.ndarray
    """[K] int: 0 is the upper left of the board."""
    corners: np.ndarray
    """[K, 4, 2] float64 pixels, clockwise from the upper left as printed."""
    roughness: float
    """Pixels, root mean square, of the edges about their straight lines; blur and noise make it larger."""


class TagEdgeFinder:
    """Finds the tags of a board in images as they were taken, distorted or not."""

    def __init__(self, board: Board) -> None:
        self._board = board
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        parameters.cornerRefinementWinSize = 3
        self._detector = cv2.aruco.ArucoDetector(board.dictionary, parameters)

    def find(self, image: np.ndarray, stamp_ns: int) -> SeenTags:
        """Tags in an image [H, W, 3] or [H, W] uint8, each at most once; without any K is 0."""
        gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        detected, ids, _ = self._detector.detectMarkers(gray)
        tags = np.zeros(0, int) if ids is None else ids.reshape(-1).astype(int) - self._board.first_id
        known = (tags >= 0) & (tags < self._board.columns * self._board.rows)
        once = np.isin(tags, np.flatnonzero(np.bincount(tags[known], minlength=1) == 1))
        smooth = gray.astype(np.float32)
        kept, corners, roughness = [], [], []
        for index in np.flatnonzero(known & once):
            refined = self._refined(smooth, np.asarray(detected[index], np.float64).reshape(4, 2))
            if refined is not None:
                kept.append(tags[index])
                corners.append(refined[0])
                roughness.append(refined[1])
        return SeenTags(
            stamp_ns=stamp_ns,
            tags=np.array(kept, int),
            corners=np.array(corners, float).reshape(-1, 4, 2),
            roughness=float(np.median(roughness)) if roughness else float("inf"),
        )

    def _refined(self, gray: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, float] | None:
        """Corners [4, 2] where the edges meet, and the root mean square of the edges about straight lines."""
        sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        if sides.min() < _SMALLEST_SIDE:
            return None
        reach = min(_REACH_CELLS * float(sides.min()) / self._board.cells_per_tag, _LONGEST_REACH)
        refined = corners
        for _ in range(2):
            found = _edges(gray, refined, reach)
            if found is None:
                return None
            points, residual = found
            refined = meeting_corners(points)
            if not np.isfinite(refined).all() or np.linalg.norm(refined - corners, axis=1).max() > _FARTHEST:
                return None
        return refined, residual


def edge_shares() -> np.ndarray:
    """[N] 0..1: where along an edge, from corner to corner, it is looked at."""
    return np.linspace(_SPARED, 1 - _SPARED, _SAMPLES)


def meeting_corners(edges: Sequence[np.ndarray]) -> np.ndarray:
    """[4, 2]: where straight lines through points [N, 2] of each edge meet, edge 0 from corner 0 to corner 1 and so on.

    NaN where lines are parallel.
    """
    lines = []
    for points in edges:
        centre = points.mean(axis=0)
        normal = np.linalg.svd(points - centre, full_matrices=False)[2][1]
        lines.append([*normal, -normal @ centre])
    return np.array([_meeting(np.array(lines[index - 1]), np.array(lines[index])) for index in range(4)])


def _edges(gray: np.ndarray, corners: np.ndarray, reach: float) -> tuple[list[np.ndarray], float] | None:
    """Points [N, 2] on each edge, and how far they are from straight lines: root mean square, pixels."""
    begin, end = corners, np.roll(corners, -1, axis=0)
    along = (end - begin) / np.linalg.norm(end - begin, axis=1, keepdims=True)
    outward = np.column_stack([along[:, 1], -along[:, 0]])  # clockwise, y down: the left of the way is outside
    feet = begin[:, None] + edge_shares()[None, :, None] * (end - begin)[:, None]
    offsets = np.linspace(-reach, reach, _STEPS)
    places = (feet[:, :, None] + offsets[None, None, :, None] * outward[:, None, None]).astype(np.float32)
    flat = places.reshape(4, -1, 2)
    values = cv2.remap(gray, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    profiles = values.reshape(4, _SAMPLES, _STEPS)
    # The middle of the rise from black to white: the mean place of the gradient, noise that falls left out.
    rise = np.clip(np.diff(profiles, axis=2), 0, None)
    height = rise.sum(axis=2)
    middle = (rise * (offsets[1:] + offsets[:-1]) / 2).sum(axis=2) / np.maximum(height, 1e-6)
    edges, squares = [], []
    for side in range(4):
        good = height[side] > max(_LEAST_CONTRAST, 0.5 * float(np.median(height[side])))
        if np.count_nonzero(good) < _SAMPLES // 2:
            return None
        points = (feet[side] + middle[side, :, None] * outward[side])[good]
        off = (points - points.mean(axis=0)) @ outward[side]
        slope = np.polynomial.Polynomial.fit((points - points.mean(axis=0)) @ along[side], off, 1)
        off = off - slope((points - points.mean(axis=0)) @ along[side])
        near = np.abs(off) <= max(2.5 * float(np.sqrt(np.mean(off**2))), 0.02)
        edges.append(points[near])
        squares.append(np.mean(off[near] ** 2))
    return edges, float(np.sqrt(np.mean(squares)))


def _meeting(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    x, y, w = np.cross(one, other)
    return np.array([x, y]) / w if abs(w) > 1e-9 else np.full(2, np.nan)
