"""Bands of a flickering lamp, against images that only move and fade."""

import re

import numpy as np
import pytest

from egophys_core.perception.camera.exposure import flicker_note, row_brightness


def film(strength: float, frames: int = 20) -> list[np.ndarray]:
    """A table that shifts and slowly brightens under a lamp whose bands drift through the image."""
    random = np.random.default_rng(0)
    table = np.kron(random.uniform(90, 160, (80, 80)), np.ones((8, 8)))[:, :, None] * np.array([0.9, 1.0, 1.1])
    rows = np.arange(600) / 600
    return [
        (
            table[frame : frame + 600, :600]
            * (1 + 0.01 * frame + strength * np.sin(2 * np.pi * (3 * rows + 0.37 * frame)))[:, None, None]
        )
        .clip(0, 255)
        .astype(np.uint8)
        for frame in range(frames)
    ]


def test_bands_are_noted_with_their_size():
    # Between frames a sine of amplitude 0.2 turns by 0.37 of a period: it changes by 0.37, in the median by 0.26.
    note = flicker_note([row_brightness(image) for image in film(0.2)])
    assert note is not None
    percent = re.search(r"changes by (\d+) %", note)
    assert percent is not None
    assert float(percent[1]) == pytest.approx(26, abs=5)


def test_motion_and_slow_changes_are_not_bands():
    assert flicker_note([row_brightness(image) for image in film(0.0)]) is None
    assert flicker_note([]) is None
