"""Drawn pictures of a smooth round hand at the end of an arm, before a speckled table, exact at the edges."""

import cv2
import numpy as np

SIDE = 320
SKIN = (150.0, 180.0, 220.0)
TABLE = (150.0, 155.0, 150.0)


def picture(
    centre: tuple[float, float],
    half_widths: tuple[float, float],
    *,
    angle: float = 0.0,
    arm_to: tuple[float, float] | None = None,
    skin: tuple[float, float, float] = SKIN,
    seed: int = 0,
) -> np.ndarray:
    """[SIDE, SIDE, 3] uint8 BGR of an elliptic hand; an arm half as wide, a little darker, leads from it to a place."""
    random = np.random.default_rng(seed)
    speckles = 25.0 * random.standard_normal((SIDE // 2, SIDE // 2))
    table = np.array(TABLE) + cv2.resize(speckles, (SIDE, SIDE), interpolation=cv2.INTER_LINEAR)[..., None]
    image = _over(table, coverage(centre, half_widths, angle), skin)
    if arm_to is not None:
        start, end = np.array(centre), np.array(arm_to)
        x, y = np.meshgrid(np.arange(SIDE) - start[0], np.arange(SIDE) - start[1])
        along = (end - start) / np.linalg.norm(end - start)
        share = np.clip((x * along[0] + y * along[1]), 0, None)
        aside = np.hypot(x - share * along[0], y - share * along[1])
        image = _over(image, np.clip(0.5 * half_widths[0] + 0.5 - aside, 0, 1), tuple(0.8 * each for each in skin))
    image = cv2.GaussianBlur(image, (0, 0), 0.7) + 2.0 * random.standard_normal((SIDE, SIDE, 3))
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def coverage(centre: tuple[float, float], half_widths: tuple[float, float], angle: float = 0.0) -> np.ndarray:
    """[SIDE, SIDE] 0..1: how much of each pixel an ellipse covers; angle in degrees, from x to y."""
    x, y = np.meshgrid(np.arange(SIDE) - centre[0], np.arange(SIDE) - centre[1])
    turn = np.radians(angle)
    along, across = np.cos(turn) * x + np.sin(turn) * y, -np.sin(turn) * x + np.cos(turn) * y
    wide, narrow = half_widths
    radius = np.hypot(along / wide, across / narrow)
    slope = np.hypot(along / wide**2, across / narrow**2) / np.maximum(radius, 1e-9)
    return np.clip(0.5 - (radius - 1) / np.maximum(slope, 1e-9), 0, 1)


def _over(image: np.ndarray, share: np.ndarray, colour: tuple[float, ...]) -> np.ndarray:
    return image + share[..., None] * (np.array(colour) - image)
