import json
import os
import subprocess
import sys
import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest

from egophys_core.cli import board_arguments
from egophys_core.cli.perceive import OVERLAY_TOPIC
from egophys_core.errors import EpisodeError
from egophys_core.perception.camera.board import Board, TagFamily
from egophys_core.perception.camera.board_sheet import Paper
from egophys_core.perception.camera.image_message import decode_image
from egophys_core.perception.camera.video import IMAGE_TOPIC, INFO_TOPIC
from egophys_core.perception.options import PerceptionOptions
from egophys_core.perception.perceive import Perceived
from egophys_core.recording import LogWriter, list_topics, read_episode, read_records
from tests.perception.observations import START_NS, observations, perceived_from

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
VIDEO, POINTS = EXAMPLES / "towel_lift_video.mcap", EXAMPLES / "towel_lift_video_points.mcap"
SEEN = observations(14, points=60)


@pytest.fixture
def perceive(monkeypatch):
    """Stands for perception: gives the drawn observations; keeps what it was asked for."""
    asked: dict = {}

    def fake(path, *, on_observation, progress, **arguments) -> Perceived:
        asked.update(arguments, path=path)
        for index, each in enumerate(SEEN):
            on_observation(each)
            progress("shape", (index + 1) / len(SEEN))
        if error := asked.get("error"):
            raise error
        return perceived_from(SEEN)

    monkeypatch.setattr("egophys_core.perception.perceive.perceive", fake)
    return asked


def refused(result: tuple[int, str, str], *parts: object) -> None:
    code, out, err = result
    assert (code, out) == (2, ""), err
    assert len(err.strip().splitlines()) == 1
    assert "Traceback" not in err
    for part in parts:
        assert str(part) in err


