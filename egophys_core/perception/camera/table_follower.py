"""Where a live camera is while the board is not seen: from the table, as the last frame with the board showed it."""

import numpy as np

from egophys_core.perception.camera.board_pose import CameraPose
from egophys_core.perception.camera.dominant_plane import PlaneTracker
from egophys_core.perception.camera.plane_bundle import pose_from_move
from egophys_core.perception.camera.table_poses import FEWEST_POINTS


class TableFollower:
    """Ties frames by the texture of z = 0 to the last one that was located; nothing drifts with the time between."""

    def __init__(self, camera_matrix: np.ndarray) -> None:
        """Nothing was located yet.

        Args:
            camera_matrix: [3, 3] K of the images, pixels.
        """
        self._matrix = camera_matrix
        self._located: tuple[np.ndarray, np.ndarray] | None = None
        self._tracker: PlaneTracker | None = None
        self._frame = 0

    def locate(self, image: np.ndarray, pose: CameraPose) -> None:
        """Take a frame [H, W, 3] uint8 BGR whose pose the board gives."""
        self._located, self._tracker = (image, pose.world_from_camera), None

    def find(self, image: np.ndarray) -> np.ndarray | None:
        """[4, 4] world from camera of a frame [H, W, 3] uint8 BGR without the board; None if too little is seen."""
        if self._located is None:
            return None
        last, pose = self._located
        if self._tracker is None:
            self._tracker, self._frame = PlaneTracker(), 0
            self._tracker.add(0, last)
        self._frame += 1
        is_tied = self._tracker.add(self._frame, image)
        points = max((len(each.points) for each in self._tracker.observations), default=0)
        # They are for a fit of all frames, which a live camera never ends.
        self._tracker.observations.clear()
        if not is_tied or 0 not in self._tracker.from_first or points < FEWEST_POINTS:
            return None
        move = np.linalg.inv(self._matrix) @ self._tracker.from_first[self._frame] @ self._matrix
        return pose_from_move(move, pose)
