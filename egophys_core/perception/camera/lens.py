"""Camera of a video and the undistorted pinhole views made of its images, with exact intrinsics.

Pixel centres are at integer coordinates: a W x H image covers -0.5 .. W-0.5 by -0.5 .. H-0.5.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import cv2
import numpy as np

from egophys_core.errors import EpisodeError

SQUARE_SIDE = 518
"""Pixels: the paper's input size (Appendix B.1), a multiple of 14 as VGGT needs."""

_SHRINK_SMOOTHED = 1.5
"""Images that shrink by more than this are smoothed first; at less, bilinear sampling does not alias visibly."""


SHORTEST_FOCAL, LONGEST_FOCAL = 0.05, 100.0
"""Focal lengths in widths of the picture's longer side: a fisheye has 0.2, a long telephoto lens 30."""

_MOST_STRETCHED = 10.0
"""Times as far apart as in the picture without its distortion that points may be, at the median."""


class DistortionModel(StrEnum):
    """Lens distortion as sensor_msgs/CameraInfo names it."""

    PLUMB_BOB = "plumb_bob"
    """k1 k2 p1 p2 [k3]."""
    RATIONAL_POLYNOMIAL = "rational_polynomial"
    """k1 k2 p1 p2 k3 k4 k5 k6."""
    EQUIDISTANT = "equidistant"
    """Fisheye, k1 k2 k3 k4 (Kannala and Brandt 2006)."""


_COEFFICIENT_COUNTS = {
    DistortionModel.PLUMB_BOB: (4, 5),
    DistortionModel.RATIONAL_POLYNOMIAL: (8,),
    DistortionModel.EQUIDISTANT: (4,),
}


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A calibrated camera; its frame is OpenCV's (x right, y down, z forward)."""

    width: int
    """Pixels."""
    height: int
    """Pixels."""
    matrix: np.ndarray
    """[3, 3] float64 K, pixels."""
    model: DistortionModel = DistortionModel.PLUMB_BOB
    coefficients: np.ndarray
    """[D] float64, of the model; empty stands for zeros, except of a fisheye, which without them is not known."""

    def __post_init__(self) -> None:
        matrix = np.array(self.matrix, dtype=np.float64)
        coefficients = np.array(self.coefficients, dtype=np.float64).reshape(-1)
        if self.width < 1 or self.height < 1:
            raise EpisodeError(f"camera size must be positive, got {self.width} x {self.height}; record the CameraInfo")
        if matrix.shape != (3, 3) or not np.isfinite(matrix).all() or not np.isfinite(coefficients).all():
            raise EpisodeError(
                f"camera matrix must be [3, 3] and it and the distortion finite, got K {matrix.tolist()}, "
                f"D {coefficients.tolist()}; calibrate the camera"
            )
        is_calibrated = matrix[0, 0] > 0 and matrix[1, 1] > 0
        has_zeros = not matrix[[0, 1, 2, 2], [1, 0, 0, 1]].any() and matrix[2, 2] == 1
        if not (is_calibrated and has_zeros):
            raise EpisodeError(
                f"camera matrix must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx, fy > 0 pixels, "
                f"got {matrix.tolist()}; a K of zeros is what an uncalibrated driver publishes: calibrate the camera"
            )
        try:
            model = DistortionModel(self.model)
        except ValueError:
            raise EpisodeError(
                f"distortion model must be one of {', '.join(DistortionModel)}, got {self.model!r}; "
                "calibrate with one of them"
            ) from None
        counts = _COEFFICIENT_COUNTS[model]
        if len(coefficients) == 0 and model != DistortionModel.EQUIDISTANT:
            coefficients = np.zeros(max(counts))
        if len(coefficients) not in counts:
            raise EpisodeError(
                f"distortion {model} has {' or '.join(map(str, counts))} coefficients, got {len(coefficients)}"
            )
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "model", model)
        object.__setattr__(self, "coefficients", coefficients)

    @property
    def is_pinhole(self) -> bool:
        """Whether images of it are pinhole images already."""
        return self.model != DistortionModel.EQUIDISTANT and not self.coefficients.any()

    def project(self, points: np.ndarray) -> np.ndarray:
        """[N, 2] pixels of points [N, 3] in the camera frame, z > 0; any length unit."""
        points = np.asarray(points, dtype=np.float64)
        rays = points[:, :2] / points[:, 2:]
        if self.model == DistortionModel.EQUIDISTANT:
            radius = np.linalg.norm(rays, axis=1)
            angle = np.arctan(radius)
            powers = angle[:, None] ** np.array([2, 4, 6, 8])
            distorted = angle * (1 + powers @ self.coefficients)
            rays = rays * np.where(radius > 1e-12, distorted / np.maximum(radius, 1e-12), 1.0)[:, None]
            return rays @ self.matrix[:2, :2].T + self.matrix[:2, 2]
        if self.is_pinhole:
            return rays @ self.matrix[:2, :2].T + self.matrix[:2, 2]
        flat = np.column_stack([rays, np.ones(len(rays))])
        distorted, _ = cv2.projectPoints(flat, np.zeros(3), np.zeros(3), np.eye(3), self.coefficients)
        return distorted[:, 0] @ self.matrix[:2, :2].T + self.matrix[:2, 2]


