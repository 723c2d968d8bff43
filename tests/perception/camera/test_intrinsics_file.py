import numpy as np
import pytest

from egophys_core.errors import EgophysError, EpisodeError
from egophys_core.perception.camera.frame_source import open_frames
from egophys_core.perception.camera.intrinsics_file import (
    Intrinsics,
    camera_of,
    intrinsics_text,
    read_intrinsics,
    turned,
)
from egophys_core.perception.camera.lens import Camera
from tests.perception.camera.films import write_film

MATRIX = np.array([[210.0, 0, 98.0], [0, 212.0, 61.0], [0, 0, 1]])
LENSES = {
    "plumb_bob": [-0.2, 0.06, 0.004, -0.003, 0.01],
    "rational_polynomial": [0.3, 0.1, 0.004, -0.003, 0.02, 0.5, 0.1, 0.01],
    "equidistant": [-0.02, 0.01, -0.003, 0.001],
}
POINTS = np.random.default_rng(3).uniform([-0.4, -0.25, 1.0], [0.4, 0.25, 1.2], (40, 3))

ROS = """\
image_width: 192
image_height: 128
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [210.000000, 0.000000, 98.000000, 0.000000, 212.000000, 61.000000, 0.000000, 0.000000, 1.000000]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.200000, 0.060000, 0.004000, -0.003000, 0.010000]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
"""
"""As ROS's camera_calibration writes it."""


def camera(model: str = "plumb_bob") -> Camera:
    return Camera(width=192, height=128, matrix=MATRIX, model=model, coefficients=LENSES[model])


def film(path, width: int, height: int, rotation_deg: int = 0):
    return open_frames(write_film(path, [np.zeros((height, width, 3), np.uint8)] * 2, rotation_deg=rotation_deg))


def test_files_of_ros_are_read_and_what_is_written_reads_the_same(tmp_path):
    path = tmp_path / "cam.yaml"
    path.write_text(ROS)
    assert read_intrinsics(path).camera.project(POINTS) == pytest.approx(camera().project(POINTS), abs=1e-9)
    path.write_text(ROS.replace("plumb_bob", "fisheye").replace(", 0.010000", "").replace("cols: 5", "cols: 4"))
    assert str(read_intrinsics(path).camera.model) == "equidistant"
    for model in LENSES:
        text = intrinsics_text(Intrinsics(camera=camera(model), rotation_deg=90), comment="two\nlines")
        path.write_text(text)
        read = read_intrinsics(path)
        assert text.startswith("# two\n# lines\nimage_width: 192\n")
        assert read.rotation_deg == 90
        assert read.camera.project(POINTS) == pytest.approx(camera(model).project(POINTS), abs=1e-6)


@pytest.mark.parametrize("model", LENSES)
def test_a_turned_camera_sees_what_the_turned_image_shows(model):
    """A quarter turn counter-clockwise brings the pixel (x, y) to (y, width - 1 - x), and so rays (X, Y) to (Y, -X)."""
    pixels, points, seen = camera(model).project(POINTS), POINTS, camera(model)
    for turns in range(1, 5):
        pixels = np.column_stack([pixels[:, 1], seen.width - 1 - pixels[:, 0]])
        points = np.column_stack([points[:, 1], -points[:, 0], points[:, 2]])
        seen = turned(camera(model), turns)
        assert seen.project(points) == pytest.approx(pixels, abs=1e-9)
    assert (seen.width, seen.height) == (192, 128)


def test_a_calibration_is_scaled_to_images_of_another_size(tmp_path):
    given = Intrinsics(camera=camera())
    same, notes = camera_of(film(tmp_path / "same.mp4", 192, 128), given)
    assert (same, notes) == (given.camera, ())
    large, notes = camera_of(film(tmp_path / "large.mp4", 384, 256), given)
    # The centre of pixel 0 of the small image lies between pixels 0 and 1 of the large one.
    assert large.project(POINTS) == pytest.approx(2 * camera().project(POINTS) + 0.5, abs=1e-9)
    assert "192 x 128 was scaled to 384 x 256" in notes[0]


def test_a_calibration_of_images_of_another_shape_is_refused(tmp_path):
    given = Intrinsics(camera=camera(), source="cam.yaml")
    words = "its images are 192 x 144, cam.yaml is of 192 x 128, another ratio of width to height"
    with pytest.raises(EpisodeError, match=words):
        camera_of(film(tmp_path / "cropped.mp4", 192, 144), given)
    with pytest.raises(EpisodeError, match="its images are 128 x 192"):
        camera_of(film(tmp_path / "portrait.mp4", 128, 192), given)


@pytest.mark.parametrize(("calibrated", "filmed"), [(0, 90), (0, 180), (90, 0), (270, 90), (None, 90)])
def test_a_phone_may_be_held_otherwise_than_when_it_was_calibrated(tmp_path, calibrated, filmed):
    sensor = camera()
    shown = turned(sensor, -(calibrated or 0) // 90)
    seen, notes = camera_of(
        film(tmp_path / "phone.mp4", 192, 128, filmed), Intrinsics(camera=shown, rotation_deg=calibrated)
    )
    expected = turned(sensor, -filmed // 90)
    assert (seen.width, seen.height) == (expected.width, expected.height)
    assert seen.matrix == pytest.approx(expected.matrix)
    assert seen.coefficients == pytest.approx(expected.coefficients)
    assert "turned by" in notes[0]


def test_what_is_no_calibration_is_told(tmp_path):
    path = tmp_path / "cam.yaml"

    def refused(words: str, text: str | None) -> None:
        if text is not None:
            path.write_text(text)
        with pytest.raises(EgophysError, match=words) as caught:
            read_intrinsics(path)
        assert str(path) in str(caught.value)

    refused("cannot read intrinsics", None)
    refused("cannot read intrinsics", "a: [")
    refused("camera_matrix, distortion_coefficients missing", "image_width: 3\nimage_height: 4")
    refused("not the numbers", ROS.replace("210.000000", "wide"))
    refused("not the numbers", ROS.replace("210.000000, ", ""))
    refused("must be one of plumb_bob", ROS.replace("plumb_bob", "kannala"))
    refused("calibrate the camera", ROS.replace("210.000000", "0"))
    refused("no camera calibration of ROS", "- 1\n- 2")
    refused("image_width must be a whole number, got inf", ROS.replace("192", ".inf"))
    refused("rotation_deg must be a whole number, got inf", ROS + "rotation_deg: .inf")
    refused("rotation_deg must be a multiple of 90, got 45", ROS + "rotation_deg: 45")
    refused("camera_matrix has no data", ROS.replace("data: [210", "values: [210"))


@pytest.mark.parametrize(
    ("given", "absurd", "words"),
    [
        ("210.000000", "1.0e-9", "focal length fx = 1e-09 pixels, of 192 x 128 it is 9.6 .. 19200"),
        ("212.000000", "1.0e+300", r"focal length fy = 1e\+300 pixels"),
        ("98.000000", "8000", "principal point cx = 8000 pixels is more than a picture beside"),
        ("-0.200000, 0.060000, 0.004000, -0.003000, 0.010000", "1.0e+9, 1.0e+9, 1.0e+9, 1.0e+9, 1.0e+9", "distortion"),
        ("0.010000", "1.0e+5", "distortion plumb_bob .* stretches the picture"),
    ],
)
def test_what_no_camera_has_is_told(tmp_path, given, absurd, words):
    path = tmp_path / "cam.yaml"
    path.write_text(ROS.replace(given, absurd))
    with pytest.raises(EpisodeError, match=rf"cam\.yaml: .*{words}"):
        read_intrinsics(path)
