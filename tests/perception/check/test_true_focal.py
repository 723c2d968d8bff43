import numpy as np
import pytest

from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.lens import Camera
from egophys_core.perception.check.true_focal import true_focal
from tests.perception.camera.board_scene import MATRIX, SIZE, board_image, random_pose


def test_a_focal_length_wrong_by_a_tenth_is_found_in_full():
    random = np.random.default_rng(8)
    images = [board_image(Board(), random_pose(random), random, samples=3) for _ in range(3)]
    for share in (0.9, 1.1):
        matrix = MATRIX.copy()
        matrix[[0, 1], [0, 1]] *= share
        camera = Camera(width=SIZE, height=SIZE, matrix=matrix, coefficients=np.zeros(5))
        assert true_focal(images, camera, Board()) == pytest.approx(MATRIX[0, 0], rel=0.01)
