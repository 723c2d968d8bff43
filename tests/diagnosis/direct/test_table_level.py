"""A sheet at rest: its tilt comes back, and what is not flat tells nothing."""

import numpy as np
import pytest

from egophys_core.diagnosis.direct.table_level import frame_values, level_gain, upward
from egophys_core.effects import LIBRARY
from egophys_core.effects.rotations import rotation

SHEET = np.stack([*np.meshgrid(np.linspace(0.1, 0.4, 8), np.linspace(-0.1, 0.1, 6)), np.full((6, 8), 0.005)], axis=-1)

TILTED = next(effect for effect in LIBRARY.values() if effect.frame)
"""The effect that turns the frame."""


def lying(about: tuple[float, float], *, seed: int = 0) -> np.ndarray:
    """Tracks of a sheet in a tracking frame tilted about x and y."""
    noise = np.random.default_rng(seed).normal(scale=3e-4, size=(48, 3))
    return np.asarray((SHEET.reshape(-1, 3) + noise) @ rotation(np.array([*about, 0.0])).T)


@pytest.mark.parametrize("about", [(0.0, 0.0), (0.03, 0.0), (0.0, -0.1), (-0.2, 0.15)])
def test_the_tilt_comes_back(about: tuple[float, float]):
    normal = upward(lying(about))
    assert normal == pytest.approx(rotation(np.array([*about, 0.0]))[:, 2], abs=3e-3)
    assert frame_values(TILTED, normal) == pytest.approx(np.array(about), abs=3e-3)


def test_a_tilt_gains_where_the_sheet_lies_so_and_loses_elsewhere():
    frame = rotation(np.array([0.03, 0.02, 0.0]))
    assert level_gain(lying((0.03, 0.02)), frame) > 10.0
    assert level_gain(lying((0.03, 0.02)), frame.T) < 0.0
    assert level_gain(lying((0.0, 0.0)), frame) < -10.0


def test_what_is_not_flat_tells_nothing():
    crumpled = lying((0.0, 0.0))
    crumpled[:, 2] += 0.02 * np.sin(30.0 * crumpled[:, 0])
    assert upward(crumpled) is None


def test_too_few_tracks_tell_nothing():
    assert upward(lying((0.0, 0.0))[:9]) is None
