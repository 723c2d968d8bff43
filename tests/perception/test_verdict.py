"""What was seen in each second of a video, and the verdict on it."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.perception.observation import HandSight
from egophys_core.perception.remarks import Level, sentences, verdict_of
from egophys_core.perception.seconds import Second, SecondsSeen
from egophys_core.perception.verdict import judge
from tests.perception.observations import observations

GOOD = {
    "frames": 90,
    "posed": 90,
    "hand_seen": 60,
    "has_contact": True,
    "still_s": 1.0,
    "rest_px": 0.15,
}


def second(start, coverage=0.8, doubtful=0.05, touching=1):
    return Second(
        start_s=float(start), coverage=coverage, doubtful=doubtful, confidence=0.9, hands=touching, touching=touching
    )


SECONDS = (second(0, touching=0), second(1), second(2))


def test_all_well_is_good_and_says_what_was_measured():
    remarks = judge(seconds=SECONDS, **GOOD)
    assert verdict_of(remarks) == "good"
    assert [each.advice for each in remarks] == [""] * len(remarks)
    assert "90 of 90 frames" in remarks[0].text
    assert "one hand acts on the object, from second 1 on" in {each.text for each in remarks}


@pytest.mark.parametrize(
    ("changed", "verdict", "name", "said", "advised"),
    [
        ({"posed": 30}, "poor", "camera", "30 of 90 frames", "board"),
        ({"posed": 70}, "usable", "camera", "70 of 90 frames", "board"),
        ({"scale_is_known": False}, "usable", "scale", "assumed height", "board"),
        ({"lens": "the focal length is 10 % too long"}, "usable", "lens", "10 % too long", "calibrate"),
        ({"choice": "3 things could be the object"}, "usable", "object", "3 things", "--object"),
        (
            {"rest_px": 0.6},
            "usable",
            "rest",
            "the object rests in the first 1 s: its points are 0.6 pixels",
            "do not touch",
        ),
        ({"rest_px": 1.4}, "poor", "rest", "never rests in the first 1 s: its points are 1.4 pixels", "do not touch"),
        ({"rest_px": float("inf")}, "poor", "rest", "no pattern", "dots, stripes or stickers"),
        ({"hand_seen": 0, "has_contact": False}, "poor", "hands", "no hand is seen", "handle the object in view"),
        ({"has_contact": False}, "poor", "hands", "seen in 60 frames, and the object never moves", "handle the object"),
    ],
)
def test_what_is_wrong_is_said_with_its_number_and_what_to_do(changed, verdict, name, said, advised):
    remarks = judge(seconds=SECONDS, **{**GOOD, **changed})
    assert verdict_of(remarks) == verdict
    (found,) = (each for each in remarks if each.level != Level.OK)
    assert found.name == name
    assert said in found.text
    assert advised in found.advice
    assert (said in sentences(remarks, Level.BAD)) == (verdict == "poor")


@pytest.mark.parametrize(
    ("coverage", "verdict", "said"),
    [
        ((0.9, 0.8, 0.7), "good", "80 % of the points are found, 70 % in second 2; less than 12 % in 0 of 3 seconds"),
        ((0.9, 0.2, 0.2), "usable", "20 % in second 1; less than 12 % in 0 of 3 seconds"),
        ((0.9, 0.05, 0.7), "usable", "5 % in second 1; less than 12 % in 1 of 3 seconds"),
        ((0.9, 0.1, 0.0), "poor", "0 % in second 2; less than 12 % in 2 of 3 seconds"),
    ],
)
def test_coverage_counts_in_every_second(coverage, verdict, said):
    seconds = [second(index, coverage=each) for index, each in enumerate(coverage)]
    remarks = judge(seconds=seconds, **GOOD)
    assert verdict_of(remarks) == verdict
    assert any(said in each.text for each in remarks)


@pytest.mark.parametrize(("doubtful", "verdict"), [(0.1, "good"), (0.4, "usable"), (1.2, "poor")])
def test_many_doubtful_points_make_a_poor_video(doubtful, verdict):
    remarks = judge(seconds=[second(0, coverage=0.8, doubtful=doubtful)], **GOOD)
    assert verdict_of(remarks) == verdict


def test_two_hands_are_counted():
    remarks = judge(seconds=[second(0, touching=2)], **GOOD)
    assert any("2 hands act on the object, from second 0 on" in each.text for each in remarks)


def test_seconds_count_points_and_hands_over_all_frames_of_the_video():
    (one,) = observations(1, points=10)
    none = replace(one.masks, hand=np.zeros_like(one.masks.hand))
    one = replace(one, masks=none, hand_points=np.full_like(one.hand_points, np.nan))
    sure = np.array([1.0] * 6 + [0.3] * 3 + [0.0])
    here = HandSight(pixel=np.zeros(2), depth=0.5, radius=9.0, grip=np.full(3, np.nan), holds=False)
    hands = {0: here, 1: replace(here, grip=np.zeros(3))}
    stamps_ns = [5_000_000_000 + 50_000_000 * frame for frame in range(44)]
    seen = SecondsSeen(least_confidence=0.5)
    for frame in range(32):
        view = replace(one.view, stamp_ns=stamps_ns[frame])
        seen.add(replace(one, view=view, confidence=sure, hands=hands if frame >= 20 else {}))
    first, last = seen.seconds(stamps_ns)
    assert (first.start_s, first.hands, first.touching, first.confidence) == (0.0, 0, 0, 1.0)
    assert (first.coverage, first.doubtful) == pytest.approx((0.6, 0.3))
    # Half of its frames, with those of the rest of the video, were not observed.
    assert (last.start_s, last.hands, last.touching) == (1.0, 2, 1)
    assert (last.coverage, last.doubtful) == pytest.approx((0.3, 0.15))
    assert seen.hand_seen == 12
    (nothing,) = SecondsSeen(least_confidence=0.5).seconds([0, 400_000_000])
    assert (nothing.coverage, nothing.hands) == (0.0, 0)
    assert np.isnan(nothing.confidence)