def require_plausible(camera: Camera) -> None:
    """Check that a calibration can be that of a camera.

    Raises:
        EpisodeError: its focal length, principal point or distortion are far from those of any; says which.
    """
    longest, remedy = max(camera.width, camera.height), "calibrate the camera at this size, in pixels"
    for axis, name in enumerate("xy"):
        focal, centre = float(camera.matrix[axis, axis]), float(camera.matrix[axis, 2])
        size = (camera.width, camera.height)[axis]
        if not SHORTEST_FOCAL * longest <= focal <= LONGEST_FOCAL * longest:
            raise EpisodeError(
                f"camera matrix: focal length f{name} = {focal:g} pixels, of {camera.width} x {camera.height} it is "
                f"{SHORTEST_FOCAL * longest:g} .. {LONGEST_FOCAL * longest:g}; {remedy}"
            )
        if not -size <= centre <= 2 * size:
            raise EpisodeError(
                f"camera matrix: principal point c{name} = {centre:g} pixels is more than a picture beside the "
                f"{camera.width} x {camera.height} one; {remedy}"
            )
    if camera.is_pinhole:
        return
    with np.errstate(all="ignore"):
        _inner_square(camera)
        # Points of the picture without its distortion, evenly strewn.
        x, y = (np.linspace(0.0, size - 1.0, 33) for size in (camera.width, camera.height))
        pixels = np.stack([*np.meshgrid(x, y), np.ones((33, 33))], axis=-1)
        places = camera.project(pixels.reshape(-1, 3) @ np.linalg.inv(camera.matrix).T).reshape(33, 33, 2)
        stretch = np.sqrt(_cell_area(places) / _cell_area(pixels[..., :2]))
    if not stretch <= _MOST_STRETCHED:
        raise EpisodeError(
            f"the distortion {camera.model} {camera.coefficients.tolist()} stretches the picture {stretch:.3g} times; "
            "the calibration is not of this camera, calibrate again"
        )


def camera_from_message(message: Any, *, source: str) -> Camera:
    """The camera that a sensor_msgs/CameraInfo message object (rclpy's or rosbags') describes.

    Args:
        message: the message; K, D, size and model are read, R and P (of stereo rectification) are not.
        source: where it came from, for error messages.

    Raises:
        EpisodeError: no calibration in it, or one of a binned or cropped image.
    """
    lower = {name.lower(): getattr(message, name) for name in ("d", "k", "D", "K") if hasattr(message, name)}
    roi = message.roi
    if max(int(message.binning_x), int(message.binning_y)) > 1 or roi.x_offset or roi.y_offset:
        raise EpisodeError(
            f"{source}: CameraInfo of a binned or cropped image (binning {message.binning_x} x {message.binning_y}, "
            f"offset {roi.x_offset}, {roi.y_offset}) is not read; record the full image, or a CameraInfo of the image"
        )
    try:
        camera = Camera(
            width=int(message.width),
            height=int(message.height),
            matrix=np.array(lower["k"], dtype=np.float64).reshape(3, 3),
            model=message.distortion_model or DistortionModel.PLUMB_BOB,
            coefficients=np.array(lower["d"], dtype=np.float64),
        )
        require_plausible(camera)
        return camera
    except EpisodeError as error:
        raise EpisodeError(f"{source}: {error}") from error


