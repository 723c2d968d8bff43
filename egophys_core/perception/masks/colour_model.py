"""How likely a colour is in a class of pixels: a smoothed histogram in log-chromaticity and log-brightness.

The logarithm makes a change of illumination a shift along one axis, so that the shaded side of an object stays close
to its lit side (Finlayson et al., "On the removal of shadows from images", PAMI 2006, use the same axes).
"""

import cv2
import numpy as np
from scipy import ndimage

from egophys_core.perception.stages import View

DARK_OFFSET = 6.0
"""Grey levels added before a logarithm: the chromaticity of nearly black pixels is noise and fades to neutral."""
_BLACK = 4.0
"""Mean grey level."""
_BITS = 6
_BINS = (40, 40, 16)
_CHROMA_RANGE = 1.6
_CODES = 1 << (3 * _BITS)
UNIFORM = -float(np.log(np.prod(_BINS)))
"""Log-likelihood of any colour where nothing is known."""


def is_black(view: View) -> bool:
    """Whether a view is so dark that nothing can be told from it."""
    return bool(view.image.mean() < _BLACK)


def log_features(image: np.ndarray) -> np.ndarray:
    """[..., 3] float32 of BGR values [..., 3] 0..255: log R/G, log B/G and log brightness."""
    logs = np.log(np.asarray(image, np.float32) + DARK_OFFSET)
    blue, green, red = logs[..., 0], logs[..., 1], logs[..., 2]
    return np.stack([red - green, blue - green, (red + green + blue) / 3], axis=-1)


def feature_step() -> np.ndarray:
    """[3] float32: widths of a bin of the histogram along the features of `log_features`."""
    low, high = np.log(DARK_OFFSET), np.log(255 + DARK_OFFSET)
    return np.array(
        [2 * _CHROMA_RANGE / _BINS[0], 2 * _CHROMA_RANGE / _BINS[1], (high - low) / _BINS[2]], dtype=np.float32
    )


def colour_codes(image: np.ndarray) -> np.ndarray:
    """[H, W] int32 codes of a BGR image [H, W, 3] uint8, which `ColourModel` looks up."""
    reduced = (image >> (8 - _BITS)).astype(np.int32)
    return (reduced[..., 0] << (2 * _BITS)) | (reduced[..., 1] << _BITS) | reduced[..., 2]


def _bins_of_codes() -> np.ndarray:
    """[262144] int32: the bin of the histogram that each code falls in."""
    codes = np.arange(_CODES)
    half, mask = (1 << (8 - _BITS)) / 2 - 0.5, (1 << _BITS) - 1
    channels = [(codes >> shift) & mask for shift in (2 * _BITS, _BITS, 0)]
    values = np.stack(channels, axis=-1) * float(1 << (8 - _BITS)) + half
    least = np.array([-_CHROMA_RANGE, -_CHROMA_RANGE, np.log(DARK_OFFSET)], np.float32)
    offsets: np.ndarray = log_features(values) - least
    places = np.clip((offsets / feature_step()).astype(int), 0, np.array(_BINS) - 1)
    return np.ravel_multi_index(tuple(places.T), _BINS).astype(np.int32)


_BIN_OF_CODE = _bins_of_codes()


class ColourModel:
    """Log-likelihood of colours, learnt from pixels of a class and, slowly, from those of later frames."""

    def __init__(self, *, shading: float = 0.0, background_share: float = 0.02) -> None:
        """Make a model that knows nothing.

        Args:
            shading: share of the class, 0..1, expected in shade: as seen, but darker by down to a factor of 3.
            background_share: share of the class, 0..1, of any colour whatever.
        """
        self._shading, self._background_share = shading, background_share
        self._first: np.ndarray | None = None
        self._recent: np.ndarray | None = None
        self._table = np.full(_CODES, UNIFORM, np.float32)

    @property
    def known(self) -> bool:
        """Whether any pixel has been learnt."""
        return self._first is not None

    def learn(self, codes: np.ndarray, *, rate: float = 0.05) -> None:
        """Add pixels of one frame: what was learnt first keeps half of the weight.

        Args:
            codes: [N] int32 of `colour_codes`.
            rate: share, 0..1, of the newer half that these pixels replace.
        """
        if len(codes) == 0:
            return
        counts = np.bincount(_BIN_OF_CODE[codes], minlength=int(np.prod(_BINS))).reshape(_BINS) / len(codes)
        if self._first is None or self._recent is None:
            self._first = self._recent = counts
        else:
            self._recent = (1 - rate) * self._recent + rate * counts
        self._table = self._tabulate((self._first + self._recent) / 2)

    def log_likelihood(self, codes: np.ndarray) -> np.ndarray:
        """[...] float32 per bin of the histogram, for codes [...] of `colour_codes`."""
        return np.take(self._table, codes)

    def _tabulate(self, share: np.ndarray) -> np.ndarray:
        smooth = ndimage.gaussian_filter(share, (0.7, 0.7, 0.7), mode="nearest", truncate=3)
        if self._shading > 0:
            steps = int(np.log(3) / feature_step()[2])
            darker = np.zeros_like(smooth)
            for step in range(1, steps + 1):
                darker[..., :-step] += smooth[..., step:] / steps
            smooth = (1 - self._shading) * smooth + self._shading * darker
        smooth = (1 - self._background_share) * smooth + self._background_share / smooth.size
        return np.log(smooth).astype(np.float32).ravel()[_BIN_OF_CODE]


def with_gain_removed(image: np.ndarray, gain: float) -> np.ndarray:
    """[H, W, 3] uint8: the image as a camera of gain 1 would have seen it."""
    table = np.clip(np.arange(256) / gain, 0, 255).round().astype(np.uint8)
    return np.asarray(cv2.LUT(image, table))
