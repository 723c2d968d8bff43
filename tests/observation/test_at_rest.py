"""What is held from the first frame on, as it is seen at rest."""

import warnings
from dataclasses import replace

import numpy as np

from egophys_core.observation.at_rest import from_rest
from tests.identification.synthetic import sheet_episode


def test_frames_and_tracks_that_are_not_seen_say_nothing():
    """Neither to the user, nor about where the others are."""
    episode = sheet_episode()
    points = episode.points.copy()
    points[2], points[:, 5] = np.nan, np.nan
    points[0, 7] += np.float32(0.004)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = from_rest(replace(episode, points=points), 6, 0.0)
    assert np.isnan(found.points[:, 5]).all()
    assert np.linalg.norm(found.points[0, 7] - episode.points[0, 7]) < 2e-3