def require_size(camera: Camera, image: np.ndarray, *, source: str) -> None:
    """Check that the intrinsics belong to an image [H, W] or [H, W, 3].

    Raises:
        EpisodeError: the sizes differ; says both.
    """
    height, width = image.shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise EpisodeError(
            f"{source}: the CameraInfo is of {camera.width} x {camera.height} images, these are {width} x {height}; "
            "record the CameraInfo that belongs to this image topic, or calibrate at this size"
        )


def upright_turns(world_from_camera: np.ndarray) -> int:
    """Counter-clockwise quarter turns (0..3) of the image after which world z points up in it most nearly.

    Args:
        world_from_camera: [4, 4] pose of the camera as recorded. For one that looks straight down up is nowhere: 0.
    """
    up = np.asarray(world_from_camera, dtype=np.float64)[2, :2]
    # A counter-clockwise turn takes the image direction (x, y) to (y, -x); -y is up.
    upness = [-up[1], up[0], up[1], -up[0]]
    best = int(np.argmax(upness))
    return best if upness[best] > upness[0] + 1e-9 else 0


def turn_rotation(turns: int) -> np.ndarray:
    """[4, 4] raw camera from turned camera: the rotation about the optical axis of `turns` quarter turns (exact)."""
    quarter = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], dtype=np.float64)
    return np.linalg.matrix_power(quarter, turns % 4)


class PinholeView:
    """Images of a camera as a pinhole camera would take them, by one remapping.

    Attributes:
        matrix: [3, 3] float64 K of the view, pixels: projecting with it gives the true place in `image(...)`.
        width, height: pixels of the view.
        turns: counter-clockwise quarter turns of the view against the recorded image.
    """

    matrix: np.ndarray
    width: int
    height: int
    turns: int

    def __init__(self, camera: Camera, *, matrix: np.ndarray, size: tuple[int, int], turns: int = 0) -> None:
        self.matrix = matrix
        self.width, self.height = size
        self.turns = turns % 4
        self._camera = camera
        self._is_identity = camera.is_pinhole and self.turns == 0 and np.array_equal(matrix, camera.matrix)
        self._is_identity &= size == (camera.width, camera.height)
        self._sigma = 0.0
        if not self._is_identity:
            grid = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).reshape(-1, 2)
            places = camera.project(self._rays(grid)).reshape(size[1], size[0], 2)
            self._map_x, self._map_y = places[..., 0].astype(np.float32), places[..., 1].astype(np.float32)
            shrink = float(np.sqrt(_cell_area(places)))
            if shrink > _SHRINK_SMOOTHED:
                # The blur that makes a pixel of the recorded image as wide as one of the view.
                self._sigma = 0.5 * float(np.sqrt(shrink**2 - 1))

    def image(self, bgr: np.ndarray) -> np.ndarray:
        """The view of a recorded image [H, W, 3] or [H, W] uint8; black where the recorded image does not reach.

        Raises:
            EpisodeError: the image is not of the camera's size.
        """
        require_size(self._camera, bgr, source="image")
        if self._is_identity:
            return bgr
        if self._sigma > 0:
            bgr = cv2.GaussianBlur(bgr, (0, 0), self._sigma)
        # Bicubic: bilinear sampling blurs by up to half a pixel, by an amount that depends on the place.
        return np.asarray(cv2.remap(bgr, self._map_x, self._map_y, cv2.INTER_CUBIC))

    def from_raw_pose(self, world_from_camera: np.ndarray) -> np.ndarray:
        """[..., 4, 4] pose of this view's camera, from the pose of the camera as recorded."""
        return np.asarray(world_from_camera, dtype=np.float64) @ turn_rotation(self.turns)

    def to_raw_pose(self, world_from_view: np.ndarray) -> np.ndarray:
        """[..., 4, 4] pose of the camera as recorded, from the pose of this view's camera."""
        return np.asarray(world_from_view, dtype=np.float64) @ turn_rotation(-self.turns)

    def _rays(self, pixels: np.ndarray) -> np.ndarray:
        """[N, 3] directions, z = 1, in the frame of the camera as recorded, of view pixels [N, 2]."""
        homogeneous = np.column_stack([pixels, np.ones(len(pixels))])
        return homogeneous @ (turn_rotation(self.turns)[:3, :3] @ np.linalg.inv(self.matrix)).T


