"""How far the brightness of an image is from that around it, and by how much it varies there."""

import cv2
import numpy as np


def local_contrast(image: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Brightness less its local mean, and the local deviation: [H, W] float32 grey levels each.

    Args:
        image: [H, W, 3] uint8, BGR.
        sigma: pixels, of the neighbourhood.
    """
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float32)
    apart = grey - cv2.GaussianBlur(grey, (0, 0), sigma)
    return apart, np.sqrt(cv2.GaussianBlur(apart * apart, (0, 0), sigma))
