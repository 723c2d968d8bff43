"""Films of the tag board through any lens, drawn by rays that OpenCV undistorts, not by the product's projection."""

from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.lens import Camera, DistortionModel

_TEXEL_M = 0.00025
_SAMPLES = 3


def camera_of(model: str, coefficients: Sequence[float], focal: float, size: tuple[int, int] = (640, 480)) -> Camera:
    width, height = size
    matrix = np.array([[focal, 0, width / 2 + 6.3], [0, focal * 1.002, height / 2 - 4.1], [0, 0, 1]])
    return Camera(width=width, height=height, matrix=matrix, model=model, coefficients=coefficients)


def board_poses(count: int, *, tilt: float, distance: float, seed: int = 0) -> Iterator[np.ndarray]:
    """Camera from board, [4, 4] metres, of someone who moves about a board.

    Args:
        count: poses.
        tilt: largest angle between the view and the board's normal, degrees.
        distance: usual, metres.
        seed: of the path.
    """
    rng = np.random.default_rng(seed)
    middle = np.array([*np.array(Board().size) / 2, 0])
    for index in range(count):
        around = 2 * np.pi * index * 0.382
        turn = Rotation.from_rotvec(
            np.radians(tilt) * np.array([np.cos(around), np.sin(around), 0]) * rng.uniform(0.4, 1)
        )
        turn = Rotation.from_rotvec([0, 0, rng.uniform(-0.5, 0.5)]) * turn
        away = distance * rng.uniform(0.75, 1.25)
        pose = np.eye(4)
        pose[:3, :3] = turn.as_matrix()
        place = np.array([*rng.uniform(-0.25, 0.25, 2) * away, away])
        pose[:3, 3] = place - pose[:3, :3] @ middle
        yield pose


def board_film(
    camera: Camera, poses: Iterator[np.ndarray], *, blur: float = 0.6, noise: float = 2.0
) -> Iterator[np.ndarray]:
    """Images [H, W, 3] uint8 of the default board."""
    rng = np.random.default_rng(5)
    board = Board()
    paper = _printed(board)
    rays = _rays(camera)
    for pose in poses:
        # A ray meets the board's plane where the homography from board to normalised image takes it back.
        back = np.linalg.inv(np.column_stack([pose[:3, 0], pose[:3, 1], pose[:3, 3]]))
        places = rays @ back.T
        behind = places[..., 2] <= 0
        xy = places[..., :2] / places[..., 2:]
        texels = ((xy + board.gap) / _TEXEL_M - 0.5).astype(np.float32)
        texels[behind] = -10
        image = cv2.remap(paper, texels[..., 0], texels[..., 1], cv2.INTER_LINEAR, borderValue=120)
        image = cv2.resize(image, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
        image = cv2.GaussianBlur(image, (0, 0), blur) + rng.normal(0, noise, image.shape)
        yield cv2.cvtColor(image.clip(0, 255).round().astype(np.uint8), cv2.COLOR_GRAY2BGR)


def _rays(camera: Camera) -> np.ndarray:
    """[H samples, W samples, 3]: directions of the samples of each pixel, z = 1."""
    along = [(np.arange(each * _SAMPLES) + 0.5) / _SAMPLES - 0.5 for each in (camera.width, camera.height)]
    pixels = np.stack(np.meshgrid(*along), axis=-1).reshape(-1, 1, 2)
    if camera.model == DistortionModel.EQUIDISTANT:
        flat = cv2.fisheye.undistortPoints(pixels, camera.matrix, camera.coefficients)
    else:
        precise = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-8)
        flat = cv2.undistortPointsIter(pixels, camera.matrix, camera.coefficients, None, None, precise)
    shape = (camera.height * _SAMPLES, camera.width * _SAMPLES, 1)
    return np.dstack([flat[:, 0].reshape(*shape[:2], 2), np.ones(shape)])


def _printed(board: Board) -> np.ndarray:
    width, height = (round((extent + 2 * board.gap) / _TEXEL_M) for extent in board.size)
    paper = np.full((height, width), 215, np.float32)
    cell = board.tag_side / board.cells_per_tag / _TEXEL_M
    for tag, corner in enumerate(board.tag_corners):
        x, y = np.rint((corner + board.gap) / _TEXEL_M).astype(int)
        side = round(cell * board.cells_per_tag)
        white = board.cells(tag)[(np.arange(side) / cell).astype(int)][:, (np.arange(side) / cell).astype(int)]
        paper[y : y + side, x : x + side] = np.where(white, 215, 25)
    return paper
