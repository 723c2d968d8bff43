"""Small drawn videos of a folded sheet or a pushed dome, with exact poses and points, for the whole of perception.

Triangles are filled sample by sample with a depth buffer, two by two samples a pixel; nothing of perception's own
projection or rendering is used. What is bad in a video is done to its images afterwards (see `bag`).
"""

from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial import cKDTree

from benchmarks.drawn_video import Shape, folded_sheet, pushed_dome
from egophys_core.perception.camera.board import Board
from egophys_core.perception.hands.hand_contacts import HandContacts
from egophys_core.perception.hands.hand_tracks import HandTracks
from egophys_core.perception.observation import HandSight
from egophys_core.perception.options import ObjectKind, PerceptionOptions
from egophys_core.perception.stages import Masks, View
from egophys_core.perception.surface.rest_surface import RestObject, rest_object
from egophys_core.perception.surface.surface_tracker import SurfaceState, SurfaceTracker
from egophys_core.recording import LogWriter, jazzy_types
from egophys_core.recording.camera_messages import pinhole_info, stamped_header

SIDE, FOCAL, RATE = 320, 370.0, 30.0
MATRIX = np.array([[FOCAL, 0, (SIDE - 1) / 2], [0, FOCAL, (SIDE - 1) / 2], [0, 0, 1.0]])
START_NS = 1_700_000_000_000_000_000
OPTIONS = PerceptionOptions(side=SIDE, spacing=11.0, queries=400, still_s=0.38, object_points=200)
"""Few vertices and points: small and fast."""
STILL_FRAMES, COME_FRAMES, MOVE_FRAMES = 13, 5, 27
"""The object rests, the hand comes, the object moves; all of this is the whole video."""
IMAGE, INFO = "/ego/image_raw/compressed", "/ego/camera_info"

_GRID = 33
_SAMPLES = 2
_TEXEL_M = 0.0005
_SUN = np.array([0.3, -0.2, 0.93])


@dataclass(frozen=True, kw_only=True)
class DrawnFrame:
    """One frame and its truth."""

    stamp_ns: int
    image: np.ndarray
    """[SIDE, SIDE, 3] uint8 BGR."""
    world_from_camera: np.ndarray
    """[4, 4] metres."""
    masks: Masks
    """Of the pixels' centres, nearly."""
    points: np.ndarray
    """[33 * 33, 3] metres: material points of the object."""

    @property
    def view(self) -> View:
        """As perception has it."""
        return View(
            stamp_ns=self.stamp_ns, image=self.image, camera_matrix=MATRIX, world_from_camera=self.world_from_camera
        )


@dataclass(frozen=True, kw_only=True)
class _Kind:
    shape: Shape
    colour: tuple[int, int, int]
    held: tuple[float, float]


KINDS = {
    "sheet": _Kind(shape=folded_sheet, colour=(170, 110, 60), held=(0.88, 0.0)),
    "dome": _Kind(shape=pushed_dome, colour=(70, 150, 90), held=(0.8, 0.0)),
}


@cache
def video(
    kind: str = "sheet", *, hand: bool = True, covered: tuple[int, int] | None = None, seconds: bool = False
) -> tuple[DrawnFrame, ...]:
    """The frames of a scene; drawn once.

    Args:
        kind: of `KINDS`.
        hand: whether a hand comes and moves the object; else it stays where it is.
        covered: first and last frame in which the hand lies over the whole object.
        seconds: whether a second object lies beside.
    """
    count = STILL_FRAMES + COME_FRAMES + MOVE_FRAMES
    return tuple(_draw(KINDS[kind], frame, hand, covered, seconds) for frame in range(count))