def test_writes_episode_pictures_and_report(egophys, perceive, tmp_path):
    code, out, err = egophys("perceive", "some.mcap", "--out", tmp_path / "a")
    assert (code, err) == (0, "")
    assert sorted(os.listdir(tmp_path)) == ["a"]
    assert sorted(os.listdir(tmp_path / "a")) == ["contact_sheet.png", "episode", "overlay.mp4", "report.json"]
    for part in ("sheet", "note: the hand never takes hold", str(tmp_path / "a"), "12 % │"):
        assert part in out
    # It ends with the verdict.
    assert out.splitlines()[-3:] == [
        "camera: lay the board in view",
        "hands: touch it",
        "poor; `egophys build` refuses it without --force",
    ]

    episode, expected = read_episode(tmp_path / "a/episode"), perceived_from(SEEN).episode
    assert episode.points == pytest.approx(expected.points, nan_ok=True)
    assert episode.controllers == pytest.approx(expected.controllers)
    assert episode.times == pytest.approx(expected.times)

    video = cv2.VideoCapture(str(tmp_path / "a/overlay.mp4"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == len(SEEN)
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(30, abs=0.01)
    assert cv2.imread(str(tmp_path / "a/contact_sheet.png")).shape[1] > 2000


def test_bag_holds_overlays_and_points_by_time(egophys, perceive, tmp_path):
    assert egophys("perceive", "some.mcap", "--out", tmp_path / "a")[0] == 0
    topics = {topic.name: topic.messages for topic in list_topics(tmp_path / "a/episode")}
    assert topics == {OVERLAY_TOPIC: 14, "/object/points": 14, "/controller/points": 14, "/perception/report": 1}
    records = list(read_records(tmp_path / "a/episode"))
    times = [record.log_time_ns for record in records]
    assert times == sorted(times)
    assert times[0] == START_NS
    overlay = next(record for record in records if record.topic == OVERLAY_TOPIC)
    image = decode_image(overlay.type, overlay.cdr, source="overlay")
    assert image.shape == (518, 1036, 3)
    # The left half is the view, tinted where the object is.
    elsewhere = ~cv2.dilate(SEEN[0].masks.object.astype(np.uint8), np.ones((9, 9))).astype(bool)
    elsewhere[:40] = False
    assert np.abs(image[:, :518].astype(int) - SEEN[0].view.image)[elsewhere].mean() < 6


def test_report_is_json_with_units_in_its_names(egophys_json, perceive, tmp_path):
    printed = egophys_json("perceive", "some.mcap", "--out", tmp_path / "a", "--spacing", "7")
    written = json.loads((tmp_path / "a/report.json").read_text())
    assert printed == {"out": str(tmp_path / "a"), **written}
    assert written["video"] == "some.mcap"
    assert written["start_stamp_ns"] == START_NS
    assert written["thickness_m"] == pytest.approx(0.008)
    assert written["notes"] == ["the hand never takes hold"]
    assert written["seconds"] == [
        {"start_s": 0.0, "coverage": 0.12, "doubtful": 0.5, "confidence": None, "hands": 1, "touching": 0}
    ]
    assert [(each["name"], each["level"]) for each in written["remarks"]] == [("camera", "doubtful"), ("hands", "bad")]
    assert list(written)[-1] == "verdict"
    assert written["verdict"] == "poor"
    assert written["options"]["spacing"] == 7
    assert written["board"]["tag_side_m"] == 0.06
    assert not any(str(tmp_path) in str(value) for value in written.values())


def test_arguments_reach_perception(egophys, perceive, tmp_path):
    board = ["--board-columns", 3, "--board-rows", 5, "--board-tag-side-mm", 40, "--board-gap-mm", 10]
    board += ["--board-first-id", 20, "--board-family", "25h9", "--board-origin-m", "0.1", "-0.2", "0"]
    topics = ["--image-topic", "/left", "--info-topic", "/left/info"]
    box = ["--object-box", "10", "20", "300", "400", "--kind", "solid"]
    code, _, err = egophys("perceive", "some.mcap", "--out", tmp_path / "a", *board, *topics, *box)
    assert code == 0, err
    assert perceive["board"] == Board(
        columns=3, rows=5, tag_side=0.04, gap=0.01, first_id=20, family=TagFamily("25h9"), origin=(0.1, -0.2, 0.0)
    )
    assert (perceive["image_topic"], perceive["info_topic"]) == ("/left", "/left/info")
    assert perceive["options"] == PerceptionOptions(object_box=(10, 20, 300, 400), kind="solid")


def test_the_object_is_named_by_a_place_or_by_a_word(egophys, perceive, tmp_path):
    assert egophys("perceive", "some.mcap", "--out", tmp_path / "a", "--object", "120 240.5")[0] == 0
    assert perceive["options"] == PerceptionOptions(object_point=(120, 240.5))
    learned = ["--stages", "learned", "--weights", "models"]
    assert egophys("perceive", "some.mcap", "--out", tmp_path / "b", "--object", "a towel", *learned)[0] == 0
    assert perceive["options"] == PerceptionOptions(object_prompt="a towel", stages="learned", weights="models")
    both = ["--object", "120 240", "--object-point", "1", "2"]
    refused(egophys("perceive", "some.mcap", "--out", tmp_path / "c", *both), "give one of them")
    refused(egophys("perceive", "some.mcap", "--out", tmp_path / "c", "--object", "a towel"), "needs learned stages")
    two = egophys("build", "a.mcap", "b.mcap", "--out", tmp_path / "c.twin", "--object", "120 240")
    refused(two, "--object is a place in one video")


def test_defaults_are_those_of_perception(egophys, perceive, tmp_path):
    assert egophys("perceive", "some.mcap", "--out", tmp_path / "a")[0] == 0
    assert perceive["board"] == Board()
    assert perceive["options"] == PerceptionOptions()
    assert (perceive["image_topic"], perceive["info_topic"]) == (IMAGE_TOPIC, INFO_TOPIC)
    assert tuple(str(each) for each in TagFamily) == board_arguments.FAMILIES


def test_papers_of_the_board_command_are_all_there_are(egophys):
    from egophys_core.cli import board

    assert tuple(str(paper) for paper in Paper) == board.PAPERS


def test_opencv_is_loaded_only_where_it_is_used():
    modules = ", ".join(f"egophys_core.cli.{name}" for name in ("perceive", "benchmark", "board"))
    program = f"import sys, {modules}; sys.exit('cv2' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], timeout=60).returncode == 0


def test_empty_folder_is_filled(egophys, perceive, tmp_path):
    (tmp_path / "a").mkdir()
    assert egophys("perceive", "some.mcap", "--out", tmp_path / "a")[0] == 0
    assert (tmp_path / "a/report.json").exists()


def test_what_is_there_is_found_before_the_work_and_stays(egophys, perceive, tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full/mine").write_text("mine")
    (tmp_path / "file").write_text("mine")
    refused(egophys("perceive", "some.mcap", "--out", tmp_path / "full"), "not empty")
    refused(egophys("perceive", "some.mcap", "--out", tmp_path / "file"), "is a file")
    refused(egophys("perceive", "some.mcap", "--out", tmp_path / "nowhere/a"), "does not exist")
    assert perceive == {}
    assert sorted(os.listdir(tmp_path)) == ["file", "full"]
    assert os.listdir(tmp_path / "full") == ["mine"]


@pytest.mark.parametrize(
    ("error", "code"), [(EpisodeError("the camera's pose is known in no frame"), 2), (KeyboardInterrupt(), 130)]
)
def test_failure_leaves_nothing(egophys, perceive, tmp_path, error, code):
    perceive["error"] = error
    (tmp_path / "empty").mkdir()
    for out in (tmp_path / "new", tmp_path / "empty"):
        assert egophys("perceive", "some.mcap", "--out", out)[0] == code
        assert os.listdir(tmp_path) == ["empty"]
        assert os.listdir(tmp_path / "empty") == []


def test_bad_board_and_options_are_refused(egophys, tmp_path):
    def run(*more: object) -> tuple[int, str, str]:
        return egophys("perceive", "some.mcap", "--out", tmp_path / "a", *more)

    refused(run("--board-columns", 1), "at least 2 columns")
    refused(run("--board-tag-side-mm", 0.06), "tag side and gap must be metres")
    refused(run("--board-first-id", 580), "board has tags 580 to 591")
    refused(run("--side", 10), "side must be in 128 .. 2048, got 10")
    assert os.listdir(tmp_path) == []


def test_bags_that_are_none_or_have_no_video(egophys, episode_bag, tmp_path):
    refused(egophys("perceive", tmp_path / "no.mcap", "--out", tmp_path / "a"), "no.mcap")
    refused(egophys("perceive", episode_bag, "--out", tmp_path / "a"), "no images on", "/object/points")
    assert os.listdir(tmp_path) == []


@pytest.fixture(scope="module")
def short_bag(tmp_path_factory) -> Path:
    """Two seconds of the shipped video, every third frame."""
    folder = tmp_path_factory.mktemp("short") / "towel"
    images = 0
    with LogWriter(folder) as log:
        for topic in list_topics(VIDEO):
            log.add_topic(topic.name, topic.type)
        for record in read_records(VIDEO):
            images += record.topic == IMAGE_TOPIC
            if images > 60:
                break
            if record.topic != IMAGE_TOPIC or images % 3 == 1:
                log.write(record.topic, record.cdr, record.log_time_ns)
    return folder


FAST = ["--spacing", "20", "--still-s", "0.5", "--object-points", "100"]


def test_shipped_video_from_end_to_end(egophys, short_bag, tmp_path):
    with warnings.catch_warnings():
        code, _, err = egophys("perceive", short_bag, "--out", tmp_path / "a", *FAST)
    assert code == 0, err
    report = json.loads((tmp_path / "a/report.json").read_text())
    assert (report["frames"], report["posed"], report["kind"]) == (20, 20, "sheet")
    assert report["hand_seen"] >= 5
    assert report["verdict"] != "poor", report["remarks"]
    assert [each["touching"] for each in report["seconds"]] == [0, 1]
    assert min(each["coverage"] for each in report["seconds"]) > 0.7
    found, measured = read_episode(tmp_path / "a/episode"), read_episode(POINTS)
    assert found.frames == 20
    for corner in (np.nanmin, np.nanmax):
        assert corner(found.points[0], axis=0) == pytest.approx(corner(measured.points[0], axis=0), abs=0.012)
