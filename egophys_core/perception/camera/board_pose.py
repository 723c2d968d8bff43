"""Where the camera is, from a tag board on the table: metric, with gravity and the table's height."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.board_alignment import Alignment, BoardPrint

FEWEST_TAGS = 6
"""Tags, in at least two rows and two columns, that a pose needs."""
FEWEST_TAGS_NEAR = 4
"""The same where the pose of a frame shortly before is given."""
LARGEST_UNCERTAINTY = 0.005
"""Metres: a camera whose place is less certain than this is not located."""
LARGEST_TAG_OFFSET = 1.0
"""Pixels, root mean square: more says that the tags do not lie as the board has them."""

_START_TAGS = 4
_COVARIANCE_SCALE = 6.0
"""By how much residuals of neighbouring pixels (JPEG, demosaicing, speckles) make errors larger than if they were
independent: measured, docs/notes/board_pose.md."""
_SHARPENED = 2.5
"""Pixels of the doubled image."""
_DARK = 5
_FLOOR = np.diag([5e-5, 5e-5, 5e-5, 5e-5, 5e-5, 5e-5]) ** 2
"""Added to the covariance, metres and radians squared: no board is printed and no lens calibrated better than this."""
FOCAL_TOLERANCE = 0.005
"""A focal length off by more than this makes the camera miss by 5 mm and more at a metre."""
GROWTH_TOLERANCE = 0.01
"""Ink that spreads and exposure change a tag of 30 pixels by less."""
DOUBTFUL_TAG_OFFSET = 0.1
"""Pixels, root mean square, half of the frames: measured 0.02 to 0.03 on good video, 0.06 to 0.15 with wrong lenses."""


@dataclass(frozen=True, kw_only=True)
class CameraPose:
    """Where a camera is, and how certain that is."""

    world_from_camera: np.ndarray
    """[4, 4] float64, metres."""
    covariance: np.ndarray
    """[6, 6] float64, world: of the camera's place, metres, and of a small rotation vector that turns the camera in
    the world, radians."""
    tags: np.ndarray
    """[K] int: ids of the tags it comes from."""
    rms_pixels: float
    """By how much the tags, each by itself, lie beside where this pose has them: root mean square."""
    tag_growth: float
    """Share by which the tags look larger than this pose has them, against their spacing."""
    blur: float
    """Standard deviation of the image's blur, pixels."""
    log_focal: tuple[float, float]
    """By what the tags would have the logarithm of the focal length changed, and its standard deviation."""


@dataclass(frozen=True, kw_only=True)
class NoPose:
    """A frame whose camera is not located."""

    reason: str
    """What was seen and what was needed."""