def bag(
    folder: Path,
    frames: Sequence[DrawnFrame],
    *,
    spoil: Callable[[int, np.ndarray], np.ndarray | None] | None = None,
    raw: bool = False,
    focal: float = FOCAL,
    size: tuple[int, int] = (SIDE, SIDE),
) -> Path:
    """Write frames as a rosbag2 folder in the order in which they come.

    Args:
        folder: to write, not there yet.
        frames: of a video.
        spoil: what becomes of an image, by its index; None leaves the frame out.
        raw: sensor_msgs/Image instead of JPEG.
        focal: what the CameraInfo says, pixels.
        size: width and height that it says.
    """
    types = jazzy_types()
    kind = "sensor_msgs/msg/Image" if raw else "sensor_msgs/msg/CompressedImage"
    topic = "/ego/image_raw" if raw else IMAGE
    with LogWriter(folder) as log:
        log.add_topic(topic, kind)
        log.add_topic(INFO, "sensor_msgs/msg/CameraInfo")
        info = _info(frames[0].stamp_ns, focal, size)
        log.write(INFO, bytes(types.serialize_cdr(info, "sensor_msgs/msg/CameraInfo")), START_NS)
        for index, frame in enumerate(frames):
            image = frame.image if spoil is None else spoil(index, frame.image)
            if image is not None:
                message = _raw(frame.stamp_ns, image) if raw else _jpeg(frame.stamp_ns, image)
                log.write(topic, bytes(types.serialize_cdr(message, kind)), START_NS + round(index * 1e9 / RATE))
    return folder


def camera_pose(seconds: float) -> np.ndarray:
    """[4, 4] world from camera of a head that sways over the table."""
    phase = 2 * np.pi * seconds / 1.7
    eye = np.array([0.06 * np.sin(phase), -0.36 + 0.02 * np.sin(2 * phase), 0.52 + 0.02 * np.cos(phase)])
    forward = np.array([0.01 * np.cos(phase), 0.14, 0.0]) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.02 * np.sin(phase), 0, 1])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = eye
    return pose


@cache
def object_at_rest(kind: str = "sheet") -> RestObject:
    """What is learnt of the object from the still frames, with true poses and masks."""
    still = video(kind)[:STILL_FRAMES]
    return rest_object([each.view for each in still], [each.masks.object for each in still], 0.0, OPTIONS)


@cache
def handled(kind: str = "sheet") -> tuple[tuple[SurfaceState, dict[int, HandSight]], ...]:
    """The object and the hands in every frame after the reference, with true poses and masks."""
    rest, frames = object_at_rest(kind), video(kind)
    return tuple(followed(rest, frames[rest.reference], frames[rest.reference + 1 :]))


def followed(
    rest: RestObject, first: DrawnFrame, frames: Sequence[DrawnFrame], hidden: Container[int] = ()
) -> Iterator[tuple[SurfaceState, dict[int, HandSight]]]:
    """The object and the hands in one frame after the other; no hand is seen in those whose index is hidden."""
    corners, count = rest.model.mesh.triangles[rest.feature_triangles], len(rest.model.mesh.pixels)
    tracker, hands = SurfaceTracker(rest, first.view), HandTracks()
    contacts = HandContacts(rest.model.rest[:count], is_solid=rest.kind == ObjectKind.SOLID)
    for index, frame in enumerate(frames):
        view, shown = frame.view, frame.masks.hand & (index not in hidden)
        # Outlines of drawn hands, 8 pixels of radius, tell nothing: masks alone.
        blank = np.zeros_like(view.image)
        arms = hands.next(blank, shown, tracker.silhouette(view))
        state = tracker.next(view, frame.masks, contacts.held(view, arms))
        seen = np.zeros(count, bool)
        seen[corners[state.seen]] = True
        yield state, contacts.next(view, arms, state.positions[:count], seen, partial(tracker.silhouette, view))


def tracked(kind: str = "sheet") -> tuple[SurfaceState, ...]:
    """The object in every frame after the reference, with true poses and masks."""
    return tuple(state for state, _ in handled(kind))


def surface(frame: DrawnFrame) -> np.ndarray:
    """[513 * 513, 3] metres: the drawn surface, half a millimetre apart, of the same material in every frame."""
    grid = frame.points.reshape(_GRID, _GRID, 3)
    for _ in range(4):
        grid = _finer(grid)
    return grid.reshape(-1, 3)


def material_of(points: np.ndarray, frame: DrawnFrame) -> np.ndarray:
    """[N] indices into `surface` of the material nearest to points [N, 3], metres, in a frame."""
    return np.asarray(cKDTree(surface(frame)).query(points)[1])


