from pathlib import Path

import cv2
import numpy as np
import pytest

from egophys_core.errors import RecordingError
from egophys_core.perception.camera.frame_source import open_frames
from tests.perception.camera.films import write_film

WIDTH, HEIGHT = 96, 64


def images(count: int) -> list[np.ndarray]:
    """Grey levels that tell the frame, and a white upper left corner."""
    made = [np.full((HEIGHT, WIDTH, 3), 20 + 12 * index, np.uint8) for index in range(count)]
    for image in made:
        image[:16, :16] = 255
    return made


def seconds(source) -> np.ndarray:
    stamps = np.array([frame.stamp_ns for frame in source.frames()])
    return (stamps - stamps[0]) * 1e-9


def test_times_of_a_film_are_its_own_also_where_its_rate_varies(tmp_path):
    steady = open_frames(write_film(tmp_path / "steady.mp4", images(5), rate=25.0))
    assert seconds(steady) == pytest.approx(np.arange(5) / 25, abs=1e-6)
    lasts = [1, 3, 1, 2, 1, 1]
    varied = open_frames(write_film(tmp_path / "varied.mp4", images(6), rate=25.0, lasts=lasts))
    assert seconds(varied) == pytest.approx(np.cumsum([0, *lasts[:-1]]) / 25, abs=1e-6)
    assert (varied.width, varied.height, varied.rotation_deg) == (WIDTH, HEIGHT, 0)
    first = next(varied.frames()).stamp_ns
    late = list(varied.frames(lambda stamp_ns: stamp_ns - first > 0.15e9))
    assert [round(float(frame.image[40, 60, 0])) for frame in late] == pytest.approx([44, 56, 68, 80], abs=5)


@pytest.mark.parametrize(("rotation", "corner"), [(90, (1, 0)), (180, (1, 1)), (270, (0, 1))])
def test_films_are_turned_as_their_flag_says(tmp_path, rotation, corner):
    source = open_frames(write_film(tmp_path / "phone.mp4", images(2), rotation_deg=rotation))
    image = next(source.frames()).image
    assert source.rotation_deg == rotation
    assert (source.height, source.width) == image.shape[:2] == ((HEIGHT, WIDTH) if rotation == 180 else (WIDTH, HEIGHT))
    x, y = corner[0] * (source.width - 1), corner[1] * (source.height - 1)
    assert image[y, x].min() > 200
    assert image[source.height - 1 - y, source.width - 1 - x].max() < 60


@pytest.fixture
def folder(tmp_path) -> Path:
    (tmp_path / "pictures").mkdir()
    for index, image in enumerate(images(11)):
        cv2.imwrite(str(tmp_path / f"pictures/view_{index}.png"), image)
    (tmp_path / "pictures/notes.txt").write_text("no picture")
    return tmp_path / "pictures"


def test_pictures_of_a_folder_come_in_the_order_of_their_numbers(folder, tmp_path):
    source = open_frames(folder, rate_hz=20.0)
    assert [int(frame.image[40, 60, 0]) for frame in source.frames()] == [20 + 12 * index for index in range(11)]
    assert seconds(source) == pytest.approx(np.arange(11) / 20)
    times = np.cumsum(np.arange(1, 12)) * 0.01 + 700.0
    (tmp_path / "times.txt").write_text("\n".join(f"{each:.4f}" for each in times))
    assert seconds(open_frames(folder, times=tmp_path / "times.txt")) == pytest.approx(times - times[0])


def test_what_is_no_video_is_told(folder, tmp_path, capfd):
    def refused(words: str, path: Path, **arguments) -> None:
        with pytest.raises(RecordingError, match=words):
            list(open_frames(path, **arguments).frames())

    times = tmp_path / "times.txt"
    refused("no such file", tmp_path / "nothing.mp4")
    refused("11 pictures have no times", folder)
    refused("and not both", folder, rate_hz=20.0, times=times)
    refused("rate must be", folder, rate_hz=0.0)
    times.write_text("1 2 3")
    refused("has 3 times for 11 pictures", folder, times=times)
    times.write_text(" ".join(str(each) for each in range(10, -1, -1)))
    refused("must increase", folder, times=times)
    for unit, span in ((1e9, "1e[+]10"), (1e-12, "1e-11")):
        times.write_text(" ".join(f"{unit * each:.15f}" for each in range(11)))
        refused(f"its 11 times span {span} s, .*; give seconds", folder, times=times)
    times.write_text("soon later")
    refused("no list of times", folder, times=times)
    (tmp_path / "empty").mkdir()
    refused("neither a bag nor a folder", tmp_path / "empty", rate_hz=1.0)
    (tmp_path / "empty/RIGHT.MCAP").write_bytes(b"no bag")
    for bag in ("empty", "empty/RIGHT.MCAP"):
        refused("RIGHT.MCAP: not a bag", tmp_path / bag)
    film = write_film(tmp_path / "film.mp4", images(3))
    refused("has times of its own", film, rate_hz=30.0)
    (tmp_path / "cut.mp4").write_bytes(film.read_bytes()[:500])
    refused("no video that OpenCV reads", tmp_path / "cut.mp4")
    assert capfd.readouterr().err == ""
    cv2.imwrite(str(folder / "view_11.png"), np.zeros((8, 8, 3), np.uint8))
    refused("is 8 x 8, the first is 96 x 64", folder, rate_hz=20.0)
    (folder / "view_11.png").write_bytes(b"x")
    refused("is no picture", folder, rate_hz=20.0)
