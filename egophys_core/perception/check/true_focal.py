"""By how much a focal length is wrong, in full: what the tags say of it in one step is too little where it is much."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.board_pose import BoardPoseFinder, CameraPose, focal_error
from egophys_core.perception.camera.lens import Camera, FullView

_STEPS = 4
_SETTLED = 0.002


def true_focal(images: Sequence[np.ndarray], camera: Camera, board: Board) -> float:
    """Pixels: the focal length with which the tags fit, found by correcting it until they ask for no more.

    Args:
        images: [H, W, 3] uint8 each, with tags; five do.
        camera: of the images.
        board: on the table.
    """
    share = 1.0
    for _ in range(_STEPS):
        matrix = camera.matrix.copy()
        matrix[[0, 1], [0, 1]] *= share
        view = FullView(replace(camera, matrix=matrix))
        finder = BoardPoseFinder(board, view.matrix)
        poses = [pose for pose in (finder.find(view.image(each)) for each in images) if isinstance(pose, CameraPose)]
        error, _ = focal_error(poses)
        share *= 1 + error
        if abs(error) < _SETTLED:
            break
    return float(camera.matrix[0, 0] * share)
