"""How an object pulls on hands: by weight and inertia off the table, by friction on it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from egophys_core.diagnosis.direct.pulls import pulls_of

TIMES = np.arange(60) / 30.0
REST = np.random.default_rng(0).uniform(-0.05, 0.05, (40, 3)) + [0.0, 0.0, 0.06]
"""[P, 3] a toy on the table."""


def tracked(velocity: tuple[float, float, float], *, up: float = 0.0, hangs: bool = False, shakes: float = 0.0) -> Any:
    """What is asked of an episode in which it moves at one velocity, so far over the table, and to and fro."""
    phase = 12.0 * TIMES[:, None]
    aside = np.array([1.0, 0.0, 0.0])
    path = np.array(velocity) * TIMES[:, None] + [0.0, 0.0, up] + shakes * np.sin(phase) * aside
    velocities = np.array(velocity) + 12.0 * shakes * np.cos(phase) * aside
    tracks = np.broadcast_to(REST + path[:, None], (len(TIMES), *REST.shape)).copy()
    speeds = np.broadcast_to(velocities[:, None], tracks.shape).copy()
    hidden = np.random.default_rng(1).random(tracks.shape[:2]) < 0.3
    tracks[hidden], speeds[hidden] = np.nan, np.nan
    return SimpleNamespace(
        rest=REST,
        episode=SimpleNamespace(times=TIMES),
        observed=SimpleNamespace(hangs=hangs),
        tracks=SimpleNamespace(smooth=tracks, velocities=speeds),
    )


@pytest.mark.parametrize("changes", [{"up": 0.1}, {"hangs": True}], ids=["lifted", "hanging from the start"])
def test_what_is_off_the_table_pulls_by_its_weight(changes: dict[str, Any]):
    assert pulls_of(tracked((0.1, 0.0, 0.0), **changes)) == pytest.approx(np.tile([0.0, 0.0, -1.0], (60, 1)), abs=1e-9)


def test_what_is_swung_pulls_by_its_inertia_too():
    pulls = pulls_of(tracked((0.0, 0.0, 0.0), up=0.2, shakes=0.05))
    expected = 0.05 * 12.0**2 / 9.81 * np.sin(12.0 * TIMES)
    assert pulls[2:-2, 0] == pytest.approx(expected[2:-2], abs=0.05)


def test_what_slides_over_the_table_pulls_against_its_way():
    assert pulls_of(tracked((0.0, 0.3, 0.0))) == pytest.approx(np.tile([0.0, -0.5, 0.0], (60, 1)), abs=1e-9)


def test_what_lies_still_hardly_pulls():
    assert np.abs(pulls_of(tracked((1e-3, 0.0, 0.0)))).max() < 0.05
