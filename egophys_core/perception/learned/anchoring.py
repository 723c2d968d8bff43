"""Metres for a reconstruction of arbitrary scale and frame: from the table, from camera motion, from a length."""

import numpy as np

from egophys_core.errors import EpisodeError
from egophys_core.perception.stages import View

FARTHEST_TABLE_M = 3.0
PIXEL_STEP = 5
"""The scale is found from every fifth pixel in each direction."""
TABLE_TOLERANCE = 0.01
"""Pixels of the table agree on the scale to this share."""
FEWEST_TABLE_PIXELS, FEWEST_TABLE_SHARE = 30, 0.1
LEAST_MOTION = 0.05
"""Camera centres tell the scale if they are spread over this share of the distance of the scene."""
PLANE_TRIALS, PLANE_SHARE = 200, 0.01
"""Trials of RANSAC for the table, and the share of the distance within which a point is of a plane."""


def rays(camera_matrix: np.ndarray, size: tuple[int, ...]) -> np.ndarray:
    """[H, W, 3] directions of the pixels in the camera's frame, z = 1, for an image of size H, W."""
    rows, columns = np.mgrid[: size[0], : size[1]].astype(np.float64)
    pixels = np.stack([columns, rows, np.ones_like(rows)], axis=-1)
    directions: np.ndarray = pixels @ np.linalg.inv(camera_matrix).T
    return directions


def table_scale(
    views: list[View],
    depths: np.ndarray,
    believed: np.ndarray,
    *,
    table_height: float,
    table_area: tuple[float, float, float, float] | None,
) -> float | None:
    """Metres per unit of depth by which most pixels of the views lie on the table; None if too few agree.

    The pose of a view says at which depth the ray of each pixel meets the table; divided by the predicted depth that is
    the scale, if the pixel shows the table. What stands on the table gives larger values that do not agree with each
    other, so the value that most pixels share (to `TABLE_TOLERANCE`) is taken. It needs no motion of the camera.

    Args:
        views: T views; those without a pose are passed over.
        depths: [T, S, S] along the axis of the camera, any unit.
        believed: [T, S, S] bool, pixels whose depth may be used.
        table_height: z of the table, metres.
        table_area: least x, most x, least y, most y in metres of where only the table or the board is, None for all.
    """
    ratios = []
    thin = (slice(None, None, PIXEL_STEP),) * 2
    for view, depth, good in zip(views, depths, believed, strict=True):
        pose = view.world_from_camera
        if not np.isfinite(pose).all():
            continue
        directions = rays(view.camera_matrix, depth.shape)[thin] @ pose[:3, :3].T
        with np.errstate(divide="ignore", invalid="ignore"):
            on_table = (table_height - pose[2, 3]) / directions[..., 2]
            usable = (
                good[thin]
                & np.isfinite(depth[thin])
                & (depth[thin] > 0)
                & (on_table > 0)
                & (on_table < FARTHEST_TABLE_M)
            )
            if table_area is not None:
                x, y = np.moveaxis(pose[:2, 3] + directions[..., :2] * on_table[..., None], -1, 0)
                usable &= (x >= table_area[0]) & (x <= table_area[1]) & (y >= table_area[2]) & (y <= table_area[3])
        ratios.append(np.log(on_table[usable] / depth[thin][usable]))
    logs = np.sort(np.concatenate(ratios)) if ratios else np.zeros(0)
    if len(logs) == 0:
        return None
    last = np.searchsorted(logs, logs + 2 * TABLE_TOLERANCE, side="right")
    agree = last - np.arange(len(logs))
    first = int(np.argmax(agree))
    if agree[first] < max(FEWEST_TABLE_PIXELS, FEWEST_TABLE_SHARE * len(logs)):
        return None
    return float(np.exp(np.median(logs[first : last[first]])))


def motion_scale(world_centres: np.ndarray, centres: np.ndarray, rotation: np.ndarray, distance: float) -> float | None:
    """Metres per unit by least squares from camera centres; None where they are too close to each other to tell.

    Rotation is given: from centres alone it is not determined when the head moves along a line or hardly at all.

    Args:
        world_centres: [T, 3] metres.
        centres: [T, 3] the same in the arbitrary unit and frame.
        rotation: [3, 3] world from that frame.
        distance: of the scene from the cameras, in the arbitrary unit.
    """
    there = (centres - centres.mean(axis=0)) @ rotation.T
    here = world_centres - world_centres.mean(axis=0)
    spread = np.sqrt((there**2).sum() / max(len(there), 1))
    if spread < LEAST_MOTION * distance:
        return None
    scale = float((here * there).sum() / (there**2).sum())
    return scale if scale > 0 else None


def world_on_largest_plane(points: np.ndarray, *, seed: int = 0) -> np.ndarray:
    """[4, 4] pose of a camera in a world whose table, z = 0, is the largest plane of points in the camera's frame.

    z points from the table to the camera's side, x along the camera's x, the origin is the point of the table nearest
    to the middle of the points. For recordings without a board.

    Args:
        points: [N, 3] metres, finite.
        seed: of the trials.

    Raises:
        EpisodeError: fewer than three points, or no plane.
    """
    if len(points) < 3:
        raise EpisodeError(f"{len(points)} point(s) are believed in the first view; a table needs at least 3")
    generator = np.random.default_rng(seed)
    best = np.zeros(len(points), bool)
    tolerance = PLANE_SHARE * np.median(points[:, 2])
    for _ in range(PLANE_TRIALS):
        one, two, three = points[generator.choice(len(points), 3, replace=False)]
        normal = np.cross(two - one, three - one)
        length = np.linalg.norm(normal)
        if length > 1e-12:
            near = np.abs((points - one) @ normal / length) < tolerance
            best = near if near.sum() > best.sum() else best
    if best.sum() < 3:
        raise EpisodeError("no plane is found in the first view, so where the table is, is not known; use a board")
    middle = points[best].mean(axis=0)
    up = np.linalg.svd(points[best] - middle, full_matrices=False)[2][2]
    up = up if up @ middle < 0 else -up
    across = np.array([1.0, 0.0, 0.0]) - up[0] * up
    if np.linalg.norm(across) < 1e-3:
        across = np.array([0.0, 0.0, 1.0]) - up[2] * up
    across /= np.linalg.norm(across)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([across, np.cross(up, across), up])
    pose[:3, 3] = -pose[:3, :3] @ middle
    return pose
