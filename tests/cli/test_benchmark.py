import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.drawn_video import MATRIX, SIZE, Drawing, write_bag
from egophys_core.cli.perception_benchmark import KEYS, TRUE_MASK_TOPIC, TRUE_POSE_TOPIC
from egophys_core.errors import EpisodeError
from egophys_core.perception.camera.lens import Camera, SquareView, turn_rotation
from egophys_core.perception.observation import Observation
from egophys_core.perception.perceive import Perceived
from egophys_core.perception.stages import Masks, View
from egophys_core.recording import LogWriter, list_topics, read_records
from tests.perception.observations import START_NS, perceived_from

FRAMES = 24
STEP_NS = 33_333_333


def raw_pose(frame: int, turns: int) -> np.ndarray:
    """A camera that looks down at a slant, held turned by so many clockwise quarters."""
    slant = 0.6
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([[1, 0, 0], [0, -np.cos(slant), -np.sin(slant)], [0, np.sin(slant), -np.cos(slant)]])
    pose[:3, 3] = 0.002 * frame, -0.35, 0.5
    return pose @ turn_rotation(-turns)


def shape(frame: int) -> np.ndarray:
    flat = np.stack(np.meshgrid(np.linspace(-0.06, 0.06, 21), np.linspace(-0.05, 0.05, 18)), axis=-1).reshape(-1, 2)
    return np.column_stack([flat + [0.001 * max(0, frame - 16), 0], np.full(len(flat), 0.01)])


def seen_in(points: np.ndarray, matrix: np.ndarray, pose: np.ndarray) -> np.ndarray:
    camera = (np.linalg.inv(pose) @ np.column_stack([points, np.ones(len(points))]).T)[:3]
    return (matrix @ camera / camera[2])[:2].T


def mask_of(pixels: np.ndarray, side: int) -> np.ndarray:
    """The bounding box of pixels."""
    y, x = np.mgrid[:side, :side]
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    return (x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1])


def drawings(turns: int) -> Iterator[Drawing]:
    for frame in range(FRAMES):
        points, pose = shape(frame), raw_pose(frame, turns)
        yield Drawing(
            stamp_ns=START_NS + frame * STEP_NS,
            image=np.full((SIZE, SIZE, 3), 90, np.uint8),
            object_mask=mask_of(seen_in(points, MATRIX, pose), SIZE),
            world_from_camera=pose,
            points=points,
            visible=np.ones(len(points), bool),
            hand=points[:3] + [0, 0, 0.1],
        )


def observations(turns: int, side: int = 518) -> list[Observation]:
    """What perception without any error would give."""
    camera = Camera(width=SIZE, height=SIZE, matrix=MATRIX, coefficients=np.zeros(0))
    view = SquareView(camera, turns=turns, side=side)
    found = []
    for frame in range(FRAMES):
        points, pose = shape(frame), view.from_raw_pose(raw_pose(frame, turns))
        pixels = seen_in(points, view.matrix, pose)
        nothing = np.zeros((side, side), bool)
        found.append(
            Observation(
                view=View(
                    stamp_ns=START_NS + frame * STEP_NS,
                    image=np.zeros((side, side, 3), np.uint8),
                    camera_matrix=view.matrix,
                    world_from_camera=pose,
                ),
                masks=Masks(object=mask_of(pixels, side), hand=nothing),
                points=points,
                confidence=np.ones(len(points)),
                pixels=pixels,
                visible=np.ones(len(points), bool),
                mesh_pixels=pixels,
                mesh_edges=np.zeros((0, 2), int),
                hand_points=points[:3] + [0, 0, 0.1],
                hands={},
            )
        )
    return found


@pytest.fixture
def perception(monkeypatch):
    """Stands for perception; `perception(seen)` makes it give these observations, or raise this error."""

    def gives(seen: list[Observation] | Exception) -> None:
        def fake(path, *, on_observation, progress, **_) -> Perceived:
            if isinstance(seen, Exception):
                raise seen
            for each in seen:
                on_observation(each)
            return perceived_from(seen)

        monkeypatch.setattr("egophys_core.perception.perceive.perceive", fake)

    return gives


@pytest.fixture(scope="module")
def bag(tmp_path_factory) -> Path:
    return write_bag(tmp_path_factory.mktemp("truth") / "flat", drawings(0))


