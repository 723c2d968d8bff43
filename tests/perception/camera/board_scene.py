"""Images of a tag board whose camera pose is known: drawn by many rays a pixel, not by the product's code."""

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.perception.camera.board import Board

SIZE = 640
MATRIX = np.array([[577.3, 0, 319.5], [0, 577.3, 319.5], [0, 0, 1.0]])


def look_at(eye: tuple[float, float, float], target: tuple[float, float, float], roll: float = 0.0) -> np.ndarray:
    """[4, 4] world from camera, looking from one place at another, rolled about the view by `roll` radians."""
    forward = np.subtract(target, eye) / np.linalg.norm(np.subtract(target, eye))
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = (
        np.column_stack([right, np.cross(forward, right), forward]) @ Rotation.from_rotvec([0, 0, roll]).as_matrix()
    )
    pose[:3, 3] = eye
    return pose


def random_pose(random: np.random.Generator) -> np.ndarray:
    """A pose as of a person at the table: 0.45 to 0.8 m up, board in the upper half of the image."""
    eye = random.uniform([-0.25, -0.6, 0.4], [0.25, -0.25, 0.75])
    target = random.uniform([-0.08, 0.05, 0], [0.08, 0.25, 0])
    return look_at(tuple(eye), tuple(target), roll=random.uniform(-0.2, 0.2))


def board_image(
    board: Board,
    world_from_camera: np.ndarray,
    random: np.random.Generator,
    *,
    matrix: np.ndarray = MATRIX,
    size: int = SIZE,
    blur: float = 0.6,
    noise: float = 2.0,
    exposure: float = 1.0,
    jpeg: int | None = 92,
    samples: int = 6,
    shading: float = 0.2,
) -> np.ndarray:
    """[size, size, 3] uint8: the board on a speckled table, each pixel the mean of samples x samples rays.

    Args:
        board: what to draw.
        world_from_camera: [4, 4].
        random: of speckles and noise.
        matrix: [3, 3] K.
        size: pixels.
        blur: standard deviation of the lens blur, pixels.
        noise: standard deviation, grey levels.
        exposure: factor on all.
        jpeg: quality; None for none.
        samples: rays along each side of a pixel.
        shading: how much darker the table's right side is than its left.
    """
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    along = (np.arange(size)[:, None] + offsets).ravel()
    cells = np.stack([board.cells(tag) for tag in range(board.columns * board.rows)])
    speckles = random.uniform(0.75, 1.0, (997, 991))
    image = np.zeros((size, size))
    inverse = np.linalg.inv(matrix)
    for band in range(0, size, 64):
        rows = (np.arange(band, min(band + 64, size))[:, None] + offsets).ravel()
        u, v = np.meshgrid(along, rows)
        rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ (world_from_camera[:3, :3] @ inverse).T
        eye = world_from_camera[:3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (board.origin[2] - eye[2]) / rays[..., 2]
        reach[~(reach > 0)] = np.nan
        x, y = eye[0] + reach * rays[..., 0], eye[1] + reach * rays[..., 1]
        value = _table(x, y, speckles)
        _draw_board(value, board, cells, x, y)
        value = value * (1 - shading * np.clip(np.nan_to_num(x) + 0.5, 0, 1))
        value[np.isnan(reach)] = 0
        image[band : band + 64] = value.reshape(-1, samples, size, samples).mean(axis=(1, 3))
    image = cv2.GaussianBlur(image, (0, 0), blur) if blur > 0 else image
    image = np.clip(exposure * image + random.normal(0, noise, image.shape), 0, 255).round().astype(np.uint8)
    coloured = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    if jpeg is None:
        return coloured
    done, coded = cv2.imencode(".jpg", coloured, [cv2.IMWRITE_JPEG_QUALITY, jpeg])
    assert done
    return cv2.imdecode(coded, cv2.IMREAD_COLOR)


def board_pixels(board: Board, places: np.ndarray, world_from_camera: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """[N, 2] pixels of places [N, 2] on the board, board coordinates in metres."""
    flat = np.column_stack([places, np.zeros(len(places)), np.ones(len(places))])
    seen = flat @ board.world_from_board.T @ np.linalg.inv(world_from_camera).T
    pixels = seen[:, :3] @ matrix.T
    return pixels[:, :2] / pixels[:, 2:]


def pose_error(found: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Metres between the centres and degrees between the orientations of two poses [4, 4]."""
    turn = Rotation.from_matrix(found[:3, :3].T @ true[:3, :3]).magnitude()
    return float(np.linalg.norm(found[:3, 3] - true[:3, 3])), float(np.degrees(turn))


def _table(x: np.ndarray, y: np.ndarray, speckles: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        i = np.nan_to_num(x / 0.004, posinf=0, neginf=0).astype(np.int64) % speckles.shape[1]
        j = np.nan_to_num(y / 0.004, posinf=0, neginf=0).astype(np.int64) % speckles.shape[0]
    return 150 * speckles[j, i]


def _draw_board(value: np.ndarray, board: Board, cells: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
    bx, by = x - board.origin[0], board.origin[1] - y
    width, height = board.size
    edge = board.gap
    paper = (bx > -edge) & (bx < width + edge) & (by > -edge) & (by < height + edge)
    value[paper] = 215
    pitch = board.tag_side + board.gap
    bx, by = np.where(paper, bx, -1), np.where(paper, by, -1)
    column, row = np.floor(bx / pitch).astype(int), np.floor(by / pitch).astype(int)
    in_x, in_y = bx - column * pitch, by - row * pitch
    ink = paper & (column >= 0) & (row >= 0) & (column < board.columns) & (row < board.rows)
    ink &= (in_x < board.tag_side) & (in_y < board.tag_side)
    size = board.tag_side / board.cells_per_tag
    white = cells[(row * board.columns + column)[ink], (in_y[ink] / size).astype(int), (in_x[ink] / size).astype(int)]
    value[ink] = np.where(white, 215, 25)
