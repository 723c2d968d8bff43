"""A table with a step on it, seen by a moving camera: the true point of every pixel, to compare with."""

import numpy as np

from egophys_core.perception.stages import View

SIZE = 56
CAMERA = np.array([[70.0, 0, (SIZE - 1) / 2], [0, 70.0, (SIZE - 1) / 2], [0, 0, 1]])
STEP = 0.06
"""Height in metres of what stands on the table, where |x| and |y| are below 0.06 m."""


def pose_at(index: int, *, motion: float = 1.0) -> np.ndarray:
    """World from camera: 0.5 m above the table, looking down and a little ahead, moving on an arc."""
    angle = 0.1 * index * motion
    tilt = 0.4 + 0.05 * np.sin(2 * angle)
    ahead = np.array([np.sin(tilt) * np.cos(angle), np.sin(tilt) * np.sin(angle), -np.cos(tilt)])
    right = np.cross(ahead, [0, 0, 1])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    pose[:3, 3] = -0.5 * ahead / np.cos(tilt) + [0.02 * np.sin(angle), 0, 0]
    return pose


def true_depth(pose: np.ndarray, camera: np.ndarray = CAMERA) -> np.ndarray:
    """[SIZE, SIZE] metres along the axis of the camera; what stands on the table has no walls."""
    rows, columns = np.mgrid[:SIZE, :SIZE].astype(float)
    directions = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(camera).T @ pose[:3, :3].T
    table, top = ((height - pose[2, 3]) / directions[..., 2] for height in (0.0, STEP))
    place = pose[:2, 3] + directions[..., :2] * top[..., None]
    return np.where((np.abs(place) < 0.06).all(axis=-1), top, table)


def true_points(pose: np.ndarray, camera: np.ndarray = CAMERA) -> np.ndarray:
    """[SIZE, SIZE, 3] metres, world."""
    rows, columns = np.mgrid[:SIZE, :SIZE].astype(float)
    directions = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(camera).T
    return (directions * true_depth(pose, camera)[..., None]) @ pose[:3, :3].T + pose[:3, 3]


def view_at(index: int, *, has_pose: bool = True, motion: float = 1.0) -> View:
    """A view whose image holds its number: blue 200, green 100, red the index."""
    image = np.zeros((SIZE, SIZE, 3), np.uint8)
    image[:] = (200, 100, index)
    pose = pose_at(index, motion=motion) if has_pose else np.full((4, 4), np.nan)
    return View(stamp_ns=index, image=image, camera_matrix=CAMERA, world_from_camera=pose)
