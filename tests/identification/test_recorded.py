"""Identification on episodes of another simulator (../shared/data), where they are on this machine."""

import warnings
from pathlib import Path

import pytest

from egophys_core.evaluation import baseline_scores
from egophys_core.identification import FitOptions, build
from egophys_core.identification.surface_fit import shape_to_search
from egophys_core.kinds.kind import Touch
from egophys_core.observation import contact_flags, find_hands, observe_episode
from egophys_core.recording import EpisodeWarning, read_episode
from egophys_core.simulation import ContactKind

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
TOWELS = ("towel_none", "towel_drag")

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason="the recorded episodes (../shared/data) are not on this machine"
)


def recorded(name: str):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EpisodeWarning)
        return read_episode(DATA / name)


def contacts(name: str) -> list[list[tuple[ContactKind, int, int]]]:
    """Kind, first and last frame of the contacts of each hand."""
    return [[(each.kind, each.first, each.last) for each in hand.contacts] for hand in find_hands(recorded(name))]


@pytest.mark.parametrize(
    ("name", "hands"),
    [(f"open/{towel}/episode_{each}", hands) for towel in TOWELS for each, hands in enumerate([1, 2, 2, 1])]
    + [(f"open/plush_lump/episode_{each}", hands) for each, hands in enumerate([1, 1, 2])]
    # Points 0.1 s late; points that slip through the hand at 27 mm/s.
    + [("blind/case_04/episode_0", 1), ("blind/case_05/episode_0", 1)],
)
def test_hands_that_hold_do_from_one_second_to_the_end(name, hands):
    # The data's README: hands hold "from about 1 s on"; they stand still from frame 30 to 33 before they lift.
    found = contacts(f"{name}.mcap")
    assert len(found) == hands
    for (contact,) in found:
        assert contact[0] == ContactKind.HOLD
        assert 30 <= contact[1] <= 33
        assert contact[2] == 209


@pytest.mark.parametrize(("episode", "touches"), [(0, {Touch.HELD}), (3, {Touch.PRESSED})])
def test_a_search_knows_what_hands_did(episode, touches):
    toy = observe_episode(recorded(f"open/plush_lump/episode_{episode}.mcap"))
    assert shape_to_search([toy], FitOptions()).touches == touches


@pytest.mark.parametrize(
    ("name", "pushes"),
    [
        # By eye: the last frame before points near the hand move, and the one in which the hand begins to retreat;
        # in the first two the toy tips over and away from the hand before that.
        ("open/plush_lump", [(45, 78)]),
        ("blind/case_02", [(44, 64)]),
        ("blind/case_05", [(44, 80), (116, 137)]),
    ],
)
def test_hands_that_push_press_and_do_not_hold(name, pushes):
    (found,) = contacts(f"{name}/episode_3.mcap")
    assert found == [
        (ContactKind.PRESS, pytest.approx(first, abs=1), pytest.approx(last, abs=4)) for first, last in pushes
    ]


@pytest.mark.slow
def test_fitted_towel_tracks_held_out_frames_better_than_predictions_without_physics():
    episode = recorded("open/towel_none/episode_0.mcap")
    twin = build([episode], FitOptions(generations=16, frame_stride=4, max_nodes=200), seed=0)
    scores = twin.provenance.scores
    for name, baseline in baseline_scores(episode, contact_flags(episode, find_hands(episode))).items():
        assert scores["test_track_m"] < baseline.test_track_m, name
