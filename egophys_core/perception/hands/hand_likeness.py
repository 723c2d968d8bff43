"""How much each pixel around a hand looks like it rather than like what is beside it, by colour and texture."""

import cv2
import numpy as np

from egophys_core.perception.hands.hand_outline import HandOutline
from egophys_core.perception.masks.colour_model import ColourModel, colour_codes
from egophys_core.perception.masks.texture_model import TextureModel, texture_codes

INNER, RING, REACH = 0.92, 1.12, 1.9
"""Of the size of the outline: what is in the first is the hand, what is between the others is beside it."""

RATE = 0.2
"""Share of what is known that a view replaces: what a hand passes changes with every view."""

SMOOTHING_PX = 1.0

RIM_PX = 7
"""Pixels: width of what is left out at the rim of a mask, half on either side."""

SMOOTH_SHARE = 90
"""Per cent of an arm that are at most as rough as what is taken for smooth."""


class HandLikeness:
    """Colours and texture of one hand, and of what is around it just now."""

    def __init__(self) -> None:
        """Nothing is known."""
        self._hand = ColourModel(shading=0.0, background_share=0.05), TextureModel()
        self._beside = ColourModel(shading=0.0, background_share=0.05), TextureModel()

    @property
    def known(self) -> bool:
        """Whether a view has been learnt."""
        return self._hand[0].known and self._beside[0].known

    def of(self, image: np.ndarray) -> np.ndarray:
        """[H, W] float32, 0..1: the probability that a pixel is one of the hand.

        Args:
            image: [H, W, 3] uint8, BGR, of the hand and what is around it.
        """
        codes, texture = colour_codes(image), texture_codes(image)
        (colour, feel), (other_colour, other_feel) = self._hand, self._beside
        odds = colour.log_likelihood(codes) - other_colour.log_likelihood(codes)
        odds += feel.log_likelihood(texture) - other_feel.log_likelihood(texture)
        return cv2.GaussianBlur(1 / (1 + np.exp(-np.clip(odds, -20, 20))), (0, 0), SMOOTHING_PX)

    def learn(self, image: np.ndarray, outline: HandOutline, arm: np.ndarray) -> None:
        """Take a view in which the outline is known.

        Args:
            image: [H, W, 3] uint8, BGR.
            outline: of the hand, in pixels of this image.
            arm: [H, W] bool: the hand and its arm, as far as they are known; not beside it.
        """
        codes, texture = colour_codes(image), texture_codes(image)
        size = image.shape[:2]
        inner = outline.mask(size, INNER)
        ring = outline.mask(size, REACH) & ~outline.mask(size, RING) & ~arm
        for (colour, feel), where in ((self._hand, inner), (self._beside, ring)):
            colour.learn(codes[where], rate=RATE)
            feel.learn(texture[where], rate=RATE)


def as_smooth(image: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """[H, W] float32, 0..1: what is of an arm by its mask, or as smooth as that; for a hand of which nothing is known.

    Hands are lit from above: what the sun bleaches has no colour left to know it by, but no texture either.

    Args:
        image: [H, W, 3] uint8, BGR.
        arm: [H, W] bool: its mask, which may lack parts.
    """
    codes = texture_codes(image)
    core = cv2.erode(arm.astype(np.uint8), np.ones((RIM_PX, RIM_PX), np.uint8)) > 0
    if not core.any():
        return arm.astype(np.float32)
    smooth = arm | (codes <= np.percentile(codes[core], SMOOTH_SHARE))
    return cv2.GaussianBlur(smooth.astype(np.float32), (0, 0), SMOOTHING_PX)
