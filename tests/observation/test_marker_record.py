"""Records of markers: from where rollouts can begin."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError
from egophys_core.kinds.kind import MarkerBody
from egophys_core.observation.marker_record import find_onset
from egophys_core.twin import ObjectModel
from tests.diagnosis.cantilever import (
    TRACKS,
    body_and_model,
    ring_down_episode,
    still_episode,
)
from tests.kinds.seen_markers import marker_body


@pytest.fixture(scope="module")
def cantilever() -> tuple[MarkerBody, ObjectModel, Episode]:
    body, model = body_and_model()
    return body, model, ring_down_episode(body, model)


def test_begins_where_the_ring_down_turns_back(cantilever: tuple[MarkerBody, ObjectModel, Episode]) -> None:
    episode = cantilever[2]
    onset = find_onset(episode)
    heights = episode.points[:, :, 2].mean(axis=1)
    assert abs(onset.frame - int(heights[:40].argmin())) <= 1
    assert onset.markers[:, 2].mean() == pytest.approx(heights[:40].min(), abs=5e-5)


def test_what_is_not_let_go_begins_at_once() -> None:
    onset = find_onset(still_episode())
    assert (onset.frame, onset.time) == (0, 0.0)


def test_markers_that_are_never_all_seen_are_refused() -> None:
    points = still_episode().points.copy()
    points[::2, 0], points[1::2, 1] = np.nan, np.nan
    points[0, 2] = np.nan
    hidden = replace(still_episode(), points=points)
    with pytest.raises(EpisodeError, match=f"no frame shows all {len(TRACKS)} markers"):
        marker_body(hidden, None)
    points[-1] = still_episode().points[-1]
    with pytest.raises(EpisodeError, match="no frame shows all"):
        marker_body(replace(hidden, points=points), None)
