import os

import cv2
import numpy as np
import pytest

from egophys_core.errors import OutputError
from egophys_core.perception.overlay_video import OverlayVideo


def write(path, count: int, *, step_ns: int = 50_000_000, size: tuple[int, int] = (64, 96)) -> None:
    with OverlayVideo(path) as video:
        for index in range(count):
            video.write(10**18 + index * step_ns, np.full((*size, 3), 10 + 5 * index, np.uint8))


@pytest.mark.parametrize("count", [1, 2, 11, 12, 13, 40])
def test_every_picture_is_in_the_file_at_the_rate_of_the_stamps(tmp_path, count):
    write(tmp_path / "a.mp4", count)
    assert os.listdir(tmp_path) == ["a.mp4"]
    video = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(20 if count > 1 else 30, abs=0.01)
    brightness = []
    while (read := video.read())[0]:
        assert read[1].shape == (64, 96, 3)
        brightness.append(read[1].mean())
    assert brightness == pytest.approx([10 + 5 * index for index in range(count)], abs=4.5)


def test_no_pictures_no_file(tmp_path):
    write(tmp_path / "a.mp4", 0)
    assert os.listdir(tmp_path) == []


def test_a_pause_does_not_slow_the_rest(tmp_path):
    with OverlayVideo(tmp_path / "a.mp4") as video:
        for index in range(14):
            video.write(index * 40_000_000 + (index > 5) * 10**10, np.zeros((32, 32, 3), np.uint8))
    assert cv2.VideoCapture(str(tmp_path / "a.mp4")).get(cv2.CAP_PROP_FPS) == pytest.approx(25, abs=0.01)


@pytest.mark.parametrize("written", [1, 20])
def test_failing_block_leaves_nothing(tmp_path, written):
    def fail() -> None:
        with OverlayVideo(tmp_path / "a.mp4") as video:
            for index in range(written):
                video.write(index, np.zeros((32, 32, 3), np.uint8))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert os.listdir(tmp_path) == []


def test_earlier_file_stays_until_the_new_one_is_whole(tmp_path):
    (tmp_path / "a.mp4").write_bytes(b"before")
    with OverlayVideo(tmp_path / "a.mp4") as video:
        for index in range(20):
            video.write(index, np.zeros((32, 32, 3), np.uint8))
        assert (tmp_path / "a.mp4").read_bytes() == b"before"
    assert (tmp_path / "a.mp4").read_bytes() != b"before"


@pytest.mark.parametrize("before", [3, 20])
def test_picture_of_another_size_is_refused(tmp_path, before):
    def mix() -> None:
        with OverlayVideo(tmp_path / "a.mp4") as video:
            for index in range(before):
                video.write(index, np.zeros((32, 32, 3), np.uint8))
            video.write(before, np.zeros((32, 34, 3), np.uint8))

    with pytest.raises(OutputError, match=r"\(34, 32\).*\(32, 32\)"):
        mix()
    assert os.listdir(tmp_path) == []


def test_missing_folder(tmp_path):
    with pytest.raises(OutputError, match="no folder"):
        OverlayVideo(tmp_path / "nowhere" / "a.mp4")


def test_missing_encoder_is_found_at_once(tmp_path, monkeypatch):
    monkeypatch.setattr("egophys_core.perception.overlay_video.CODEC", "zzzz")
    with pytest.raises(OutputError, match="no zzzz encoder"):
        OverlayVideo(tmp_path / "a.mp4")
    assert os.listdir(tmp_path) == []


def test_lost_pictures_are_an_error(tmp_path):
    video = OverlayVideo(tmp_path / "a.mp4")
    for index in range(20):
        video.write(index, np.zeros((32, 32, 3), np.uint8))
    video.pictures += 1  # as if the disk had swallowed one
    with pytest.raises(OutputError, match="20 of 21"):
        video.close()
    assert os.listdir(tmp_path) == []
