"""Video to episode on small drawn bags: how exact it is, and what becomes of all that can be wrong with a video."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from egophys_core.errors import EpisodeError, RecordingError
from egophys_core.perception.observation import Observation
from egophys_core.perception.options import Completion, ObjectKind, PerceptionOptions
from egophys_core.perception.perceive import Perceived, perceive
from tests.perception.surface.surface_scene import (
    FOCAL,
    OPTIONS,
    SIDE,
    START_NS,
    DrawnFrame,
    bag,
    material_of,
    surface,
    video,
)

SLOW_OPTIONS = replace(OPTIONS, still_s=0.76)
"""Of videos slowed down twice."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """What came of a video."""

    perceived: Perceived
    seen: list[Observation]
    frames: tuple[DrawnFrame, ...]
    warned: list[str]

    @property
    def notes(self) -> str:
        """All notes in one text."""
        return " | ".join(self.perceived.report.notes)

    def error(self, index: int) -> np.ndarray:
        """[N] metres: how far trusted and seen points of an observation are from the material that they began on."""
        observation, first = self.seen[index], self.seen[0]
        material = material_of(first.points, self.of(first))
        good = observation.visible & (observation.confidence > 0.5)
        true = surface(self.of(observation))[material[good]]
        return np.asarray(np.linalg.norm(observation.points[good] - true, axis=1))

    def of(self, observation: Observation) -> DrawnFrame:
        """The drawn frame of an observation."""
        return next(frame for frame in self.frames if frame.stamp_ns == observation.view.stamp_ns)


def run(
    folder: Path,
    frames: Sequence[DrawnFrame],
    options: PerceptionOptions = OPTIONS,
    shuffle: bool = False,
    **written: Any,
) -> Run:
    """Write frames as a bag and perceive it."""
    frames = tuple(frames)
    order = [*frames]
    if shuffle:
        order[20], order[22] = order[22], order[20]
    seen: list[Observation] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        path = bag(folder / "bag", order, **written)
        perceived = perceive(path, options=options, on_observation=seen.append)
    return Run(perceived=perceived, seen=seen, frames=frames, warned=[str(each.message) for each in caught])


def slowed(frames: Sequence[DrawnFrame]) -> tuple[DrawnFrame, ...]:
    """The same at 15 frames a second."""
    return tuple(replace(each, stamp_ns=START_NS + 2 * (each.stamp_ns - START_NS)) for each in frames)


def hide_board(image: np.ndarray) -> np.ndarray:
    """A cloth over the upper half of the image, where the board is."""
    hidden = image.copy()
    hidden[: SIDE // 2 - 8] = (150, 170, 185)
    return hidden


@pytest.fixture(scope="module")
def sheet(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return run(tmp_path_factory.mktemp("sheet"), video("sheet"))


class TestGoodVideo:
    """A sheet that a hand folds."""

    def test_follows_the_material_to_millimetres(self, sheet: Run) -> None:
        for index in (0, 12, 22, 30, 44):
            error = sheet.error(index)
            assert len(error) > 0.5 * len(sheet.seen[0].points)
            assert error.mean() < 0.003
            assert np.percentile(error, 95) < 0.010

    def test_its_motion_is_not_just_zero(self, sheet: Run) -> None:
        moved = np.linalg.norm(sheet.seen[44].points - sheet.seen[0].points, axis=1)
        true = np.linalg.norm(sheet.frames[44].points - sheet.frames[0].points, axis=1)
        assert moved.max() == pytest.approx(true.max(), rel=0.15)
        assert (moved < 0.003).mean() == pytest.approx((true < 0.003).mean(), abs=0.1)

    def test_camera_is_where_it_was_drawn_from(self, sheet: Run) -> None:
        centres = [each.view.world_from_camera[:3, 3] - sheet.of(each).world_from_camera[:3, 3] for each in sheet.seen]
        assert np.linalg.norm(centres, axis=1).mean() < 0.001

    def test_each_frame_is_observed_once_and_in_order(self, sheet: Run) -> None:
        stamps = [each.view.stamp_ns for each in sheet.seen]
        assert stamps == [frame.stamp_ns for frame in sheet.frames]
        assert sheet.perceived.start_ns == stamps[0]
        np.testing.assert_allclose(sheet.perceived.episode.times, (np.array(stamps) - stamps[0]) * 1e-9, atol=1e-6)

    def test_points_keep_their_order(self, sheet: Run) -> None:
        assert {len(each.points) for each in sheet.seen} == {len(sheet.seen[0].points)}
        for before, after in pairwise(sheet.seen):
            both = before.visible & after.visible
            assert np.linalg.norm(after.points - before.points, axis=1)[both].max() < 0.03

    def test_pixels_are_the_projected_points(self, sheet: Run) -> None:
        for observation in sheet.seen[::11]:
            view = observation.view
            there = (observation.points - view.world_from_camera[:3, 3]) @ view.world_from_camera[:3, :3]
            pixels = there @ view.camera_matrix.T
            np.testing.assert_allclose(observation.pixels, pixels[:, :2] / pixels[:, 2:], atol=1e-6)

    def test_episode_is_for_the_twin(self, sheet: Run) -> None:
        episode, report = sheet.perceived.episode, sheet.perceived.report
        assert episode.points.shape[0] == len(sheet.frames)
        assert episode.points.shape[1] <= OPTIONS.object_points
        # One hand is seen, of two that there may be.
        assert episode.controllers.shape[:2] == (len(sheet.frames), OPTIONS.controllers)
        assert np.isfinite(episode.controllers).all()
        assert np.isfinite(episode.points[episode.confidence >= OPTIONS.least_confidence]).all()
        assert (report.frames, report.posed, report.pose_inferred, report.kind) == (45, 45, 0, "sheet")
        assert report.tracked == episode.points.shape[1]
        assert report.coverage == pytest.approx(np.isfinite(episode.points).all(axis=2).mean(), abs=0.02)
        assert report.coverage > 0.8

    def test_grip_begins_with_the_motion(self, sheet: Run) -> None:
        assert 18 <= sheet.perceived.report.grip_frame <= 28

    def test_hand_is_where_it_holds(self, sheet: Run) -> None:
        begin = sheet.perceived.report.grip_frame
        path = sheet.perceived.episode.controllers.mean(axis=1)[begin:]
        # The drawn hand touches the middle of the right end: of 33 by 33 points, one of the 17th row.
        held = np.array([frame.points[16 * 33 + 31] for frame in sheet.frames[begin:]])
        eyes = np.array([frame.world_from_camera[:3, 3] for frame in sheet.frames[begin:]])
        sight = (held - eyes) / np.linalg.norm(held - eyes, axis=1, keepdims=True)
        along = ((path - held) * sight).sum(axis=1)
        # By its width alone: a pixel of the 17 that the drawn hand is wide are 35 mm.
        assert np.abs(along).max() < 0.080
        assert np.linalg.norm(path - held - along[:, None] * sight, axis=1).max() < 0.020

    def test_thickness_is_the_height_of_its_skin(self, sheet: Run) -> None:
        assert sheet.perceived.report.thickness_m == pytest.approx(0.003, abs=0.0015)

    def test_verdict_is_good(self, sheet: Run) -> None:
        report = sheet.perceived.report
        assert report.verdict == "good", report.remarks
        (second,) = report.seconds
        assert second.coverage > 0.8
        assert second.doubtful < 0.1
        assert second.confidence > 0.8
        assert (second.hands, second.touching) == (1, 1)

    def test_nothing_to_note(self, sheet: Run) -> None:
        assert sheet.perceived.report.notes == ()
        assert sheet.warned == []


@pytest.fixture(scope="module")
def spoiled(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Raw, out of order, a black frame (24), a blurred one (26), two dropped ones (29, 30)."""

    def spoil(index: int, image: np.ndarray) -> np.ndarray | None:
        if index in (29, 30):
            return None
        return 0 * image if index == 24 else cv2.blur(image, (7, 3)) if index == 26 else image

    return run(tmp_path_factory.mktemp("spoiled"), video("sheet")[:36], raw=True, shuffle=True, spoil=spoil)


