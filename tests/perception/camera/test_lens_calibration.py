import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.calibration_verdict import judge_calibration
from egophys_core.perception.camera.lens import Camera
from egophys_core.perception.camera.lens_calibration import calibrate, choose_views
from egophys_core.perception.camera.tag_edges import SeenTags, TagEdgeFinder
from egophys_core.perception.remarks import Level
from tests.perception.camera.lens_scene import board_film, board_poses, camera_of

SIZE = (480, 360)
LENSES = {
    "plumb_bob": (camera_of("plumb_bob", [-0.25, 0.08, 0.001, -0.0015, 0.0], 390, SIZE), 0.5),
    "equidistant": (camera_of("equidistant", [0.02, -0.01, 0.003, -0.001], 225, SIZE), 0.25),
}


def seen_in(camera: Camera, *, tilt: float, distance: float, count: int = 16) -> list[SeenTags]:
    finder = TagEdgeFinder(Board())
    film = board_film(camera, board_poses(count, tilt=tilt, distance=distance), blur=0.5)
    return [finder.find(image, index) for index, image in enumerate(film)]


def largest_error(found: Camera, true: Camera) -> float:
    """Pixels, of the places of rays over the image but for its outermost parts."""
    x, y = np.meshgrid(np.linspace(-0.8, 0.8, 9), np.linspace(-0.8, 0.8, 9))
    edge = np.array([true.width, true.height]) / 2 / true.matrix[[0, 1], [0, 1]]
    rays = np.column_stack([(x * edge[0]).ravel(), (y * edge[1]).ravel(), np.ones(x.size)])
    return float(np.linalg.norm(found.project(rays) - true.project(rays), axis=1).max())


@pytest.mark.parametrize("model", LENSES)
def test_lens_and_its_model_are_found(model):
    true, distance = LENSES[model]
    views = choose_views(seen_in(true, tilt=40, distance=distance), SIZE, Board())
    calibration = calibrate(views, SIZE, Board())
    found = calibration.camera
    assert str(found.model) == model
    # A camera a metre away misses by a millimetre at 0.1 % of the focal length.
    assert found.matrix[0, 0] == pytest.approx(true.matrix[0, 0], rel=1e-3)
    assert largest_error(found, true) < 0.3
    assert calibration.held_out_px < 0.08
    other = "equidistant" if model == "plumb_bob" else "plumb_bob"
    assert calibration.tried[other] > 1.5 * calibration.held_out_px
    assert calibration.focal_deviation < 2e-3
    verdict, remarks = judge_calibration(calibration)
    assert verdict == "good", remarks


def test_views_without_tilt_are_poor_and_it_is_said_what_to_film():
    true, _ = LENSES["plumb_bob"]
    seen = seen_in(true, tilt=2, distance=0.7)
    calibration = calibrate(choose_views(seen, SIZE, Board()), SIZE, Board())
    verdict, remarks = judge_calibration(calibration)
    assert verdict == "poor"
    tilt = next(each for each in remarks if each.name == "tilt")
    assert tilt.level == Level.BAD
    assert "tilt the camera" in tilt.advice
    assert calibration.focal_deviation > 3e-3


def test_corners_are_exact_where_lines_are_straight_and_blurred_views_are_left_out():
    straight = camera_of("plumb_bob", [0.0] * 5, 390, SIZE)
    poses = list(board_poses(8, tilt=35, distance=0.5))
    finder = TagEdgeFinder(Board())
    sharp = [finder.find(image, index) for index, image in enumerate(board_film(straight, iter(poses)))]
    for view, pose in zip(sharp, poses, strict=True):
        flat = Board().tag_corners[view.tags][:, None] + 0.06 * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
        places = np.column_stack([flat.reshape(-1, 2), np.zeros(4 * len(flat))]) @ pose[:3, :3].T + pose[:3, 3]
        off = straight.project(places) - view.corners.reshape(-1, 2)
        assert np.sqrt(np.mean(off**2)) < 0.04
        assert np.abs(off.mean(axis=0)).max() < 0.02
    smeared = next(board_film(straight, iter(poses[:1]), blur=3.0))
    chosen = choose_views([*sharp, finder.find(smeared, 99)], SIZE, Board(), most=99)
    assert [view.stamp_ns for view in chosen] == list(range(8))


def test_too_few_views_are_told():
    with pytest.raises(EpisodeError, match="sharply in 0 different views, needed are 6"):
        calibrate(choose_views([], SIZE, Board()), SIZE, Board())