class SquareView(PinholeView):
    """Upright S x S view: undistorted, turned, cropped to the largest centred square fully inside the image, resized.

    The square keeps the focal length, and is at most as wide as the recorded image is in its shorter direction, so
    that the middle of a fisheye image is not shrunk for the sake of its rim.
    """

    def __init__(self, camera: Camera, *, turns: int = 0, side: int = SQUARE_SIDE) -> None:
        """Make the view.

        Args:
            camera: of the images.
            turns: counter-clockwise quarter turns, from `upright_turns`.
            side: S, pixels.

        Raises:
            EpisodeError: the distortion folds the image, so that no square of it can be undistorted.
        """
        crop = _inner_square(camera)
        scale = side / crop
        middle = np.array([camera.width - 1, camera.height - 1]) / 2
        matrix = camera.matrix.copy()
        matrix[:2, :2] *= scale
        matrix[:2, 2] = (matrix[:2, 2] - middle) * scale + (side - 1) / 2
        for _ in range(turns % 4):
            matrix = turned_matrix(matrix, side)
        super().__init__(camera, matrix=matrix, size=(side, side), turns=turns)


class FullView(PinholeView):
    """The whole recorded image undistorted, not turned, cropped or resized: what camera poses are found in."""

    def __init__(self, camera: Camera) -> None:
        super().__init__(camera, matrix=camera.matrix.copy(), size=(camera.width, camera.height))


def turned_matrix(matrix: np.ndarray, width: int) -> np.ndarray:
    """K after one counter-clockwise turn of an image of this width, in the frame of the camera so turned."""
    # A pixel (x, y) moves to (y, width - 1 - x).
    pixels = np.array([[0, 1, 0], [-1, 0, width - 1], [0, 0, 1]], dtype=np.float64)
    turned = pixels @ matrix @ turn_rotation(1)[:3, :3]
    return np.asarray(turned / turned[2, 2])


def _inner_square(camera: Camera) -> float:
    """Side, pixels at the camera's focal length, of the largest centred square whose rim the recorded image covers."""
    largest = float(min(camera.width, camera.height))
    if camera.is_pinhole:
        return largest
    middle = np.array([camera.width - 1, camera.height - 1]) / 2
    along = np.linspace(-0.5, 0.5, 65)
    rim = np.concatenate(
        [np.column_stack(p) for s in (-0.5, 0.5) for p in ((along, 0 * along + s), (0 * along + s, along))]
    )
    inverse = np.linalg.inv(camera.matrix)

    def is_covered(side: float) -> bool:
        # Sampled at the outermost pixels' centres; a smaller square inside must be covered too (no folding back).
        shares = np.linspace(0.1, 1.0, 10)
        pixels = np.concatenate([middle + rim * (side - 1) * share for share in shares])
        places = camera.project(np.column_stack([pixels, np.ones(len(pixels))]) @ inverse.T)
        inside = (places >= -0.5).all() and (places <= [camera.width - 0.5, camera.height - 0.5]).all()
        radius = np.linalg.norm(places - camera.matrix[:2, 2], axis=1).reshape(len(shares), -1)
        return bool(inside and (np.diff(radius.mean(axis=1)) > 0).all())

    low, high = 0.0, largest
    if is_covered(high):
        return high
    while high - low > 0.01:
        side = (low + high) / 2
        low, high = (side, high) if is_covered(side) else (low, side)
    if low < largest / 4:
        raise EpisodeError(
            f"the distortion {camera.model} {camera.coefficients.tolist()} leaves a square of {low:.0f} pixels of a "
            f"{camera.width} x {camera.height} image; the calibration is not of this camera, calibrate again"
        )
    return low


def _cell_area(places: np.ndarray) -> float:
    """Median area, recorded pixels, that a pixel of the view covers; `places` [H, W, 2] are its recorded pixels."""
    right = np.diff(places, axis=1)[:-1]
    down = np.diff(places, axis=0)[:, :-1]
    return float(np.median(np.abs(right[..., 0] * down[..., 1] - right[..., 1] * down[..., 0])))
