"""Images of a spotted table and nothing else, from known poses."""

import cv2
import numpy as np

SIDE = 400
MATRIX = np.array([[360.0, 0, 199.5], [0, 360.0, 199.5], [0, 0, 1]])
CELL = 0.0025


def look(eye: list[float], at: list[float]) -> np.ndarray:
    """World from camera."""
    forward = np.array(at, float) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.column_stack([right, np.cross(forward, right), forward]), eye
    return pose


def sway(frames: int, size: float = 1.0) -> np.ndarray:
    phase = np.linspace(0, 4, frames)
    return np.array(
        [look([0.08 * size * np.sin(p), -0.4 + 0.05 * size * np.cos(2 * p), 0.5], [0, 0, 0]) for p in phase]
    )


def table_texture() -> np.ndarray:
    """[1200, 1200, 3]: a spotted table, CELL metres a texel, its middle at the world's origin."""
    noise = cv2.GaussianBlur(np.random.default_rng(0).normal(size=(1200, 1200)).astype(np.float32), (0, 0), 1)
    grey = np.clip(140 + 35 * noise / noise.std(), 0, 255)
    return np.dstack([0.8 * grey, grey, np.minimum(1.1 * grey, 255)])


def film(table: np.ndarray, poses: np.ndarray, noise: float = 2.0) -> list[np.ndarray]:
    """Images of the table and nothing else."""
    images = []
    for number, pose in enumerate(poses):
        inverse = np.linalg.inv(pose)
        move = MATRIX @ inverse[:3, [0, 1, 3]] @ np.array([[CELL, 0, -600 * CELL], [0, CELL, -600 * CELL], [0, 0, 1]])
        image = cv2.warpPerspective(table, move, (SIDE, SIDE), flags=cv2.INTER_LINEAR)
        image = image + np.random.default_rng(number).normal(0, noise, image.shape)
        images.append(np.clip(image, 0, 255).astype(np.uint8))
    return images