def _finer(grid: np.ndarray) -> np.ndarray:
    across = np.empty((grid.shape[0], 2 * grid.shape[1] - 1, 3))
    across[:, ::2], across[:, 1::2] = grid, (grid[:, 1:] + grid[:, :-1]) / 2
    both = np.empty((2 * grid.shape[0] - 1, across.shape[1], 3))
    both[::2], both[1::2] = across, (across[1:] + across[:-1]) / 2
    return both


@dataclass(frozen=True, kw_only=True)
class _Patch:
    """A grid of points to be drawn, with a texture or one colour."""

    points: np.ndarray
    """[R, C, 3] metres."""
    texture: np.ndarray
    """[H, W, 3] float32."""


def _draw(kind: _Kind, frame: int, hand: bool, covered: tuple[int, int] | None, seconds: bool) -> DrawnFrame:
    time = frame / RATE
    share = np.clip((frame - STILL_FRAMES - COME_FRAMES) / (MOVE_FRAMES - 1), 0, 1) if hand else 0.0
    share = 0.6 * float(share * share * (3 - 2 * share))
    pose = camera_pose(time)
    steps = np.linspace(-1, 1, _GRID)
    material = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    points = kind.shape(material, share)
    patches = [_Patch(points=points.reshape(_GRID, _GRID, 3), texture=_cloth(kind.colour, 4))]
    if seconds:
        beside = kind.shape(material, 0.0) * [0.3, 0.9, 1] + [0.19, 0.0, 0]
        patches.append(_Patch(points=beside.reshape(_GRID, _GRID, 3), texture=_cloth((60, 60, 170), 5)))
    is_covered = covered is not None and covered[0] <= frame <= covered[1]
    if (hand and frame >= STILL_FRAMES) or is_covered:
        tip = kind.shape(np.array([kind.held]), share)[0] + [0, 0, 0.014]
        tip = tip + np.array([0.28, -0.10, 0.08]) * np.clip(1 - (frame - STILL_FRAMES) / COME_FRAMES, 0, 1)
        patches.append(_hand(tip, 0.014))
        if is_covered:
            patches += [_hand(np.array((-0.2, y, 0.045)), 0.05, (1.0, -0.05, 0.05)) for y in (0.07, 0.0, -0.07, -0.14)]
    image = _planes(pose)
    depth = np.full(image.shape[:2], np.inf)
    owner = np.full(image.shape[:2], -1)
    for index, patch in enumerate(patches):
        _fill(patch, pose, image, depth, owner, index)
    image = cv2.resize(image, (SIDE, SIDE), interpolation=cv2.INTER_AREA)
    image = cv2.GaussianBlur(image, (0, 0), 0.6)
    noise = np.random.default_rng([7, frame]).normal(0, 1.5, image.shape)
    owner = owner[::_SAMPLES, ::_SAMPLES]
    return DrawnFrame(
        stamp_ns=START_NS + round(time * 1e9),
        image=(image + noise).clip(0, 255).round().astype(np.uint8),
        world_from_camera=pose,
        masks=Masks(object=owner == 0, hand=owner > int(seconds)),
        points=points,
    )


def _hand(tip: np.ndarray, radius: float, along: tuple[float, float, float] = (0.75, -0.45, 0.5)) -> _Patch:
    """A capsule from its tip in a direction."""
    axis = np.array(along) / np.linalg.norm(along)
    side = np.cross(axis, [0, 0, 1]) / np.linalg.norm(np.cross(axis, [0, 0, 1]))
    up = np.cross(side, axis)
    reach = np.concatenate([1 - np.cos(np.linspace(0, np.pi / 2, 6)), np.linspace(1, 1 + 0.4 / radius, 12)[1:]])
    width = np.sqrt(np.clip(1 - (1 - np.minimum(reach, 1)) ** 2, 0, 1))
    around = np.linspace(0, 2 * np.pi, 17)
    outward = np.cos(around)[:, None] * side + np.sin(around)[:, None] * up
    points = tip + radius * (reach[:, None, None] * axis + width[:, None, None] * outward)
    return _Patch(points=points, texture=np.full((2, 2, 3), (145, 170, 228), np.float32))


