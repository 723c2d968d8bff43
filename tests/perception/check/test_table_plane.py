from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.perception.camera.board import Board
from egophys_core.perception.check.table_plane import free_table, table_plane
from tests.perception.table_scene import Scene, draw


@pytest.mark.parametrize(("tilt_deg", "height"), [(0.0, 0.0), (6.0, 0.0), (0.0, 0.03)])
def test_a_board_that_does_not_lie_on_the_table_is_told_by_the_table(tilt_deg, height):
    views, masks = zip(*(draw(Scene(hand_frames=None), frame) for frame in range(0, 19, 3)), strict=True)
    # The world is the board's: one that is tilted and raised has the table under it, tilted the other way.
    world = np.eye(4)
    world[:3, :3] = Rotation.from_rotvec([np.radians(tilt_deg), 0, 0]).as_matrix()
    world[2, 3] = -height
    seen = tuple(replace(view, world_from_camera=world @ view.world_from_camera) for view in views)
    plane = table_plane(seen, free_table(seen[0], masks[0].object, Board(origin=(2.0, 2.0, 0.0))))
    assert plane.tilt_deg == pytest.approx(tilt_deg, abs=0.5)
    if tilt_deg == 0:
        assert plane.height_m == pytest.approx(-height, abs=0.004)
    assert plane.tilt_sigma_deg < 0.5


def test_a_table_of_one_colour_tells_nothing():
    views, masks = zip(*(draw(Scene(hand_frames=None), frame) for frame in range(0, 10, 3)), strict=True)
    plain = tuple(replace(view, image=np.full_like(view.image, 120)) for view in views)
    assert table_plane(plain, ~masks[0].object) is None
