"""A twin that loses to a prediction without physics says so, whichever of them is best."""

from egophys_core.evaluation import Scores, lost_to


def scores(track_m: float) -> Scores:
    return Scores(**{name: track_m if name == "test_track_m" else 0.0 for name in Scores.__dataclass_fields__})


def test_a_twin_that_wins_says_nothing() -> None:
    assert lost_to(scores(0.010), {"stays": scores(0.02), "follows": scores(0.011)}) == ""
    assert lost_to(scores(0.010), {}) == ""


def test_the_best_of_those_that_win_is_named() -> None:
    said = lost_to(scores(0.176), {"follows": scores(0.1), "stays": scores(0.0214), "turns": scores(0.3)})
    assert "off by 176.0 mm on the held-out frames, 'stays' by 21.4; do not plan with it" in said


def test_what_cannot_be_compared_says_nothing() -> None:
    unknown = float("nan")
    assert lost_to(scores(unknown), {"stays": scores(0.02)}) == ""
    assert lost_to(scores(0.02), {"stays": scores(unknown)}) == ""