@pytest.fixture(scope="module")
def bag_without_truth(bag, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("measured") / "flat"
    with LogWriter(folder) as log:
        kept = [topic for topic in list_topics(bag) if topic.name not in (TRUE_POSE_TOPIC, TRUE_MASK_TOPIC)]
        for topic in kept:
            log.add_topic(topic.name, topic.type)
        for record in read_records(bag, [topic.name for topic in kept]):
            log.write(record.topic, record.cdr, record.log_time_ns)
    return folder


def row_of(egophys_json, *arguments: object) -> dict:
    (row,) = egophys_json("benchmark", "perception", *arguments)["rows"]
    assert set(row) == set(KEYS)
    return row


@pytest.mark.parametrize("turns", range(4))
def test_what_is_exact_has_no_error_however_the_camera_is_held(egophys_json, perception, tmp_path, turns):
    perception(observations(turns))
    row = row_of(egophys_json, write_bag(tmp_path / "flat", drawings(turns)))
    assert row["video"] == "flat"
    assert row["mean_mm"] < 0.001
    assert row["pose_mm"] < 0.001
    assert row["pose_deg"] < 0.001
    assert row["mask_j"] > 0.97
    assert row["mask_f"] > 0.999
    assert row["points_in_mask"] > 0.9
    assert [row[key] for key in ("coverage", "id_stability", "track_delta_avg", "track_aj", "track_oa")] == [1.0] * 5
    assert (row["views"], row["posed"]) == (FRAMES, FRAMES)
    assert row["seconds"] > 0


def test_without_truth_in_the_bag_there_is_none_in_the_row(egophys_json, perception, bag_without_truth):
    perception(observations(0))
    row = row_of(egophys_json, bag_without_truth)
    assert {key for key, value in row.items() if value is None} == {
        "pose_mm",
        "pose_deg",
        "pose_coverage",
        "mask_j",
        "mask_f",
    }
    assert row["track_delta_avg"] == 1.0


def test_errors_show(egophys_json, perception, bag):
    moved = np.eye(4)
    moved[:3, 3] = 0.003, 0, 0.004
    seen = observations(0)
    perception(
        [
            replace(
                each,
                view=replace(each.view, world_from_camera=moved @ each.view.world_from_camera),
                points=each.points + moved[:3, 3],
                masks=replace(each.masks, object=np.roll(each.masks.object, 25, axis=1)),
            )
            for each in seen
        ]
    )
    row = row_of(egophys_json, bag)
    # A shift along the sheet that is there from the start is another choice of points, except at the rim.
    assert 4 - 1e-3 < row["mean_mm"] < 4.3
    assert row["pose_mm"] == pytest.approx(5)
    assert row["pose_deg"] < 0.001
    width = np.mean([np.count_nonzero(each.masks.object.any(axis=0)) for each in seen])
    assert row["mask_j"] == pytest.approx((width - 25) / (width + 25), abs=0.03)


def test_views_without_a_pose_count_as_not_covered(egophys_json, perception, bag):
    seen = observations(0)
    lost = np.full((4, 4), np.nan)
    perception(
        [
            replace(each, view=replace(each.view, world_from_camera=lost)) if 5 <= index < 11 else each
            for index, each in enumerate(seen)
        ]
    )
    row = row_of(egophys_json, bag)
    assert row["pose_coverage"] == pytest.approx(0.75)
    assert row["pose_mm"] < 0.001


def test_table_names_every_video_and_dashes_what_is_missing(egophys, perception, bag_without_truth, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    perception(observations(0))
    code, out, err = egophys("benchmark", "perception", bag_without_truth)
    assert (code, err) == (0, "")
    (line,) = [line for line in out.splitlines() if line.startswith("│ flat")]
    assert line.split("│")[2:6] == ["     0.0 ", "    0.0 ", "     1.00 ", " 1.000 "]
    assert line.count(" - ") == 4


def test_video_that_perception_refuses_is_a_finding(egophys, egophys_json, perception, bag):
    perception(EpisodeError("the camera's pose is known in no frame"))
    code, out, _ = egophys("benchmark", "perception", bag)
    assert code == 1
    assert "flat: the camera's pose is known in no frame" in out
    code, out, _ = egophys("benchmark", "perception", bag, "--json")
    assert code == 1
    assert '"error": "the camera\'s pose is known in no frame"' in out
    assert '"mean_mm": null' in out


def test_bag_without_measured_points_is_found_before_the_work(egophys, perception, bag, tmp_path):
    perception(AssertionError("perceived"))
    with LogWriter(tmp_path / "video") as log:
        log.add_topic("/ego/image_raw/compressed", "sensor_msgs/msg/CompressedImage")
    for other, part in ((tmp_path / "video", "/object/points"), (tmp_path / "no", "no")):
        code, out, err = egophys("benchmark", "perception", bag, other)
        assert (code, out) == (2, "")
        assert part in err
    assert os.listdir(tmp_path) == ["video"]


def test_help_names_the_topics_that_are_compared(egophys):
    shown = " ".join(egophys("benchmark", "--help")[1].split())
    assert all(topic in shown for topic in ("/object/points", TRUE_POSE_TOPIC, TRUE_MASK_TOPIC))


def test_other_benchmarks_are_not_known(egophys, bag):
    code, _, err = egophys("benchmark", "speed", bag)
    assert code == 2
    assert "perception" in err
