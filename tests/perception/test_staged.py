"""The paper's path over replaceable stages, with stages that know a moving scene exactly."""

import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.perception.options import PerceptionOptions
from egophys_core.perception.staged import episode_from_stages
from egophys_core.perception.stages import Masks, PointMap, Tracks, View

SIDE, FRAMES, HEIGHT = 64, 8, 0.6
MATRIX = np.array([[80.0, 0, 31.5], [0, 80.0, 31.5], [0, 0, 1]])
DOWN = np.diag([1.0, -1.0, -1.0, 1.0])
DOWN[2, 3] = HEIGHT
STEP = 2
"""Pixels a view that everything moves to the right."""


def views():
    for frame in range(FRAMES):
        yield View(
            stamp_ns=10**9 + frame * 33_000_000,
            image=np.zeros((SIDE, SIDE, 3), np.uint8),
            camera_matrix=MATRIX,
            world_from_camera=DOWN,
        )


class FlatObject:
    """A flat object of 16 x 16 pixels and a hand of 6 x 6 beside it, on a table seen from straight above."""

    def __init__(self, hand=True):
        self._hand = hand

    def masks(self, wanted):
        for frame, _ in enumerate(wanted):
            mask, hand = np.zeros((2, SIDE, SIDE), bool)
            mask[20:36, 10 + STEP * frame : 26 + STEP * frame] = True
            hand[24:30, 30 + STEP * frame : 36 + STEP * frame] = self._hand
            yield Masks(object=mask, hand=hand)

    def tracks(self, wanted, queries):
        count = sum(1 for _ in wanted)
        pixels = queries[None] + np.array([STEP, 0]) * np.arange(count)[:, None, None]
        return Tracks(pixels=pixels.astype(np.float32), visible=np.ones(pixels.shape[:2], bool))

    def point_maps(self, wanted):
        rows, columns = np.mgrid[:SIDE, :SIDE]
        for _ in wanted:
            x, y = (columns - 31.5) / 80 * HEIGHT, -(rows - 31.5) / 80 * HEIGHT
            points = np.stack([x, y, np.zeros_like(x)], axis=-1).astype(np.float32)
            yield PointMap(points=points, confidence=np.ones((SIDE, SIDE), np.float32))


def perceived(scene, **options):
    return episode_from_stages(views, scene, scene, scene, name="drawn", options=PerceptionOptions(**options))


def test_points_move_as_the_scene_does():
    episode = perceived(FlatObject())
    moved = episode.points[-1] - episode.points[0]
    inner = np.isfinite(moved).all(axis=1)
    assert inner.mean() > 0.9
    np.testing.assert_allclose(moved[inner], [[STEP * (FRAMES - 1) / 80 * HEIGHT, 0, 0]] * inner.sum(), atol=1e-5)
    assert episode.times[-1] == pytest.approx(0.033 * (FRAMES - 1))


def test_object_and_hand_are_kept_apart():
    episode = perceived(FlatObject())
    assert np.nanmax(episode.points[0, :, 0]) < episode.controllers[0, :, 0].min()


def test_counts_are_bounded_by_the_options():
    episode = perceived(FlatObject(), object_points=50, controllers=7)
    assert episode.points.shape[1] == 50
    assert episode.controllers.shape[1] == 7


def test_few_queries_are_spread_over_the_mask():
    episode = perceived(FlatObject(), queries=100)
    width = np.ptp(episode.points[0, :, 0])
    assert episode.points.shape[1] <= 100
    assert width > 0.7 * 16 / 80 * HEIGHT


def test_no_hand_is_an_error_that_says_so():
    with pytest.raises(EpisodeError, match="no point of the hand"):
        perceived(FlatObject(hand=False))


def test_an_empty_first_view_is_an_error():
    class Nothing(FlatObject):
        def masks(self, wanted):
            for _ in wanted:
                yield Masks(object=np.zeros((SIDE, SIDE), bool), hand=np.zeros((SIDE, SIDE), bool))

    with pytest.raises(EpisodeError, match="neither object nor hand"):
        perceived(Nothing())
