"""A drawn video with exact masks: textured table and object, a capsule for the hand that comes, and its shadow."""

from dataclasses import dataclass, field

import cv2
import numpy as np

from egophys_core.perception.stages import Masks, View

SIDE = 518
CAMERA = np.array([[460.0, 0, 258.5], [0, 460.0, 258.5], [0, 0, 1]])
TAN, GREEN, BLUE = (120, 165, 210), (90, 200, 80), (190, 120, 60)
RED, DARK, SKIN, KHAKI = (50, 45, 170), (45, 40, 38), (150, 180, 235), (95, 160, 180)
_TEXELS = 512
_SUN = np.array([0.4, -0.3])
"""Metres that a shadow falls aside for each metre of height."""


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What to draw; frames last 1/30 s."""

    object_colours: tuple = (GREEN,)
    table_colour: tuple = TAN
    hand_colour: tuple = SKIN
    texture: float = 0.35
    """Contrast of the object's own texture."""
    frames: int = 40
    hand_frames: tuple | None = (8, 200)
    """First and last frame in which a hand is there; None for none."""
    hand_covers: tuple | None = None
    """First and last frame in which the hand lies over the whole object."""
    push: tuple = (0.004, 0.001)
    """Metres that the object moves each frame once the hand has come (12 frames after its first)."""
    gains: dict = field(default_factory=dict)
    """Exposure of frames that differ: 0 is black."""
    blurred: tuple = ()
    seconds: tuple = ()
    """x and y, metres, of other things of the object's kind that lie on the table."""
    noise: float = 2.0
    seed: int = 0


def camera_pose(frame: int) -> np.ndarray:
    """World from camera of a head that sways."""
    phase = 2 * np.pi * frame / 70
    eye = np.array([0.05 * np.sin(phase), -0.42 + 0.02 * np.sin(2 * phase), 0.5 + 0.03 * np.cos(phase)])
    forward = np.array([0.01 * np.cos(phase), 0.06, 0.0]) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = eye
    return pose


def draw(scene: Scene, frame: int) -> tuple[View, Masks]:
    """One frame and its true masks."""
    rng = np.random.default_rng(scene.seed)
    table = _table_texture(scene, rng)
    cloth, alpha = _object_texture(scene, rng)
    pose = camera_pose(frame)
    image = _lay(np.zeros((SIDE, SIDE, 3), np.float32), table, None, _square(np.zeros(2), 0.9, 0.0), 0.0, pose)[0]
    for place in scene.seconds:
        image, _ = _lay(image, cloth[:, ::-1].copy(), alpha, _square(np.array(place), 0.07, 0.4), 0.008, pose)
    start, _ = scene.hand_frames or (10**6, 0)
    moved = np.array(scene.push) * max(0, frame - start - 12)
    corners = _square(moved, 0.11, 0.2 + 0.01 * max(0, frame - start - 12))
    image, shown = _lay(image, cloth, alpha, corners, 0.008, pose)
    hand = np.zeros((SIDE, SIDE), bool)
    if scene.hand_frames is not None and scene.hand_frames[0] <= frame <= scene.hand_frames[1]:
        near = max(0.0, 1 - (frame - start) / 12)
        tip = moved + np.array([0.07, -0.02]) + near * np.array([0.35, -0.1])
        radius = 0.022
        if scene.hand_covers and scene.hand_covers[0] <= frame <= scene.hand_covers[1]:
            tip, radius = moved - [0.08, 0.05], 0.19
        ends = np.array([[*tip, radius + 0.012], [*(tip + [0.16, -0.05]), radius + 0.05]])
        image *= np.where(_capsule_shadow(ends, radius, pose), 0.5, 1.0)[..., None]
        hand, shade = _capsule(ends, radius, pose)
        image[hand] = shade[hand, None] * np.array(scene.hand_colour, np.float32)
    if frame in scene.blurred:
        image = cv2.blur(image, (9, 3))
    y, x = np.mgrid[:SIDE, :SIDE] / SIDE - 0.5
    image = image * (1 - 0.4 * (x * x + y * y))[..., None] * scene.gains.get(frame, 1.0)
    noise = np.random.default_rng([scene.seed, frame]).normal(0, scene.noise, image.shape)
    pixels = np.clip(image + noise * (scene.gains.get(frame, 1.0) > 0), 0, 255).astype(np.uint8)
    view = View(stamp_ns=frame * 33_333_333, image=pixels, camera_matrix=CAMERA, world_from_camera=pose)
    return view, Masks(object=shown & ~hand, hand=hand)