class TestSpoiltVideo:
    """The same as raw images, out of order, with frames that are black, blurred and not there."""

    def test_frames_that_show_something_are_observed_in_order(self, spoiled: Run) -> None:
        found = [round((each.view.stamp_ns - START_NS) * 30e-9) for each in spoiled.seen]
        assert found == [index for index in range(36) if index not in (24, 29, 30)]

    def test_black_frame_is_noted(self, spoiled: Run) -> None:
        assert "1 black frame(s) left out" in spoiled.notes

    def test_order_and_dropped_frames_are_warned_of(self, spoiled: Run) -> None:
        assert any("before their predecessor" in warning for warning in spoiled.warned)
        assert any("about 2 frames are missing" in warning for warning in spoiled.warned)

    def test_raw_images_are_taken_from_their_topic(self, spoiled: Run) -> None:
        assert any("/ego/image_raw" in warning and "taken from" in warning for warning in spoiled.warned)

    def test_is_as_exact_as_the_good_one_after_all(self, spoiled: Run, sheet: Run) -> None:
        assert spoiled.error(-1).mean() < 1.5 * sheet.error(35).mean() + 0.0005
        assert spoiled.perceived.report.coverage > 0.8

    def test_blurred_frame_is_still_near(self, spoiled: Run) -> None:
        index = next(i for i, each in enumerate(spoiled.seen) if each.view.stamp_ns == spoiled.frames[26].stamp_ns)
        assert spoiled.error(index).mean() < 0.004

    def test_controllers_are_complete(self, spoiled: Run) -> None:
        assert spoiled.perceived.episode.controllers.shape[1] == OPTIONS.controllers
        assert np.isfinite(spoiled.perceived.episode.controllers).all()


