"""Cameras from CameraInfo, and views whose intrinsics say where things really are."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.perception.camera.lens import (
    Camera,
    DistortionModel,
    FullView,
    SquareView,
    camera_from_message,
    turn_rotation,
    upright_turns,
)

PLUMB_BOB = np.array([-0.28, 0.09, 0.0007, -0.0004, -0.012])
RATIONAL = np.array([0.6, -0.3, 0.0002, -0.0001, 0.05, 0.9, -0.2, 0.01])
FISHEYE = np.array([-0.02, 0.004, -0.002, 0.0003])
LENSES = {
    "pinhole": (DistortionModel.PLUMB_BOB, np.zeros(5)),
    "plumb_bob": (DistortionModel.PLUMB_BOB, PLUMB_BOB),
    "rational": (DistortionModel.RATIONAL_POLYNOMIAL, RATIONAL),
    "fisheye": (DistortionModel.EQUIDISTANT, FISHEYE),
}


def make_camera(lens: str = "pinhole", width: int = 640, height: int = 480, focal: float = 420.0) -> Camera:
    model, coefficients = LENSES[lens]
    matrix = np.array([[focal, 0, width / 2 + 4.3], [0, 1.01 * focal, height / 2 - 7.1], [0, 0, 1]])
    return Camera(width=width, height=height, matrix=matrix, model=model, coefficients=coefficients)


def message(**changes: object) -> SimpleNamespace:
    roi = SimpleNamespace(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    content = {
        "width": 640,
        "height": 480,
        "distortion_model": "plumb_bob",
        "d": PLUMB_BOB,
        "k": np.array([420, 0, 320, 0, 420, 240, 0, 0, 1.0]),
        "binning_x": 0,
        "binning_y": 0,
        "roi": roi,
    }
    return SimpleNamespace(**(content | changes))


def spot_image(camera: Camera, points: np.ndarray) -> np.ndarray:
    """A Gaussian spot wherever the camera sees a point [N, 3]."""
    y, x = np.mgrid[: camera.height, : camera.width]
    image = np.zeros((camera.height, camera.width))
    for u, v in camera.project(points):
        image += 250 * np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * 2.5**2))
    return np.clip(image, 0, 255).astype(np.uint8)


def centroid_near(image: np.ndarray, place: np.ndarray) -> np.ndarray:
    column, row = np.round(place).astype(int)
    patch = image[row - 9 : row + 10, column - 9 : column + 10].astype(float)
    y, x = np.mgrid[row - 9 : row + 10, column - 9 : column + 10]
    return np.array([(patch * x).sum(), (patch * y).sum()]) / patch.sum()


def test_projection_is_that_of_opencv():
    points = np.array([[0.2, -0.1, 1.0], [-0.4, 0.3, 1.5], [0, 0, 2.0], [0.01, 0.5, 0.9]])
    for lens in ("plumb_bob", "rational"):
        camera = make_camera(lens)
        expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, camera.coefficients)
        assert camera.project(points) == pytest.approx(expected[:, 0], abs=1e-9)
    camera = make_camera("fisheye")
    expected, _ = cv2.fisheye.projectPoints(
        points[:, None], np.zeros(3), np.zeros(3), camera.matrix, camera.coefficients
    )
    assert camera.project(points) == pytest.approx(expected[:, 0], abs=1e-6)


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
@pytest.mark.parametrize("lens", sorted(LENSES))
def test_intrinsics_of_the_square_view_say_where_points_are(lens, turns):
    camera = make_camera(lens)
    points = np.array([[0.1, 0.05, 1.0], [-0.25, -0.2, 1.0], [0.22, -0.3, 1.1], [-0.3, 0.3, 1.2], [0, 0, 1.0]])
    view = SquareView(camera, turns=turns, side=518)
    image = view.image(spot_image(camera, points))
    assert image.shape == (518, 518)
    turned = points @ turn_rotation(turns)[:3, :3]
    places = turned @ view.matrix.T
    for place in places[:, :2] / places[:, 2:]:
        assert centroid_near(image, place) == pytest.approx(place, abs=0.06)


def test_square_view_of_a_pinhole_image_is_the_turned_crop():
    camera = make_camera(width=640, height=518)
    image = np.random.default_rng(0).integers(0, 256, (518, 640, 3), dtype=np.uint8)
    for turns in range(4):
        view = SquareView(camera, turns=turns, side=518)
        assert np.array_equal(view.image(image), np.rot90(image[:, 61:579], turns))


def test_half_pixel_is_right_when_the_view_shrinks():
    # A 1036 square halves: pixel (0, 0) of the view covers pixels 0 and 1, so its centre is at 0.5.
    camera = make_camera(width=1036, height=1036)
    view = SquareView(camera, side=518)
    assert view.matrix[0, 0] == pytest.approx(camera.matrix[0, 0] / 2)
    assert view.matrix[0, 2] == pytest.approx((camera.matrix[0, 2] - 0.5) / 2)


def test_poses_map_exactly_between_camera_and_view():
    world_from_camera = np.eye(4)
    world_from_camera[:3, 3] = [0.1, -0.2, 0.5]
    point = np.array([0.3, -0.1, 1.4, 1.0])
    camera = make_camera(width=600, height=600)
    raw = camera.project((np.linalg.inv(world_from_camera) @ point)[None, :3])[0]
    for turns in range(4):
        view = SquareView(camera, turns=turns, side=600)
        pose = view.from_raw_pose(world_from_camera)
        assert np.array_equal(view.to_raw_pose(pose), world_from_camera)
        place = view.matrix @ (np.linalg.inv(pose) @ point)[:3]
        x, y = raw
        expected = [(x, y), (y, 599 - x), (599 - x, 599 - y), (599 - y, x)][turns]
        assert place[:2] / place[2] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_upright_turns_bring_world_up_to_the_top(turns):
    # A camera at the table looking along world y and 30 degrees down, rolled by quarter turns and a bit.
    down, roll = np.radians(30), np.radians(90 * turns + 20)
    forward = np.array([0, np.cos(down), -np.sin(down)])
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([[1, 0, 0], np.cross(forward, [1, 0, 0]), forward])
    pose[:3, :3] = pose[:3, :3] @ cv2.Rodrigues(np.array([0, 0, roll]))[0]
    found = upright_turns(pose)
    up = (pose @ turn_rotation(found))[2, :2]
    assert -up[1] > abs(up[0])
    assert upright_turns(pose @ turn_rotation(found)) == 0


def test_camera_that_looks_straight_down_is_not_turned():
    assert upright_turns(np.diag([1.0, -1.0, -1.0, 1.0])) == 0


def test_strong_lens_gives_a_view_without_black_rim():
    camera = make_camera("fisheye", width=1408, height=1408, focal=610)
    view = SquareView(camera, side=518)
    assert (view.image(np.full((1408, 1408, 3), 200, np.uint8)) == 200).all()
    barrel = make_camera("plumb_bob")
    assert (SquareView(barrel).image(np.full((480, 640, 3), 200, np.uint8)) == 200).all()


def test_shrinking_does_not_alias():
    # Lines of one pixel, far finer than the view: what is left must be grey, not stripes of its own.
    camera = make_camera(width=1400, height=1400)
    image = np.zeros((1400, 1400), np.uint8)
    image[:, ::2] = 255
    assert SquareView(camera).image(image)[20:-20, 20:-20].std() < 3


def test_full_view_keeps_intrinsics_and_undistorted_images_as_they_are():
    camera = make_camera()
    image = np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    view = FullView(camera)
    assert np.array_equal(view.image(image), image)
    assert np.array_equal(view.matrix, camera.matrix)
    barrel = make_camera("plumb_bob")
    point = np.array([[0.3, -0.2, 1.0]])
    place = (barrel.matrix @ point[0])[:2]
    assert centroid_near(FullView(barrel).image(spot_image(barrel, point)), place) == pytest.approx(place, abs=0.06)


def test_image_of_another_size_names_both():
    with pytest.raises(EpisodeError, match=r"640 x 480.*1280 x 960"):
        SquareView(make_camera()).image(np.zeros((960, 1280, 3), np.uint8))


def test_camera_info_is_read():
    camera = camera_from_message(message(), source="bag")
    assert (camera.width, camera.height, camera.matrix[0, 2]) == (640, 480, 320)
    assert camera.coefficients == pytest.approx(PLUMB_BOB)
    without = camera_from_message(message(distortion_model="", d=np.zeros(0)), source="bag")
    assert without.is_pinhole


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"distortion_model": "double_sphere"}, "double_sphere"),
        ({"k": np.zeros(9)}, "uncalibrated"),
        ({"k": np.array([420, 0, 320, 0, -420, 240, 0, 0, 1.0])}, "fx, fy > 0"),
        ({"k": np.array([420, 0, 320, 1, 420, 240, 0, 0, 1.0])}, "fx, 0, cx"),
        ({"k": np.array([420, 0, np.nan, 0, 420, 240, 0, 0, 1.0])}, "finite"),
        ({"d": np.array([np.inf, 0, 0, 0, 0])}, "finite"),
        ({"d": np.zeros(3)}, "4 or 5 coefficients, got 3"),
        ({"distortion_model": "equidistant", "d": np.zeros(0)}, "4 coefficients, got 0"),
        ({"width": 0}, "0 x 480"),
        ({"binning_x": 2}, "binned"),
    ],
)
def test_bad_camera_info_says_what(changes, says):
    with pytest.raises(EpisodeError, match=says):
        camera_from_message(message(**changes), source="bag /ego/camera_info")


def test_distortion_that_folds_the_image_is_refused():
    camera = Camera(
        width=640,
        height=480,
        matrix=np.array([[420, 0, 320], [0, 420, 240], [0, 0, 1.0]]),
        coefficients=np.array([-40.0, 0, 0, 0, 0]),
    )
    with pytest.raises(EpisodeError, match="calibrate again"):
        SquareView(camera)
