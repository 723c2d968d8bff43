"""Drawn egocentric videos with exact truth: a folded sheet or a pushed dome, a hand, a tag board, a swaying camera.

Nothing of perception's own projection or rendering is used: surfaces are sampled densely and the nearest sample is
seen, three by three samples a pixel; table and board are warped planes.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.cli.perception_benchmark import MASK_TYPE, POSE_TYPE, TRUE_MASK_TOPIC, TRUE_POSE_TOPIC
from egophys_core.perception.camera.board import Board
from egophys_core.recording import CONTROLLER_TOPIC, OBJECT_TOPIC, LogWriter, encode_points, jazzy_types
from egophys_core.recording.camera_messages import INFO_TYPE, pinhole_info, stamped_header
from egophys_core.recording.pointcloud import POINTCLOUD2

SIZE, FOCAL, RATE = 640, 577.0, 30.0
"""Pixels, pixels, frames a second: those of the recorded videos."""
MATRIX = np.array([[FOCAL, 0, (SIZE - 1) / 2], [0, FOCAL, (SIZE - 1) / 2], [0, 0, 1.0]])
START_NS = 1_700_000_000_000_000_000
SAMPLES = 3
"""Along each side of a pixel."""
GRIP_S, RISE_S = 1.2, 1.5
"""The hand arrives at GRIP_S and has done its work RISE_S later."""
NOISE, JPEG_QUALITY = 2.0, 92

_TEXELS = 512
_TEXEL_M = 0.0005
_SUN = np.array([0.35, -0.25, 1.0])
_VISIBLE_M = 0.003
_IMAGE, _INFO = "/ego/image_raw/compressed", "/ego/camera_info"

Shape = Callable[[np.ndarray, float], np.ndarray]
"""Places [N, 3] in metres of material points [N, 2], each coordinate in -1 .. 1, after `share` (0..1) of the motion."""


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """One frame and its truth."""

    stamp_ns: int
    image: np.ndarray
    """[640, 640, 3] uint8 BGR."""
    object_mask: np.ndarray
    """[640, 640] bool: most of the pixel shows the object."""
    world_from_camera: np.ndarray
    """[4, 4] metres."""
    points: np.ndarray
    """[N, 3] metres: material points of the object."""
    visible: np.ndarray
    """[N] bool."""
    hand: np.ndarray
    """[C, 3] metres: points on the hand."""


def folded_sheet(material: np.ndarray, share: float) -> np.ndarray:
    """A sheet of 260 x 200 mm whose right part bends up around a cylinder of 40 mm, keeping all lengths."""
    along, across = 0.13 * material[:, 0], 0.10 * material[:, 1]
    crease, radius, angle = 0.02, 0.04, 1.75 * share
    beyond = np.maximum(along - crease, 0.0)
    bent = np.minimum(beyond / radius, angle)
    straight = beyond - bent * radius
    x = np.minimum(along, crease) + radius * np.sin(bent) + straight * np.cos(bent)
    z = radius * (1 - np.cos(bent)) + straight * np.sin(bent)
    return np.column_stack([x, across, 0.003 + z])


def pushed_dome(material: np.ndarray, share: float) -> np.ndarray:
    """A dome of 160 x 130 mm, 80 mm high, that slides 60 mm to the left and turns by 20 degrees."""
    # The square of material points is wrapped onto the disc row by row of squares, then lifted.
    largest = np.abs(material).max(axis=1)
    length = np.maximum(np.linalg.norm(material, axis=1), 1e-12)
    disc = material * (largest / length)[:, None]
    polar = largest * np.pi / 2
    reach = np.divide(np.sin(polar), np.maximum(largest, 1e-12))
    x, y = 0.080 * disc[:, 0] * reach, 0.065 * disc[:, 1] * reach
    turn = 0.35 * share
    return np.column_stack(
        [x * np.cos(turn) - y * np.sin(turn) - 0.06 * share, x * np.sin(turn) + y * np.cos(turn), 0.080 * np.cos(polar)]
    )


SCENES: dict[str, tuple[Shape, tuple[int, int, int], np.ndarray]] = {
    "drawn_fold": (folded_sheet, (170, 130, 70), np.array([0.98, 0.0])),
    "drawn_push": (pushed_dome, (80, 150, 90), np.array([0.9, 0.0])),
}
"""Shape, colour (BGR) and the material point that the hand comes to."""


def draw_video(name: str, frames: Iterable[int] = range(90)) -> Iterator[Drawing]:
    """Frames of a scene of `SCENES`, at 30 a second; the motion ends at frame 81."""
    scene = _Scene(*SCENES[name], Board())
    for frame in frames:
        yield scene.draw(frame)


def write_bag(folder: Path, drawings: Iterable[Drawing]) -> Path:
    """Write drawings as a rosbag2 folder: video, exact points where visible, true poses and masks."""
    with LogWriter(folder) as log:
        for topic, type_name in (
            (_IMAGE, MASK_TYPE),
            (_INFO, INFO_TYPE),
            (OBJECT_TOPIC, POINTCLOUD2),
            (CONTROLLER_TOPIC, POINTCLOUD2),
            (TRUE_POSE_TOPIC, POSE_TYPE),
            (TRUE_MASK_TOPIC, MASK_TYPE),
        ):
            log.add_topic(topic, type_name)
        for drawing in drawings:
            for topic, message in _messages(drawing):
                log.write(topic, message, drawing.stamp_ns)
    return folder


class _Scene:
    """Textures and material points of a scene."""

    def __init__(self, shape: Shape, colour: tuple[int, int, int], held: np.ndarray, board: Board) -> None:
        rng = np.random.default_rng(4)
        self._shape, self._held = shape, held
        grid = np.linspace(-1, 1, 1000)
        self._dense = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
        texture = np.array(colour) * (1 + 0.22 * _clouds(rng, 24) + 0.16 * _clouds(rng, 9))[..., None]
        texture[:, :, 2] *= 1 + 0.25 * _clouds(rng, 40)
        texels = ((self._dense + 1) / 2 * (_TEXELS - 1)).round().astype(int)
        self._colours = texture.clip(5, 250)[texels[:, 1], texels[:, 0]].astype(np.float32)
        steps = np.linspace(-0.99, 0.99, 33)
        self._material = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        shade = 1 + 0.03 * _clouds(rng, 32) - 0.2 * (_clouds(rng, 2) > 1.6)
        self._table = (shade[..., None] * np.array([135, 165, 190])).clip(0, 255).astype(np.float32)
        self._board, self._print = board, _printed(board)

    def draw(self, frame: int) -> Drawing:
        seconds = frame / RATE
        share = float(np.clip((seconds - GRIP_S) / RISE_S, 0, 1))
        share = share * share * (3 - 2 * share)
        pose = camera_pose(seconds)
        rng = np.random.default_rng([7, frame])
        places = self._shape(self._dense, share)
        hand, hand_colours, marks = self._hand(seconds, share)

        image = self._planes(pose)
        image *= self._shadow(np.vstack([places, hand]), pose)[..., None]
        lit = self._colours * _lambert(places.reshape(1000, 1000, 3)).reshape(-1, 1)
        depth, nearest = _nearest_samples(np.vstack([places, hand]), pose)
        seen = nearest >= 0
        image[seen] = np.vstack([lit, hand_colours])[nearest[seen]]
        is_object = seen & (nearest < len(places))

        image = cv2.resize(image, (SIZE, SIZE), interpolation=cv2.INTER_AREA)
        image = cv2.GaussianBlur(image, (0, 0), 0.5) * (1 + 0.08 * np.sin(2.1 * seconds))
        image += rng.normal(0, NOISE, image.shape)
        share_of_pixel = cv2.resize(is_object.astype(np.float32), (SIZE, SIZE), interpolation=cv2.INTER_AREA)
        points = self._shape(self._material, share)
        return Drawing(
            stamp_ns=START_NS + round(seconds * 1e9),
            image=image.clip(0, 255).round().astype(np.uint8),
            object_mask=share_of_pixel > 0.5,
            world_from_camera=pose,
            points=points,
            visible=_is_visible(points, pose, depth),
            hand=marks,
        )

    def _hand(self, seconds: float, share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Samples of a capsule and their colours, and a few points on it."""
        tip = self._shape(self._held[None], share)[0] + [0.012, 0, 0.016]
        tip = tip + np.array([0.30, -0.10, 0.08]) * np.clip((GRIP_S - seconds) / 0.6, 0, 1)
        axis = np.array([0.75, -0.45, 0.5]) / np.linalg.norm([0.75, -0.45, 0.5])
        side = np.cross(axis, [0, 0, 1]) / np.linalg.norm(np.cross(axis, [0, 0, 1]))
        along, around = (each.ravel() for each in np.meshgrid(np.linspace(-1, 1, 900), np.linspace(0, 2 * np.pi, 400)))
        radius = 0.016 * np.where(along < -0.9, np.sqrt(np.clip(1 - ((-0.9 - along) / 0.1) ** 2, 0, 1)), 1)
        height = np.where(along < -0.9, -0.016 * (-0.9 - along) / 0.1, 0.22 * (along + 0.9) / 1.9)
        outward = np.cos(around)[:, None] * side + np.sin(around)[:, None] * np.cross(axis, side)
        samples = tip + height[:, None] * axis + radius[:, None] * outward
        shade = 0.65 + 0.35 * (outward @ (_SUN / np.linalg.norm(_SUN))).clip(0, 1)
        colours = (shade[:, None] * np.array([140, 165, 225])).astype(np.float32)
        chosen = np.flatnonzero(along < -0.7)[:: max(1, np.count_nonzero(along < -0.7) // 30)]
        return samples, colours, samples[chosen]

    def _planes(self, pose: np.ndarray) -> np.ndarray:
        """Table and board, at `SAMPLES` samples a pixel."""
        middle = (_TEXELS - 1) / 2
        table_m = 2.4 / _TEXELS
        table = np.array([[table_m, 0, -table_m * middle], [0, -table_m, table_m * middle], [0, 0, 0], [0, 0, 1]])
        image = _warped(self._table, table, pose, cv2.BORDER_REFLECT)
        border = self._board.gap
        x0, y0, z = self._board.origin[0] - border, self._board.origin[1] + border, self._board.origin[2]
        place = np.array([[_TEXEL_M, 0, x0 + _TEXEL_M / 2], [0, -_TEXEL_M, y0 - _TEXEL_M / 2], [0, 0, z], [0, 0, 1.0]])
        paper = _warped(self._print, place, pose, cv2.BORDER_CONSTANT)
        cover = _warped(np.ones_like(self._print), place, pose, cv2.BORDER_CONSTANT)[..., None]
        return np.asarray(image * (1 - cover) + cv2.cvtColor(paper, cv2.COLOR_GRAY2BGR) * cover)

    def _shadow(self, places: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """[H, W]: by how much the planes are darker for what stands above them."""
        fallen = places - _SUN * (places[:, 2:] / _SUN[2])
        dark = (_nearest_samples(fallen, pose)[1] >= 0).astype(np.uint8)
        dark = cv2.morphologyEx(dark, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
        return np.asarray(1 - 0.4 * cv2.GaussianBlur(dark.astype(np.float32), (0, 0), 2.0 * SAMPLES))


def camera_pose(seconds: float) -> np.ndarray:
    """[4, 4] world from camera of a head that sways over the table."""
    phase = 2 * np.pi * seconds / 2.6
    eye = np.array([0.05 * np.sin(phase), -0.42 + 0.02 * np.sin(2 * phase), 0.56 + 0.02 * np.cos(phase)])
    forward = np.array([0.01 * np.cos(phase), 0.13, 0.0]) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.02 * np.sin(phase), 0, 1])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = eye
    return pose


def _fine(pixels: np.ndarray) -> np.ndarray:
    """Pixels of the image to those of the image with `SAMPLES` samples a pixel; centres at integers in both."""
    return np.asarray((pixels + 0.5) * SAMPLES - 0.5)


def _project(points: np.ndarray, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels [N, 2] and depths [N] metres."""
    seen = (points - pose[:3, 3]) @ pose[:3, :3]
    return seen[:, :2] / seen[:, 2:] * FOCAL + (SIZE - 1) / 2, seen[:, 2]


def _nearest_samples(points: np.ndarray, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth (infinite) and index (-1 where there is none) of the nearest point at each sample of the image."""
    side = SIZE * SAMPLES
    pixels, depths = _project(points, pose)
    columns, rows = np.rint(_fine(pixels)).astype(int).T
    order = np.flatnonzero((columns >= 0) & (rows >= 0) & (columns < side) & (rows < side))
    order = order[np.argsort(-depths[order], kind="stable")]
    nearest = np.full(side * side, -1)
    nearest[rows[order] * side + columns[order]] = order  # the last one stays: the nearest
    depth = np.full(side * side, np.inf)
    depth[nearest >= 0] = depths[nearest[nearest >= 0]]
    return depth.reshape(side, side), nearest.reshape(side, side)


def _is_visible(points: np.ndarray, pose: np.ndarray, depth: np.ndarray) -> np.ndarray:
    pixels, depths = _project(points, pose)
    inside = ((pixels > -0.5) & (pixels < SIZE - 0.5)).all(axis=1)
    columns, rows = np.rint(_fine(pixels)).astype(int).T.clip(0, SIZE * SAMPLES - 1)
    return np.asarray(inside & (depths < depth[rows, columns] + _VISIBLE_M))


def _warped(texture: np.ndarray, world_from_texel: np.ndarray, pose: np.ndarray, border: int) -> np.ndarray:
    """A plane's texture as the camera sees it; `world_from_texel` [4, 3] takes (x, y, 1) of a texel to the world."""
    scale = np.array([[SAMPLES, 0, (SAMPLES - 1) / 2], [0, SAMPLES, (SAMPLES - 1) / 2], [0, 0, 1.0]])
    move = scale @ MATRIX @ (np.linalg.inv(pose) @ world_from_texel)[:3]
    size = (SIZE * SAMPLES, SIZE * SAMPLES)
    return np.asarray(cv2.warpPerspective(texture, move, size, flags=cv2.INTER_LINEAR, borderMode=border))


def _printed(board: Board) -> np.ndarray:
    """[H, W] float32: the sheet of paper with the tags and a margin of a gap, `_TEXEL_M` a texel."""
    width, height = (round((extent + 2 * board.gap) / _TEXEL_M) for extent in board.size)
    paper = np.full((height, width), 215, np.float32)
    cell = round(board.tag_side / board.cells_per_tag / _TEXEL_M)
    for tag, corner in enumerate(board.tag_corners):
        x, y = np.rint((corner + board.gap) / _TEXEL_M).astype(int)
        cells = np.kron(board.cells(tag), np.ones((cell, cell), bool))
        paper[y : y + len(cells), x : x + len(cells)] = np.where(cells, 215, 25)
    return paper


def _lambert(surface: np.ndarray) -> np.ndarray:
    """[H, W]: brightness of a surface of places [H, W, 3] lit from above, from either side."""
    normals = np.cross(np.gradient(surface, axis=1), np.gradient(surface, axis=0))
    length = np.maximum(np.linalg.norm(normals, axis=2), 1e-15)
    return np.asarray(0.55 + 0.45 * np.abs(normals @ (_SUN / np.linalg.norm(_SUN))) / length)


def _clouds(rng: np.random.Generator, grain: int) -> np.ndarray:
    """[512, 512] smooth noise of unit deviation."""
    coarse = rng.normal(size=(_TEXELS // grain + 2,) * 2).astype(np.float32)
    noise = cv2.resize(coarse, (_TEXELS, _TEXELS), interpolation=cv2.INTER_CUBIC)
    return np.asarray(noise / noise.std())


def _messages(drawing: Drawing) -> Iterator[tuple[str, bytes]]:
    types = jazzy_types()

    def made(type_name: str, **fields: Any) -> Any:
        return types.types[type_name](**fields)

    def header(frame_id: str) -> Any:
        return stamped_header(drawing.stamp_ns, frame_id)

    def image(coded: np.ndarray, kind: str) -> bytes:
        message = made(MASK_TYPE, header=header("ego_camera_optical"), format=kind, data=coded.ravel())
        return bytes(types.serialize_cdr(message, MASK_TYPE))

    info = pinhole_info(header("ego_camera_optical"), MATRIX, (SIZE, SIZE))
    pose = drawing.world_from_camera
    turn = Rotation.from_matrix(pose[:3, :3]).as_quat()
    stamped = made(
        POSE_TYPE,
        header=header("world"),
        pose=made(
            "geometry_msgs/msg/Pose",
            position=made("geometry_msgs/msg/Point", **dict(zip("xyz", pose[:3, 3].tolist(), strict=True))),
            orientation=made("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", turn.tolist(), strict=True))),
        ),
    )
    jpeg = cv2.imencode(".jpg", drawing.image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
    yield _IMAGE, image(jpeg, "jpeg")
    yield _INFO, bytes(types.serialize_cdr(info, INFO_TYPE))
    yield OBJECT_TOPIC, _cloud(drawing, drawing.points[drawing.visible], np.flatnonzero(drawing.visible))
    yield CONTROLLER_TOPIC, _cloud(drawing, drawing.hand, np.arange(len(drawing.hand)))
    yield TRUE_POSE_TOPIC, bytes(types.serialize_cdr(stamped, POSE_TYPE))
    yield TRUE_MASK_TOPIC, image(cv2.imencode(".png", 255 * drawing.object_mask.astype(np.uint8))[1], "png")


def _cloud(drawing: Drawing, points: np.ndarray, ids: np.ndarray) -> bytes:
    return encode_points(
        stamp_ns=drawing.stamp_ns,
        frame_id="world",
        xyz=points,
        ids=ids.astype(np.uint32),
        confidence=np.ones(len(points), np.float32),
    )