class BoardPoseFinder:
    """Finds a board in pinhole images of one camera; the same image gives the same pose."""

    def __init__(self, board: Board, camera_matrix: np.ndarray) -> None:
        """Make a finder.

        Args:
            board: what lies on the table.
            camera_matrix: [3, 3] K of the pinhole images (`FullView.matrix`: the whole image at its own resolution).
        """
        self._board = board
        self._matrix = np.asarray(camera_matrix, dtype=np.float64)
        self._print = BoardPrint(board)
        parameters = cv2.aruco.DetectorParameters()
        # Half a pixel of bias at worst, which the print corrects; the others find fewer tags or take longer.
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        parameters.cornerRefinementWinSize = 3
        self._detector = cv2.aruco.ArucoDetector(board.dictionary, parameters)

    def find(self, image: np.ndarray, near: CameraPose | None = None) -> CameraPose | NoPose:
        """The camera's pose in an image.

        Args:
            image: [H, W, 3] uint8 BGR or [H, W] uint8, pinhole.
            near: the pose of a frame shortly before, with which fewer tags suffice.
        """
        gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        tags, corners = self._detect(gray)
        if len(tags) < FEWEST_TAGS:
            # Blurred or distant tags are found at twice the size, sharpened; the fit uses the image as it is.
            large = cv2.resize(gray, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
            sharp = cv2.addWeighted(large, 3, cv2.GaussianBlur(large, (0, 0), _SHARPENED), -2, 0)
            others, places = self._detect(sharp)
            if len(others) > len(tags):
                tags, corners = others, (places + 0.5) / 2 - 0.5
        if len(tags) == 0:
            return NoPose(reason=_why_no_tags(gray))
        needed = FEWEST_TAGS if near is None else FEWEST_TAGS_NEAR
        start = self._start(tags, corners, near)
        if start is None:
            return NoPose(reason=f"only {len(tags)} tags found, a start needs {_START_TAGS}")
        fit = self._print.align(gray.astype(np.float32), self._matrix, start)
        if fit is None:
            return NoPose(reason=f"{len(tags)} tags found, but the board's print does not match the image around them")
        if not self._is_spread(fit.tags, needed):
            return NoPose(
                reason=f"{len(fit.tags)} tags match the print, needed are {needed} in two rows and two columns"
            )
        return self._judge(fit)

    def mirrored_tags(self, image: np.ndarray) -> int:
        """How many of the board's tags an image [H, W, 3] uint8 shows as a mirror does."""
        gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        return len(self._detect(cv2.flip(gray, 1))[0])

    def _detect(self, gray: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Indices [K] of this board's tags and their corners [K, 4, 2], pixels, clockwise from the upper left."""
        corners, ids, _ = self._detector.detectMarkers(gray)
        if ids is None:
            return np.zeros(0, int), np.zeros((0, 4, 2))
        tags = ids.reshape(-1).astype(int) - self._board.first_id
        places = np.array(corners, dtype=np.float64).reshape(-1, 4, 2)
        # A tag seen twice is one on the table and one elsewhere; which is which is not known.
        counts = np.bincount(np.clip(tags, 0, None), minlength=1)
        known = (tags >= 0) & (tags < self._board.columns * self._board.rows)
        known[known] &= counts[tags[known]] == 1
        return tags[known], places[known]

    def _start(self, tags: np.ndarray, corners: np.ndarray, near: CameraPose | None) -> np.ndarray | None:
        """Camera from board [4, 4] from the corners of tags."""
        square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * self._board.tag_side
        flat = (self._board.tag_corners[tags][:, None] + square).reshape(-1, 2)
        objects, images = np.column_stack([flat, np.zeros(len(flat))]), corners.reshape(-1, 2)
        if len(tags) >= _START_TAGS:
            found, rotation, translation = cv2.solvePnP(objects, images, self._matrix, None, flags=cv2.SOLVEPNP_SQPNP)
            if not found:
                return None
        elif near is not None:
            expected = np.linalg.inv(near.world_from_camera) @ self._board.world_from_board
            rotation, translation = cv2.Rodrigues(expected[:3, :3])[0], expected[:3, 3:].copy()
        else:
            return None
        rotation, translation = cv2.solvePnPRefineLM(objects, images, self._matrix, None, rotation, translation)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(rotation)[0], translation[:, 0]
        return pose if np.isfinite(pose).all() else None

    def _is_spread(self, tags: np.ndarray, needed: int) -> bool:
        rows, columns = tags // self._board.columns, tags % self._board.columns
        return len(tags) >= needed and len(set(rows)) > 1 and len(set(columns)) > 1

    def _judge(self, fit: Alignment) -> CameraPose | NoPose:
        world_from_camera = self._board.world_from_board @ np.linalg.inv(fit.camera_from_board)
        # The board moves by (v, w) in the camera's frame, so the camera moves by -v and turns by -w in it.
        rotation = world_from_camera[:3, :3]
        to_world = np.kron(np.eye(2), rotation)
        covariance = _COVARIANCE_SCALE * to_world @ fit.covariance @ to_world.T + _FLOOR
        uncertainty = float(np.sqrt(np.trace(covariance[:3, :3])))
        rms = float(np.sqrt(np.mean(np.sum(fit.tag_offsets**2, axis=1))))
        if uncertainty > LARGEST_UNCERTAINTY:
            return NoPose(
                reason=f"the camera's place is uncertain by {1000 * uncertainty:.1f} mm, allowed are "
                f"{1000 * LARGEST_UNCERTAINTY:.0f} (blur {fit.blur:.1f} pixels, noise {fit.noise:.0f} of 255)"
            )
        if rms > LARGEST_TAG_OFFSET:
            return NoPose(
                reason=f"the {len(fit.tags)} tags lie {rms:.1f} pixels (rms) from where one board seen by this "
                "camera has them; check the board's layout, that it is flat, and the intrinsics"
            )
        return CameraPose(
            world_from_camera=world_from_camera,
            covariance=covariance,
            tags=fit.tags + self._board.first_id,
            rms_pixels=rms,
            tag_growth=fit.tag_growth,
            blur=fit.blur,
            log_focal=(fit.log_focal[0], float(np.sqrt(_COVARIANCE_SCALE)) * fit.log_focal[1]),
        )


def _why_no_tags(gray: np.ndarray) -> str:
    brightness = float(gray.mean())
    if brightness < _DARK:
        return f"no tags found: the image is black (mean brightness {brightness:.0f} of 255)"
    return f"no tags found: the board is hidden, out of view or too blurred (mean brightness {brightness:.0f} of 255)"


def intrinsics_warning(poses: Sequence[CameraPose]) -> str | None:
    """What the tags of all frames say against the intrinsics or the board's layout; None if they agree."""
    if not poses:
        return None
    if doubts_focal(poses):
        error, deviation = focal_error(poses)
        return (
            f"the tags say that the true focal length is {100 * error:+.1f} +- {100 * deviation:.1f} % from "
            "what the CameraInfo has; "
            "distances along the view are wrong by as much: calibrate the camera"
        )
    growth = float(np.median([pose.tag_growth for pose in poses]))
    if abs(growth) > GROWTH_TOLERANCE:
        return (
            f"the tags look {100 * growth:+.1f} % larger, against their spacing, than the board's layout has them; "
            "measure side and gap on the print and give those"
        )
    rms = float(np.median([pose.rms_pixels for pose in poses]))
    if rms > DOUBTFUL_TAG_OFFSET:
        return (
            f"the tags lie {rms:.2f} pixels (rms) from where a flat board of this layout has them, usual are 0.03; "
            "measure the print, lay it flat, or calibrate the camera"
        )
    return None


def doubts_focal(poses: Sequence[CameraPose]) -> bool:
    """Whether the tags of all frames say with certainty that the focal length is another."""
    error, deviation = focal_error(poses)
    return abs(error) > max(FOCAL_TOLERANCE, 5 * deviation)


def focal_error(poses: Sequence[CameraPose]) -> tuple[float, float]:
    """By what factor minus one the tags would have the focal length changed, and the standard deviation of that.

    A single board hardly tells a focal length from a distance unless it is seen obliquely; all frames together do.
    """
    if not poses:
        return 0.0, float("inf")
    values, deviations = np.array([pose.log_focal for pose in poses]).T
    certainty = 1 / deviations**2
    return float(np.sum(values * certainty) / certainty.sum()), float(1 / np.sqrt(certainty.sum()))