def _fill(patch: _Patch, pose: np.ndarray, image: np.ndarray, depth: np.ndarray, owner: np.ndarray, index: int) -> None:
    """Draw a patch into an image with its depths and owners."""
    rows, columns = patch.points.shape[:2]
    seen = (patch.points.reshape(-1, 3) - pose[:3, 3]) @ pose[:3, :3]
    pixels = (seen[:, :2] / seen[:, 2:] * FOCAL + (SIDE - 1) / 2 + 0.5) * _SAMPLES - 0.5
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    triangles = np.vstack(
        [
            np.column_stack([first, first + 1, first + columns]),
            np.column_stack([first + 1, first + columns + 1, first + columns]),
        ]
    )
    triangles = triangles[(seen[triangles, 2] > 0.05).all(axis=1)]
    corners = pixels[triangles]
    low = np.floor(corners.min(axis=1)).astype(int).clip(0, depth.shape[0])
    high = np.ceil(corners.max(axis=1)).astype(int).clip(-1, depth.shape[0] - 1) + 1
    extent = np.maximum(high - low, 0)
    area = extent.prod(axis=1)
    which = np.repeat(np.arange(len(triangles)), area)
    step = np.arange(area.sum()) - np.repeat(np.cumsum(area) - area, area)
    x, y = low[which, 0] + step % extent[which, 0], low[which, 1] + step // extent[which, 0]
    a, b, c = (corners[which, k] for k in range(3))
    whole = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        second = ((x - a[:, 0]) * (c - a)[:, 1] - (y - a[:, 1]) * (c - a)[:, 0]) / whole
        third = ((b - a)[:, 0] * (y - a[:, 1]) - (b - a)[:, 1] * (x - a[:, 0])) / whole
        hit = (second >= 0) & (third >= 0) & (second + third <= 1)
    which, x, y, second, third = which[hit], x[hit], y[hit], second[hit], third[hit]
    # What is linear over the triangle is, over depth, linear in the image.
    share = np.column_stack([1 - second - third, second, third]) / seen[triangles[which], 2]
    reach = 1 / share.sum(axis=1)
    share *= reach[:, None]
    order = np.argsort(-reach, kind="stable")
    which, x, y, share, reach = which[order], x[order], y[order], share[order], reach[order]
    winner = np.full(depth.shape, -1)
    winner[y, x] = np.arange(len(x))  # the last one stays: the nearest
    shown = winner[winner >= 0]
    shown = shown[reach[shown] < depth[y[shown], x[shown]]]
    which, x, y, share = which[shown], x[shown], y[shown], share[shown]
    row, column = np.divmod(np.arange(rows * columns), columns)
    texture_rows = (share * (row / (rows - 1))[triangles[which]]).sum(axis=1)
    texture_columns = (share * (column / (columns - 1))[triangles[which]]).sum(axis=1)
    height, width = patch.texture.shape[:2]
    colour = _sampled(patch.texture, texture_columns * (width - 1), texture_rows * (height - 1))
    faces = patch.points.reshape(-1, 3)[triangles]
    normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    light = np.abs(normal @ _SUN) / np.maximum(np.linalg.norm(normal, axis=1), 1e-15)
    image[y, x] = colour * (0.6 + 0.4 * light[which])[:, None]
    depth[y, x], owner[y, x] = reach[shown], index


