"""The live observer: as the recorded pipeline, frame by frame, and never down for a bad frame."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.perception.camera.lens import Camera
from egophys_core.perception.learned import LearnedModelError
from egophys_core.perception.live import LiveObserver
from egophys_core.perception.observation import Observation
from egophys_core.perception.options import HandCue
from tests.perception.surface.surface_scene import MATRIX, OPTIONS, SIDE, DrawnFrame, material_of, surface, video

FRAMES = video()[:24]
COVERED = (19, 20)
BLACK = np.zeros((SIDE, SIDE, 3), np.uint8)

Live = tuple[list[list[Observation]], list[str]]


def observer() -> LiveObserver:
    return LiveObserver(Camera(width=SIDE, height=SIDE, matrix=MATRIX, coefficients=np.zeros(5)), options=OPTIONS)


def test_missing_models_of_hands_are_told_before_the_first_frame(tmp_path):
    camera = Camera(width=SIDE, height=SIDE, matrix=MATRIX, coefficients=np.zeros(5))
    with pytest.raises(LearnedModelError, match="lacks palm_detection"):
        LiveObserver(camera, options=replace(OPTIONS, hands=HandCue.MEDIAPIPE, weights=str(tmp_path)))


@pytest.fixture(scope="module")
def run() -> Live:
    """Observations and status after each frame.

    Two black frames and an old one come in between (after 16); in 19 and 20 the board is covered.
    """
    live, found, said = observer(), [], []
    for index, frame in enumerate(FRAMES):
        image = frame.image.copy()
        if index in COVERED:
            image[: SIDE // 2 - 8] = (150, 170, 185)
        found.append(live.add(frame.stamp_ns, image))
        said.append(live.status)
        if index == 16:
            for stamp_ns, image in ((frame.stamp_ns + 1000, BLACK), (frame.stamp_ns - 1000, frame.image)):
                assert live.add(stamp_ns, image) == []
                said[-1] = f"{said[-1]} | {live.status}"
    return found, said


def frame_of(observation: Observation) -> DrawnFrame:
    return next(each for each in FRAMES if each.stamp_ns == observation.view.stamp_ns)


def test_nothing_while_it_learns_then_all_of_it_then_one_a_frame(
    run: tuple[list[list[Observation]], list[str]],
) -> None:
    counts = [len(each) for each in run[0]]
    begun = next(index for index, count in enumerate(counts) if count)
    assert counts[:begun] == [0] * begun
    assert counts[begun] == begun + 1
    assert counts[begun + 1 :] == [1] * (len(FRAMES) - begun - 1)
    assert 10 <= begun <= 13


def test_status_says_what_it_does(run: Live) -> None:
    assert "keep hands away" in run[1][3]
    assert "tracking" in run[1][15]
    assert "black" in run[1][16] or "not later" in run[1][16]


def test_points_are_as_exact_as_recorded_ones(run: Live) -> None:
    seen = [one for each in run[0] for one in each]
    assert [each.view.stamp_ns for each in seen] == [each.stamp_ns for each in FRAMES]
    material = material_of(seen[0].points, FRAMES[0])
    last = seen[-1]
    away = np.linalg.norm(last.points - surface(frame_of(last))[material], axis=1)
    assert away[last.visible].mean() < 0.004


def test_table_carries_the_pose_while_the_board_is_covered(run: Live) -> None:
    for index in COVERED:
        (seen,) = run[0][index]
        assert np.linalg.norm(seen.view.world_from_camera[:3, 3] - FRAMES[index].world_from_camera[:3, 3]) < 0.003


def test_same_number_of_points_in_every_observation(run: Live) -> None:
    assert len({len(one.points) for each in run[0] for one in each}) == 1


def test_no_board_is_said_and_does_no_harm() -> None:
    live = observer()
    for index in range(3):
        assert live.add(1 + index * 33_000_000, np.full_like(BLACK, 130)) == []
        assert "no camera pose" in live.status


def test_without_an_object_it_tries_again() -> None:
    live = observer()
    empty = [frame.image.copy() for frame in FRAMES[:14]]
    for image in empty:
        image[SIDE // 2 :] = np.random.default_rng(0).normal((140, 168, 190), 3, image[SIDE // 2 :].shape).clip(0, 255)
    said = []
    for frame, image in zip(FRAMES, empty, strict=False):
        assert live.add(frame.stamp_ns, image) == []
        said.append(live.status)
    assert any("object" in each and "failed" in each for each in said)


def test_first_status_says_it_waits() -> None:
    assert "waiting" in observer().status
