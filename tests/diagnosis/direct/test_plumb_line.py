"""A sheet that hangs at rest: by how much the record leans comes back, and what does not hang still tells nothing."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from egophys_core.diagnosis.direct.measured import MeasuredEffect, Recordings
from egophys_core.diagnosis.direct.plumb_line import lean, plumb_line_effects, tilt_values
from egophys_core.diagnosis.thresholds import Thresholds
from egophys_core.effects import LIBRARY
from egophys_core.effects.rotations import rotation
from egophys_core.episode import Episode
from egophys_core.observation import observe_episode
from tests.observation.test_hanging import recorded

(TILT,) = (effect for effect in LIBRARY.values() if effect.plumb)
"""The effect that tilts gravity."""


def hanging(seed: int, about: tuple[float, float] = (0.0, 0.0), *, facing: float = 0.0) -> Episode:
    """A record in a frame tilted about x and y, of hands turned about the vertical so far from side by side along x."""
    episode = recorded(seed, delay=0.33, noise=0.003)
    turn = rotation(np.array([*about, 0.0])) @ rotation(np.array([0.0, 0.0, facing]))
    points, hands = episode.points @ turn.T, episode.controllers @ turn.T
    return replace(episode, points=points.astype(np.float32), controllers=hands.astype(np.float32))


def tracked(episode: Episode) -> Any:
    """What is asked of an episode that was prepared for a twin."""
    seen = observe_episode(episode)
    return SimpleNamespace(
        rest=seen.at_rest,
        episode=seen.episode,
        observed=seen,
    )


def found(*episodes: Episode, lies_flat: bool = True) -> list[MeasuredEffect]:
    """The measurement by all but the last record, which validates it."""
    *fitted, validation = map(tracked, episodes)
    recordings = Recordings(
        fitted=fitted,
        validation=[validation],
        lies_flat=lies_flat,
        resamples=100,
        seed=0,
        thresholds=Thresholds(),
    )
    return plumb_line_effects([TILT.name], recordings)


def test_a_tilt_out_of_the_plane_comes_back_and_names_what_is_the_same():
    (tilt,) = found(*(hanging(seed, (0.04, 0.0)) for seed in (1, 2, 3)))
    assert tilt.shows
    assert tilt.values["about_x"] == pytest.approx(0.04, abs=0.004)
    assert tilt.values["about_y"] == pytest.approx(0.0, abs=1e-3)
    assert "2.3 degrees aslant in all 2 episodes, as it would by tracking_rotation" in tilt.reason


def test_what_faces_nearly_alike_tells_nothing_of_the_other_direction():
    # Of two recorded cloths: taken to the letter, normals that differ by 0.004 rad would ask for half a radian.
    leans = [np.array([-0.00151, 0.03699, 0.0]), np.array([-0.00157, 0.04255, 0.0])]
    assert tilt_values(TILT, leans) == pytest.approx([0.04, 0.0], abs=1e-3)


def test_nothing_injected_nothing_shows():
    (tilt,) = found(*map(hanging, (1, 2, 3)))
    assert not tilt.shows
    assert abs(tilt.values["about_x"]) < 0.005


def test_a_tilt_that_is_another_one_in_a_record_does_not_show():
    (tilt,) = found(hanging(1, (0.04, 0.0)), hanging(2, (-0.04, 0.0)), hanging(3, (0.04, 0.0)))
    assert not tilt.shows


def test_records_that_face_elsewhere_tell_both_directions():
    leans = [lean(tracked(hanging(seed, (0.05, -0.03), facing=facing))) for seed, facing in ((1, 0.0), (2, 1.5))]
    assert tilt_values(TILT, [each for each in leans if each is not None]) == pytest.approx([0.05, -0.03], abs=0.004)


@pytest.mark.parametrize("changes", [{"hangs": False}, {"still": 3}])
def test_what_does_not_hang_still_tells_nothing(changes: dict[str, Any]):
    episode = tracked(hanging(1, (0.04, 0.0)))
    assert lean(episode) is not None
    episode.observed = replace(episode.observed, **changes)
    assert lean(episode) is None


def test_too_few_points_tell_nothing():
    episode = tracked(hanging(1, (0.04, 0.0)))
    episode.rest = np.zeros((9, 3))
    assert lean(episode) is None


def test_what_is_crumpled_tells_nothing():
    episode = tracked(hanging(1, (0.04, 0.0)))
    episode.rest = episode.rest + [0.0, 0.03, 0.0] * np.sin(40.0 * episode.rest[:, :1])
    assert lean(episode) is None


def test_what_is_held_in_one_place_tells_nothing():
    episode = tracked(hanging(1, (0.04, 0.0)))
    episode.observed = replace(episode.observed, hands=episode.observed.hands[:1])
    assert lean(episode) is None


def test_what_does_not_lie_flat_tells_nothing():
    assert found(*(hanging(seed, (0.04, 0.0)) for seed in (1, 2, 3)), lies_flat=False) == []