def _sampled(texture: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """[N, 3] colours between the texels."""
    left, top = (each.astype(int).clip(0, size - 2) for each, size in ((x, texture.shape[1]), (y, texture.shape[0])))
    across, down = (x - left)[:, None], (y - top)[:, None]
    upper = texture[top, left] * (1 - across) + texture[top, left + 1] * across
    lower = texture[top + 1, left] * (1 - across) + texture[top + 1, left + 1] * across
    return np.asarray(upper * (1 - down) + lower * down)


@cache
def _cloth(colour: tuple[int, int, int], seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    texture = np.array(colour) * (1 + 0.2 * _clouds(rng, 16) + 0.18 * _clouds(rng, 7))[..., None]
    texture[:, :, 2] *= 1 + 0.2 * _clouds(rng, 40)
    return np.asarray(texture.clip(5, 250).astype(np.float32))


@cache
def _tabletop() -> tuple[np.ndarray, np.ndarray]:
    """[H, W, 3] the table from above with the board on it, and [3, 3] world (x, y, 1) from texel."""
    rng, board = np.random.default_rng(1), Board()
    shade = cv2.resize(1 + 0.02 * _clouds(rng, 32) - 0.15 * (_clouds(rng, 2) > 1.6), (2400, 2400))
    table = (shade[..., None] * np.array([140, 168, 190])).astype(np.float32)
    place = np.array([[_TEXEL_M, 0, -1199.5 * _TEXEL_M], [0, -_TEXEL_M, 1199.5 * _TEXEL_M], [0, 0, 1.0]])
    # The default board's cells and gaps are whole numbers of texels.
    cell, side, gap = (board.tag_side / board.cells_per_tag, board.tag_side, board.gap)
    edges = np.linalg.inv(place) @ [board.origin[0] - gap, board.origin[1] + gap, 1]
    y, x = np.mgrid[:2400, :2400]
    along = (x - edges[0]) * _TEXEL_M - gap
    down = (y - edges[1]) * _TEXEL_M - gap
    width, height = board.size
    table[(along > -gap) & (along < width + gap) & (down > -gap) & (down < height + gap)] = 215
    pitch = side + gap
    for tag in range(board.columns * board.rows):
        row, column = divmod(tag, board.columns)
        in_x, in_y = along - column * pitch, down - row * pitch
        ink = (in_x >= 0) & (in_x < side) & (in_y >= 0) & (in_y < side)
        white = board.cells(tag)[(in_y[ink] / cell).astype(int), (in_x[ink] / cell).astype(int)]
        table[ink] = np.where(white, 215, 25)[:, None]
    return table, place


def _planes(pose: np.ndarray) -> np.ndarray:
    """Table and board, both at the board's height, at `_SAMPLES` samples a pixel."""
    texture, place = _tabletop()
    scale = np.array([[_SAMPLES, 0, (_SAMPLES - 1) / 2], [0, _SAMPLES, (_SAMPLES - 1) / 2], [0, 0, 1.0]])
    inverse = np.linalg.inv(pose)
    onto = np.column_stack([inverse[:3, :2], inverse[:3, 2] * Board().origin[2] + inverse[:3, 3]])
    size = (SIDE * _SAMPLES, SIDE * _SAMPLES)
    move = scale @ MATRIX @ onto @ place
    return np.asarray(cv2.warpPerspective(texture, move, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def _clouds(rng: np.random.Generator, grain: int) -> np.ndarray:
    """[512, 512] smooth noise of unit deviation."""
    coarse = rng.normal(size=(512 // grain + 2,) * 2).astype(np.float32)
    noise = cv2.resize(coarse, (512, 512), interpolation=cv2.INTER_CUBIC)
    return np.asarray(noise / noise.std())


def _jpeg(stamp_ns: int, image: np.ndarray) -> Any:
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 94])[1].ravel()
    kind = jazzy_types().types["sensor_msgs/msg/CompressedImage"]
    return kind(header=_header(stamp_ns), format="jpeg", data=data)


def _raw(stamp_ns: int, image: np.ndarray) -> Any:
    return jazzy_types().types["sensor_msgs/msg/Image"](
        header=_header(stamp_ns),
        height=image.shape[0],
        width=image.shape[1],
        encoding="bgr8",
        is_bigendian=0,
        step=3 * image.shape[1],
        data=np.ascontiguousarray(image).ravel(),
    )


def _info(stamp_ns: int, focal: float, size: tuple[int, int]) -> Any:
    matrix = MATRIX.copy()
    matrix[[0, 1], [0, 1]] = focal
    return pinhole_info(_header(stamp_ns), matrix, size)


def _header(stamp_ns: int) -> Any:
    return stamped_header(stamp_ns, "ego_camera_optical")
