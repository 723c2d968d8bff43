"""A twin that loses to a prediction without physics says so, whichever of them is best, if enough is seen to tell."""

from dataclasses import replace

import numpy as np

from egophys_core.evaluation import Scores, lost_to
from tests.identification.synthetic import sheet_episode

EPISODE = sheet_episode()


def scores(track_m: float) -> Scores:
    return Scores(**{name: track_m if name == "test_track_m" else 0.0 for name in Scores.__dataclass_fields__})


def test_a_twin_that_wins_says_nothing() -> None:
    assert lost_to(scores(0.010), {"stays": scores(0.02), "follows": scores(0.011)}, EPISODE) == ""
    assert lost_to(scores(0.010), {}, EPISODE) == ""


def test_the_best_of_those_that_win_is_named() -> None:
    said = lost_to(scores(0.176), {"follows": scores(0.1), "stays": scores(0.0214), "turns": scores(0.3)}, EPISODE)
    assert "off by 176.0 mm on the held-out frames, 'stays' by 21.4; do not plan with it" in said


def test_no_verdict_where_most_is_hidden() -> None:
    points = EPISODE.points.copy()
    points[EPISODE.train_frames :, ::2] = np.nan
    said = lost_to(scores(0.176), {"stays": scores(0.02)}, replace(EPISODE, points=points))
    assert "is not told" in said
    assert "of the points are seen there" in said
    assert "do not plan" not in said


def test_what_cannot_be_compared_says_nothing() -> None:
    unknown = float("nan")
    assert lost_to(scores(unknown), {"stays": scores(0.02)}, EPISODE) == ""
    assert lost_to(scores(0.02), {"stays": scores(unknown)}, EPISODE) == ""
