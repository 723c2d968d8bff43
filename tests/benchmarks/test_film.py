"""Errors of the film benchmark, on small episodes whose errors are known."""

import numpy as np
import pytest

from benchmarks.film_errors import StampedEpisode, hand_errors, held_out_error, surface_errors
from egophys_core.episode import Episode
from egophys_core.observation import Contact, Hand
from egophys_core.simulation import ContactKind

FRAMES, STEP_NS = 40, 50_000_000
"""Two seconds at 20 Hz."""
GRID = np.stack(np.meshgrid(np.arange(5), np.arange(5), [0], indexing="ij"), axis=-1).reshape(-1, 3) * 0.02


def stamped(points=GRID, hands=((0.5, 0, 0),), **changed):
    points = np.array(np.broadcast_to(points, (FRAMES, 25, 3)), np.float32)
    hands = np.array(np.broadcast_to(hands, (FRAMES, len(hands), 3)), np.float32)
    values = {
        "name": "drawn",
        "times": np.arange(FRAMES) * STEP_NS * 1e-9,
        "points": points,
        "confidence": np.isfinite(points).all(axis=2).astype(np.float32),
        "point_ids": np.arange(25, dtype=np.uint32),
        "controllers": hands,
        "controller_ids": np.arange(hands.shape[1], dtype=np.uint32),
    } | changed
    return StampedEpisode(episode=Episode(**values), stamps_ns=7_000_000_000 + STEP_NS * np.arange(FRAMES))


def hand(*controllers, first=None):
    contacts = () if first is None else (Contact(first=first, last=FRAMES - 1, kind=ContactKind.HOLD),)
    return Hand(controllers=np.array(controllers), contacts=contacts)


def test_doubtful_points_are_not_covered_and_wrong_ones_are_counted():
    points = np.repeat(GRID[None], FRAMES, axis=0)
    points[20:, :5] += (0.0, 0.0, 0.02)
    points[20:, 5:10] += (0.0, 0.0, 0.01)
    confidence = np.ones((FRAMES, 25), np.float32)
    confidence[20:, 10:20] = 0.4
    found = surface_errors(stamped(points, confidence=confidence), stamped())
    # All of the first second, then 15 points a frame, 5 of them wrong.
    assert found["coverage"] == pytest.approx((25 + 15) / 50)
    assert found["least_coverage_second"] == pytest.approx(15 / 25)
    assert found["wrong_share_confident"] == pytest.approx(5 / 40)
    assert found["surface_mean_mm"] == pytest.approx((5 * 20 + 5 * 10) / 40, rel=1e-3)
    assert found["surface_p95_mm"] == pytest.approx(20, rel=1e-3)


def test_hands_are_assigned_and_compared_from_their_first_contact_on():
    true = ((0.0, 0, 0), (0.02, 0, 0), (0.6, 0, 0))
    hands = [hand(0, 1, first=10), hand(2, first=20)]
    near = np.repeat(np.array([[(0.6, 0.004, 0), (0.01, 0, 0.03)]]), FRAMES, axis=0)
    near[:10, 1] += 5.0
    both = hand_errors(stamped(hands=((0.0,) * 3,) * 2, controllers=near), [[0], [1]], stamped(hands=true), hands)
    assert both["hands"] == "2 of 2"
    assert both["hand_mean_mm"] == pytest.approx([30, 4], rel=1e-4)
    one = hand_errors(stamped(hands=((0.6, 0.004, 0),)), [[0]], stamped(hands=true), hands)
    assert one["hands"] == "1 of 2"
    assert one["hand_mean_mm"] == pytest.approx([np.nan, 4], rel=1e-4, nan_ok=True)
    never = hand_errors(stamped(), [[0]], stamped(), [hand(0)])
    assert never == {"hands": "1 of 1", "hand_mean_mm": pytest.approx([np.nan], nan_ok=True)}
    nothing = hand_errors(stamped(hands=np.zeros((0, 3))), [], stamped(hands=true), hands)
    assert nothing == {"hands": "0 of 2", "hand_mean_mm": pytest.approx([np.nan] * 2, nan_ok=True)}


def test_held_out_error_is_of_the_last_frames_by_their_stamps():
    truth = stamped()
    nodes = np.repeat(GRID[None, ::-1], FRAMES, axis=0)
    nodes[28:] += (0.0, 0.003, 0.004)
    assert held_out_error(nodes, truth.stamps_ns, truth) == pytest.approx(5.0)
    # A video that begins earlier and misses frames is compared where both have one.
    earlier = np.append(truth.stamps_ns[0] - STEP_NS, truth.stamps_ns)[:35]
    shifted = np.concatenate([nodes[:1], nodes])[:35]
    assert held_out_error(shifted, earlier, truth) == pytest.approx(5.0)
