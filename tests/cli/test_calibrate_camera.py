import os

import cv2
import pytest

from egophys_core.perception.camera.intrinsics_file import read_intrinsics
from tests.perception.camera.films import write_film
from tests.perception.camera.lens_scene import board_film, board_poses, camera_of

CAMERA = camera_of("plumb_bob", [-0.2, 0.05, 0.001, -0.0015, 0.0], 390, (480, 360))


def test_a_film_of_the_board_gives_intrinsics_that_import_takes(egophys, egophys_json, tmp_path):
    images = list(board_film(CAMERA, board_poses(16, tilt=40, distance=0.5), blur=0.5))
    film = write_film(tmp_path / "board.mp4", images)
    content = egophys_json("calibrate-camera", film, "--out", tmp_path / "cam.yaml")
    assert (content["verdict"], content["model"]) == ("good", "plumb_bob")
    read = read_intrinsics(tmp_path / "cam.yaml")
    assert read.camera.matrix[0, 0] == pytest.approx(CAMERA.matrix[0, 0], rel=2e-3)
    assert content["camera_matrix"][0][0] == pytest.approx(read.camera.matrix[0, 0])
    assert read.rotation_deg == 0
    code, _, err = egophys("import", film, "--intrinsics", tmp_path / "cam.yaml", "--out", tmp_path / "bag")
    assert (code, err) == (0, "")


def test_a_poor_calibration_is_not_written_unless_asked(egophys, tmp_path):
    folder = tmp_path / "pictures"
    folder.mkdir()
    for index, image in enumerate(board_film(CAMERA, board_poses(9, tilt=2, distance=0.7))):
        cv2.imwrite(str(folder / f"{index}.png"), image)
    arguments = [
        "calibrate-camera",
        folder,
        "--rate",
        "2",
        "--model",
        "rational_polynomial",
        "--out",
        tmp_path / "cam.yaml",
    ]
    code, out, err = egophys(*arguments)
    assert (code, err) == (1, "")
    assert "tilt the camera" in out
    assert "poor: not written" in out
    assert sorted(os.listdir(tmp_path)) == ["pictures"]
    assert egophys(*arguments, "--force")[0] == 1
    assert (tmp_path / "cam.yaml").read_text().startswith("# poor: ")
    read = read_intrinsics(tmp_path / "cam.yaml").camera
    assert (str(read.model), len(read.coefficients)) == ("rational_polynomial", 8)


def test_a_film_without_the_board_is_told(egophys, tmp_path):
    film = write_film(tmp_path / "dark.mp4", [next(board_film(CAMERA, board_poses(1, tilt=0, distance=9.0)))] * 3)
    code, out, err = egophys("calibrate-camera", film, "--out", tmp_path / "cam.yaml")
    assert (code, out) == (2, "")
    assert "the board is seen sharply in 0 different views" in err
    assert not (tmp_path / "cam.yaml").exists()
