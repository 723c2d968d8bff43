"""A sheet at rest: its tilt comes back, and what is not flat tells nothing."""

import numpy as np
import pytest

from egophys_core.diagnosis.direct.table_level import tilt, tilt_gain
from egophys_core.effects.rotations import rotation

SHEET = np.stack([*np.meshgrid(np.linspace(0.1, 0.4, 8), np.linspace(-0.1, 0.1, 6)), np.full((6, 8), 0.005)], axis=-1)


def lying(about: tuple[float, float], *, seed: int = 0) -> np.ndarray:
    """Tracks of a sheet in a tracking frame tilted about x and y."""
    noise = np.random.default_rng(seed).normal(scale=3e-4, size=(48, 3))
    return np.asarray((SHEET.reshape(-1, 3) + noise) @ rotation(np.array([*about, 0.0])).T)


@pytest.mark.parametrize("about", [(0.0, 0.0), (0.03, 0.0), (0.0, -0.1), (-0.2, 0.15)])
def test_the_tilt_comes_back(about: tuple[float, float]):
    assert tilt(lying(about)) == pytest.approx(np.array(about), abs=3e-3)


def test_a_tilt_gains_where_the_sheet_lies_so_and_loses_elsewhere():
    about = np.array([0.03, 0.02])
    assert tilt_gain(lying((0.03, 0.02)), about) > 10.0
    assert tilt_gain(lying((0.03, 0.02)), -about) < 0.0
    assert tilt_gain(lying((0.0, 0.0)), about) < -10.0


def test_what_is_not_flat_tells_nothing():
    crumpled = lying((0.0, 0.0))
    crumpled[:, 2] += 0.02 * np.sin(30.0 * crumpled[:, 0])
    assert tilt(crumpled) is None


def test_too_few_tracks_tell_nothing():
    assert tilt(lying((0.0, 0.0))[:9]) is None
