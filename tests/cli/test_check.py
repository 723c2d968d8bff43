from pathlib import Path

import cv2
import numpy as np
import pytest

from egophys_core.perception.camera.lens import SquareView
from egophys_core.perception.camera.video import open_video
from tests.perception.camera.films import write_film

VIDEO = Path(__file__).resolve().parents[2] / "examples/towel_lift_video.mcap"


def test_a_good_video_is_called_good_and_its_picture_shows_the_first_view(egophys_json, tmp_path):
    content = egophys_json("check", VIDEO, "--out", tmp_path / "seen.png", "--object", "269 285")
    assert content["verdict"] == "good"
    found = {each["name"]: each for each in content["remarks"]}
    assert {each["level"] for each in found.values()} == {"ok"}
    assert {"tags", "sharpness", "exposure", "object", "texture", "rest", "parallax", "table", "hands"} <= set(found)
    assert "one hand" in found["hands"]["text"]
    picture = cv2.imread(str(tmp_path / "seen.png"))
    video = open_video(VIDEO)
    view = SquareView(video.camera).image(next(video.frames()).image)
    # The pixels of the picture are those of the view, apart from what is drawn on it: what --object is given in.
    same = np.abs(picture[:518, :518].astype(int) - view).max(axis=2) < 3
    assert same.mean() > 0.95
    assert same[350:500, 350:500].all()


def test_a_poor_film_is_called_poor_and_it_is_said_what_to_do(egophys, tmp_path):
    dark = write_film(tmp_path / "dark.mp4", [np.full((240, 320, 3), 20, np.uint8)] * 12)
    code, out, err = egophys("check", dark, "--out", tmp_path / "seen.jpg")
    assert (code, err) == (1, "")
    for words in ("film 4 to 10 s", "lay the printed board", "more light", "no intrinsics are given", "poor; look at"):
        assert words in out
    assert cv2.imread(str(tmp_path / "seen.jpg")).shape[1] == 1640


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--object", "towel"), "must be two numbers, x and y in pixels, got 'towel'"),
        (("--out", "seen.txt"), "must end in .jpg or .png"),
        (("--out", "nowhere/seen.png"), "nowhere does not exist; create it first"),
        (("--rate", "30"), "has times of its own"),
    ],
)
def test_what_cannot_be_checked_is_told(egophys, arguments, words):
    code, out, err = egophys("check", VIDEO, *arguments)
    assert (code, out) == (2, "")
    assert words in err
    assert len(err.strip().splitlines()) == 1