@pytest.fixture(scope="module")
def hidden(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """4 frames (0.33 s) are blurred, later the board is hidden for 8 (0.6 s), at 15 frames a second."""

    def spoil(index: int, image: np.ndarray) -> np.ndarray:
        if 14 <= index < 18:
            return cv2.GaussianBlur(image, (0, 0), 12)
        return hide_board(image) if 23 <= index < 31 else image

    return run(tmp_path_factory.mktemp("hidden"), slowed(video("sheet"))[:36], SLOW_OPTIONS, spoil=spoil)


class TestHiddenBoard:
    """The board is not seen for a while, nor the table for a shorter one."""

    def test_every_frame_has_a_pose_and_the_note_says_from_where(self, hidden: Run) -> None:
        assert len(hidden.seen) == 36
        assert hidden.perceived.report.pose_inferred == 4
        assert hidden.perceived.report.posed == 32
        assert "24 from the board, 8 from the table" in hidden.notes
        assert "4 interpolated over gaps of at most 0.5 s, 0 missing" in hidden.notes
        assert "too blurred" in hidden.notes

    def test_poses_are_near_the_truth(self, hidden: Run) -> None:
        for indices, off_m in ((range(14, 18), 0.010), (range(23, 31), 0.001)):
            for index in indices:
                observation = hidden.seen[index]
                true = hidden.of(observation).world_from_camera[:3, 3]
                assert np.linalg.norm(observation.view.world_from_camera[:3, 3] - true) < off_m

    def test_object_is_found_again_after_the_gap(self, hidden: Run) -> None:
        assert hidden.error(-1).mean() < 0.004
        assert hidden.seen[-1].visible.mean() > 0.5


@pytest.fixture(scope="module")
def covered(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The hand lies over everything for 1 s, at 15 frames a second; nothing moves."""
    frames = slowed(video("sheet", hand=False, covered=(14, 29)))[:34]
    return run(tmp_path_factory.mktemp("covered"), frames, SLOW_OPTIONS)


@pytest.mark.slow
class TestCoveredObject:
    """The hand over everything for a second."""

    def test_nothing_is_seen_meanwhile(self, covered: Run) -> None:
        assert len(covered.seen) == 34
        assert max(each.visible.mean() for each in covered.seen[16:29]) < 0.1

    def test_object_comes_back_with_the_same_ids(self, covered: Run) -> None:
        assert covered.seen[-1].visible.mean() > 0.5
        assert covered.error(-1).mean() < 0.003

    def test_it_stays_where_it_was_last_seen(self, covered: Run) -> None:
        assert np.linalg.norm(covered.seen[28].points - covered.seen[13].points, axis=1).max() < 0.01

    def test_what_was_not_seen_is_less_sure(self, covered: Run) -> None:
        assert np.median(covered.seen[28].confidence) < np.median(covered.seen[13].confidence)


@pytest.fixture(scope="module")
def misjudged(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Only the rest, without a hand, and a CameraInfo with a focal length 8 % too long."""
    return run(tmp_path_factory.mktemp("misjudged"), video("sheet")[:14], focal=1.08 * FOCAL)


class TestOddScenes:
    """Wrong intrinsics, two objects, no hand, no object, no board."""

    def test_wrong_focal_length_is_noted(self, misjudged: Run) -> None:
        assert "focal length" in misjudged.notes
        assert "calibrate" in misjudged.notes

    def test_no_hand_means_no_controllers_and_a_note(self, misjudged: Run) -> None:
        assert misjudged.perceived.episode.controllers.shape == (14, 0, 3)
        assert (misjudged.perceived.report.hand_seen, misjudged.perceived.report.grip_frame) == (0, -1)
        assert "no hand was seen" in misjudged.notes

    def test_verdict_says_all_of_that(self, misjudged: Run) -> None:
        report = misjudged.perceived.report
        assert report.verdict == "poor"
        doubted = {each.name: each for each in report.remarks if each.advice}
        assert set(doubted) == {"lens", "hands"}
        assert "focal length" in doubted["lens"].text
        assert [each.touching for each in report.seconds] == [0]

    def test_size_that_is_not_the_images_is_an_error(self, tmp_path: Path) -> None:
        with pytest.raises(EpisodeError, match=r"320.*640|640.*320"):
            run(tmp_path, video("sheet")[:5], size=(640, 480))

    def test_two_objects_are_noted(self, tmp_path: Path) -> None:
        found = run(tmp_path, video("sheet", hand=False, seconds=True)[:8])
        assert "box" in found.notes
        assert found.error(5).mean() < 0.004

    def test_box_chooses_the_other_object(self, tmp_path: Path) -> None:
        box = (230.0, 165.0, 312.0, 290.0)
        found = run(tmp_path, video("sheet", hand=False, seconds=True)[:8], replace(OPTIONS, object_box=box))
        assert np.median(found.seen[0].points[:, 0]) == pytest.approx(0.19, abs=0.02)

    def test_no_object_is_an_error_that_says_so(self, tmp_path: Path) -> None:
        with pytest.raises(EpisodeError, match="object"):
            run(tmp_path, video("sheet")[:8], spoil=lambda _, image: _without_object(image))

    def test_too_short_is_an_error(self, tmp_path: Path) -> None:
        with pytest.raises(EpisodeError, match="4 views"):
            run(tmp_path, video("sheet")[:4])

    def test_all_black_is_an_error(self, tmp_path: Path) -> None:
        with pytest.raises(EpisodeError):
            run(tmp_path, video("sheet")[:8], spoil=lambda _, image: 0 * image)

    def test_mirrored_video_is_an_error_that_says_so(self, tmp_path: Path) -> None:
        with pytest.raises(EpisodeError, match=r"mirror.*film again"):
            run(tmp_path, video("sheet")[:8], spoil=lambda _, image: np.ascontiguousarray(image[:, ::-1]))

    def test_not_a_bag_is_an_error(self, tmp_path: Path) -> None:
        (tmp_path / "x.mcap").write_bytes(b"not a bag")
        with pytest.raises(RecordingError):
            perceive(tmp_path / "x.mcap")

    def test_same_video_gives_the_same_episode(self, tmp_path: Path) -> None:
        one, other = (run(tmp_path / name, video("sheet")[:7]) for name in "ab")
        np.testing.assert_array_equal(one.perceived.episode.points, other.perceived.episode.points)
        np.testing.assert_array_equal(one.perceived.episode.confidence, other.perceived.episode.confidence)


def _without_object(image: np.ndarray) -> np.ndarray:
    empty = image.copy()
    empty[SIDE // 2 :] = np.random.default_rng(0).normal((140, 168, 190), 3, empty[SIDE // 2 :].shape).clip(0, 255)
    return empty


@pytest.fixture(scope="module")
def dome(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return run(tmp_path_factory.mktemp("dome"), video("dome"))


@pytest.mark.slow
class TestSolid:
    """A dome that a hand pushes."""

    def test_follows_the_material(self, dome: Run) -> None:
        for index in (0, 12, 30, 44):
            error = dome.error(index)
            assert error.mean() < 0.007
            assert np.percentile(error, 95) < 0.020

    def test_is_known_as_a_solid_and_closed(self, dome: Run) -> None:
        report, episode = dome.perceived.report, dome.perceived.episode
        assert (report.kind, report.thickness_m) == (str(ObjectKind.SOLID), 0.0)
        assert "symmetry" in dome.notes
        assert np.nanmin(episode.points[..., 2]) > -0.006
        hidden = dome.seen[0].hidden_points
        assert len(hidden) > 20
        assert len(hidden) < episode.points.shape[1]
        # Behind what the camera sees.
        assert hidden[:, 1].mean() > dome.seen[0].points[:, 1].mean() + 0.01

    def test_hidden_side_can_be_left_open(self, tmp_path: Path, dome: Run) -> None:
        open_ = run(tmp_path, video("dome")[:14], replace(OPTIONS, completion=Completion.NONE))
        assert open_.perceived.report.tracked < dome.perceived.report.tracked
