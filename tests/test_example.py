"""The shipped episode, as `make demo` uses it."""

from pathlib import Path

import pytest

from egophys_core.evaluation import Scores, baseline_scores
from egophys_core.identification import FitOptions, build
from egophys_core.observation import contact_flags, find_hands
from egophys_core.recording import read_episode

EPISODE = Path(__file__).resolve().parents[1] / "examples/towel_lift.mcap"


@pytest.mark.slow
def test_fitted_twin_beats_both_baselines_on_the_held_out_frames():
    episode = read_episode(EPISODE)
    scores = Scores(**build([episode], FitOptions(), seed=0).provenance.scores)
    for baseline in baseline_scores(episode, contact_flags(episode, find_hands(episode))).values():
        assert scores.test_track_m < baseline.test_track_m
        assert scores.test_chamfer_m < baseline.test_chamfer_m
