import os
from pathlib import Path

import numpy as np
import pytest

from egophys_core.perception.camera.intrinsics_file import Intrinsics, intrinsics_text
from egophys_core.perception.camera.lens import Camera
from egophys_core.perception.camera.video import open_video
from egophys_core.recording import list_topics
from tests.perception.camera.films import write_film

LENS = {"model": "rational_polynomial", "coefficients": [0.3, 0.1, 0.004, -0.003, 0.02, 0.5, 0.1, 0.01]}
MATRIX = np.array([[210.0, 0, 98.0], [0, 212.0, 61.0], [0, 0, 1]])


@pytest.fixture
def intrinsics(tmp_path) -> Path:
    path = tmp_path / "cam.yaml"
    path.write_text(intrinsics_text(Intrinsics(camera=Camera(width=192, height=128, matrix=MATRIX, **LENS))))
    return path


@pytest.fixture
def film(tmp_path) -> Path:
    images = [np.full((128, 192, 3), 40 + 20 * index, np.uint8) for index in range(6)]
    return write_film(tmp_path / "film.mp4", images, rate=20.0, lasts=[1, 1, 3, 1, 1, 1])


def test_perception_reads_what_is_imported(egophys, egophys_json, intrinsics, film, tmp_path):
    bag = tmp_path / "bag"
    code, out, err = egophys("import", film, "--intrinsics", intrinsics, "--out", bag)
    assert (code, err) == (0, "")
    assert "6 images of 192 x 128, 0.4 s" in out
    assert sorted(os.listdir(bag)) == ["bag_0.mcap", "metadata.yaml"]
    assert {(each.name, each.messages) for each in list_topics(bag)} == {
        ("/ego/image_raw/compressed", 6),
        ("/ego/camera_info", 6),
    }
    with pytest.warns(UserWarning, match="about 2 frames are missing in 1 gaps"):
        video = open_video(bag)
    assert video.camera.matrix == pytest.approx(MATRIX)
    assert str(video.camera.model) == "rational_polynomial"
    assert video.camera.coefficients == pytest.approx(LENS["coefficients"])
    assert np.diff(video.stamps_ns) * 1e-9 == pytest.approx(np.array([1, 1, 3, 1, 1]) / 20, abs=1e-6)
    levels = [frame.image.mean() for frame in video.frames()]
    assert levels == pytest.approx(40 + 20 * np.arange(6), abs=6)
    assert egophys_json("import", film, "--intrinsics", intrinsics, "--out", tmp_path / "other")["frames"] == 6


def test_nothing_half_written_stays(egophys, intrinsics, film, tmp_path, monkeypatch):
    def refused(*arguments: object, words: str) -> None:
        code, out, err = egophys("import", *arguments, "--out", tmp_path / "bags/bag")
        assert (code, out) == (2, "")
        assert words in err
        assert len(err.strip().splitlines()) == 1

    refused(film, words="give --intrinsics")
    refused(film, "--intrinsics", intrinsics, "--camera", "camera-rgb", words="--camera is for .vrs recordings")
    refused(tmp_path / "a.vrs", "--intrinsics", intrinsics, words="--intrinsics is for films and pictures")
    wide = write_film(tmp_path / "wide.mp4", [np.zeros((96, 192, 3), np.uint8)] * 2)
    refused(wide, "--intrinsics", intrinsics, words="another ratio of width to height")
    with monkeypatch.context() as patched:

        def fails(*arguments: object, **named: object) -> None:
            raise KeyboardInterrupt

        patched.setattr("egophys_core.perception.camera.video_import.jpeg_message", fails)
        assert egophys("import", film, "--intrinsics", intrinsics, "--out", tmp_path / "bags/bag")[0] == 130
    assert not list(tmp_path.glob("bags/*"))
    assert not list(tmp_path.glob("bags/.*"))
    assert egophys("import", film, "--intrinsics", intrinsics, "--out", tmp_path / "bags/bag")[0] == 0
    refused(film, "--intrinsics", intrinsics, words="exists already")
    code, _, err = egophys("import", tmp_path / "bags/bag", "--intrinsics", intrinsics, "--out", tmp_path / "again")
    assert code == 2
    assert "is a bag with its own calibration" in err
