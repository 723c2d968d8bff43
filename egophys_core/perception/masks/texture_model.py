"""How likely the local contrast of a class of pixels is: skin and sleeves are smooth where cloth is printed."""

import cv2
import numpy as np

from egophys_core.perception.local_contrast import local_contrast

FINE_PX = 1.5
"""Pixels over which contrast is looked at."""

RIM_PX = 11
"""Contrast of what is narrower is of a rim or a crease, not of a texture."""

BINS = 12
GREYS_OF_BIN = 1.5
"""Factor in the deviation of the brightness between one bin and the next, from one grey level on."""

SHADE_BINS = 3
"""Bins by which the contrast falls in a shadow, at most: light of a third."""

BACKGROUND_SHARE = 0.1
"""Share of a class, 0..1, of any contrast whatever."""


def texture_codes(image: np.ndarray) -> np.ndarray:
    """[H, W] int32, bins of the local contrast of a BGR image [H, W, 3] uint8."""
    deviation = local_contrast(image, FINE_PX)[1]
    broad = cv2.morphologyEx(deviation, cv2.MORPH_OPEN, np.ones((RIM_PX, RIM_PX), np.uint8))
    return np.clip(np.log(np.maximum(broad, 1.0)) / np.log(GREYS_OF_BIN), 0, BINS - 1).astype(np.int32)


class TextureModel:
    """Log-likelihood of local contrast, learnt from pixels of a class and, slowly, from those of later frames."""

    def __init__(self) -> None:
        """Make a model that knows nothing."""
        self._share: np.ndarray | None = None

    def learn(self, codes: np.ndarray, *, rate: float = 0.05) -> None:
        """Add pixels of one frame: codes [N] int32 of `texture_codes`, which replace a share of what was learnt."""
        if len(codes) == 0:
            return
        share = np.bincount(codes, minlength=BINS) / len(codes)
        self._share = share if self._share is None else (1 - rate) * self._share + rate * share

    def log_likelihood(self, codes: np.ndarray, in_shade: np.ndarray | None = None) -> np.ndarray:
        """[...] float32 for codes [...] of `texture_codes`, less that of any contrast; 0 if nothing is known.

        Args:
            codes: bins.
            in_shade: [...] bool: where the class may be seen with less light, and so with less contrast.
        """
        if self._share is None:
            return np.zeros(codes.shape, np.float32)
        smooth = np.convolve(np.pad(self._share, 1, mode="edge"), [0.25, 0.5, 0.25], mode="valid")
        table = np.log(BINS * ((1 - BACKGROUND_SHARE) * smooth + BACKGROUND_SHARE / BINS)).astype(np.float32)
        found = np.take(table, codes)
        if in_shade is None:
            return found
        brighter = [np.take(table, np.minimum(codes + bins, BINS - 1)) for bins in range(1, SHADE_BINS + 1)]
        return np.where(in_shade, np.maximum.reduce([found, *brighter]), found)