def project(points: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Pixels [N, 2] of world points [N, 3]."""
    seen = np.column_stack([points, np.ones(len(points))]) @ np.linalg.inv(pose).T
    pixels = seen[:, :3] @ CAMERA.T
    return pixels[:, :2] / pixels[:, 2:]


def _square(centre: np.ndarray, half: float, turn: float) -> np.ndarray:
    cos, sin = np.cos(turn), np.sin(turn)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    return corners @ np.array([[cos, sin], [-sin, cos]]) + centre


def _clouds(rng: np.random.Generator, grain: int) -> np.ndarray:
    """[512, 512] smooth noise of unit deviation."""
    coarse = rng.normal(size=(_TEXELS // grain + 2,) * 2).astype(np.float32)
    noise = cv2.resize(coarse, (_TEXELS, _TEXELS), interpolation=cv2.INTER_CUBIC)
    return noise / noise.std()


def _table_texture(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    shade = 1 + 0.03 * _clouds(rng, 32) - 0.25 * (_clouds(rng, 2) > 1.6)
    return shade[..., None] * np.array(scene.table_colour, np.float32)


def _object_texture(scene: Scene, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    texture = np.zeros((_TEXELS, _TEXELS, 3), np.float32)
    width = _TEXELS // len(scene.object_colours) + 1
    for index, colour in enumerate(scene.object_colours):
        texture[:, index * width : (index + 1) * width] = colour
    for channel in range(3):
        texture[..., channel] *= 1 + 0.5 * scene.texture * _clouds(rng, 24)
    texture *= (1 + 0.5 * scene.texture * _clouds(rng, 10))[..., None]
    y, x = np.mgrid[-1 : 1 : _TEXELS * 1j, -1 : 1 : _TEXELS * 1j]
    angle = np.arctan2(y, x)
    alpha = np.hypot(x, y) < 0.82 + 0.1 * np.cos(3 * angle) + 0.04 * np.sin(7 * angle)
    return np.clip(texture, 4, 250), alpha.astype(np.float32)


def _lay(
    image: np.ndarray,
    texture: np.ndarray,
    alpha: np.ndarray | None,
    corners: np.ndarray,
    height: float,
    pose: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Draw a level picture; corners [4, 2] metres. Returns the image and where the picture is."""
    pixels = project(np.column_stack([corners, np.full(4, height)]), pose).astype(np.float32)
    last = _TEXELS - 1
    source = np.array([[0, last], [last, last], [last, 0], [0, 0]], np.float32)
    move = cv2.getPerspectiveTransform(source, pixels)
    cover = np.ones((_TEXELS, _TEXELS), np.float32) if alpha is None else alpha
    drawn = cv2.warpPerspective(texture, move, (SIDE, SIDE), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    cover = cv2.warpPerspective(cover, move, (SIDE, SIDE), flags=cv2.INTER_LINEAR)
    return image * (1 - cover[..., None]) + drawn * cover[..., None], cover > 0.5


def _capsule(ends: np.ndarray, radius: float, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where a capsule between two points [2, 3] is seen, and its shading 0..1."""
    camera = np.column_stack([ends, np.ones(2)]) @ np.linalg.inv(pose).T
    pixels, sizes = project(ends, pose), CAMERA[0, 0] * radius / camera[:, 2]
    y, x = np.mgrid[:SIDE, :SIDE]
    along = pixels[1] - pixels[0]
    share = np.clip(((x - pixels[0, 0]) * along[0] + (y - pixels[0, 1]) * along[1]) / (along @ along), 0, 1)
    offset = np.hypot(x - pixels[0, 0] - share * along[0], y - pixels[0, 1] - share * along[1])
    off = offset / (sizes[0] + share * (sizes[1] - sizes[0]))
    return off < 1, (0.55 + 0.45 * np.sqrt(np.clip(1 - off**2, 0, 1))).astype(np.float32)


def _capsule_shadow(ends: np.ndarray, radius: float, pose: np.ndarray) -> np.ndarray:
    fallen = np.column_stack([ends[:, :2] + ends[:, 2:] * _SUN, np.zeros(2)])
    return _capsule(fallen, radius, pose)[0]
