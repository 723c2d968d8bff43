"""The focal length that a camera must have, from the board it sees, where its CameraInfo has another."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.board_pose import DOUBTFUL_TAG_OFFSET, BoardPoseFinder, CameraPose, focal_error

_ROUNDS = 8
"""At most; each leaves a third to a half of the error: 10 % are 0.2 % after four to six."""
_FLOOR = 0.002
"""Share of the focal length: what calibrations of the same camera differ by."""


@dataclass(frozen=True, kw_only=True)
class FocalLength:
    """What the focal length is rather."""

    pixels: float
    """Mean of those along x and y."""
    deviation: float
    """Pixels: its standard deviation."""
    given: float
    """Pixels: what the intrinsics have."""
    rms_pixels: float
    """By how much tags still lie beside where the poses have them, root mean square."""

    @property
    def note(self) -> str:
        """For the user."""
        error, deviation = 100 * (self.given / self.pixels - 1), 100 * self.deviation / self.pixels
        more = (
            f"; the tags still lie {self.rms_pixels:.2f} pixels off, so distortion or centre are wrong, too"
            if self.rms_pixels > DOUBTFUL_TAG_OFFSET
            else ""
        )
        return (
            f"the focal length of the CameraInfo, {self.given:.0f} pixels, is too {'long' if error > 0 else 'short'} "
            f"by {abs(error):.1f} +- {deviation:.1f} %: the tags say {self.pixels:.0f} +- {self.deviation:.0f}{more}; "
            "distances along the view are wrong by as much: calibrate the camera"
        )


def focal_length(images: Sequence[np.ndarray], board: Board, camera_matrix: np.ndarray) -> FocalLength | None:
    """The focal length with which the board's print fits pinhole images best; None if it does not come to rest.

    Args:
        images: [H, W, 3] uint8 BGR, as different as can be.
        board: seen in them.
        camera_matrix: [3, 3] K with a focal length that is right to about 30 %.
    """
    matrix = np.array(camera_matrix, dtype=np.float64)
    given = float(np.sqrt(matrix[0, 0] * matrix[1, 1]))
    for _ in range(_ROUNDS):
        finder = BoardPoseFinder(board, matrix)
        poses = [pose for pose in map(finder.find, images) if isinstance(pose, CameraPose)]
        if not poses:
            return None
        error, deviation = focal_error(poses)
        matrix[[0, 1], [0, 1]] *= np.exp(error)
        if abs(error) < max(deviation, _FLOOR):
            pixels = float(np.sqrt(matrix[0, 0] * matrix[1, 1]))
            return FocalLength(
                pixels=pixels,
                deviation=pixels * float(np.hypot(deviation, _FLOOR)),
                given=given,
                rms_pixels=float(np.median([pose.rms_pixels for pose in poses])),
            )
    return None
