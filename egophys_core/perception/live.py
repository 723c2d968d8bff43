"""Frames of a live camera -> observations."""

import numpy as np
from threadpoolctl import threadpool_limits

from egophys_core.errors import EpisodeError, OptionsError
from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.board_pose import BoardPoseFinder, CameraPose, NoPose
from egophys_core.perception.camera.lens import Camera, FullView, SquareView, upright_turns
from egophys_core.perception.camera.pose_track import LONGEST_FILLED_GAP_S
from egophys_core.perception.camera.table_follower import TableFollower
from egophys_core.perception.observation import Observation
from egophys_core.perception.options import PerceptionOptions, Stages
from egophys_core.perception.scene_observer import SceneObserver
from egophys_core.perception.stages import View


def require_live(options: PerceptionOptions) -> None:
    """Check that the stages can follow a live camera.

    Raises:
        OptionsError: they go through a video several times.
    """
    if options.stages == Stages.LEARNED:
        raise OptionsError(
            "stages learned go through a video several times, so they are for recorded ones (`egophys perceive`, "
            "twin_node); take stages classical for a live camera"
        )


class LiveObserver:
    """As `perceive`, frame by frame: poses are not interpolated, since what comes next is not known.

    While the board is not seen, the table's texture carries the pose from the last frame in which it was.
    """

    def __init__(self, camera: Camera, *, options: PerceptionOptions | None = None, board: Board | None = None) -> None:
        """Nothing is known yet.

        Raises:
            OptionsError: learned stages are asked for.
            LearnedModelError: landmarks of hands are asked for, and their models are missing or do not fit.
        """
        from egophys_core.perception.learned.loading import load_landmarker

        require_live(options or PerceptionOptions())
        self._camera = camera
        self._options = options or PerceptionOptions()
        self._board = board or Board()
        self._full = FullView(camera)
        self._finder = BoardPoseFinder(self._board, self._full.matrix)
        self._table = TableFollower(self._full.matrix)
        self._square: SquareView | None = None
        self._landmarker = load_landmarker(self._options)
        self._scene = self._new_scene()
        self._near: CameraPose | None = None
        self._stamp_ns = 0
        self.status = "waiting for the first frame"
        """What it does or misses, for people."""

    def add(self, stamp_ns: int, image: np.ndarray) -> list[Observation]:
        """Take the next frame.

        Args:
            stamp_ns: nanoseconds; a frame that is not later than the one before is left out.
            image: [H, W, 3] uint8, BGR, as the camera gives it.

        Returns:
            Nothing while the object at rest is being learnt and for frames without a pose; else, mostly, one.
        """
        if stamp_ns <= self._stamp_ns:
            self.status = "a frame is not later than the one before; left out"
            return []
        is_recent = (stamp_ns - self._stamp_ns) * 1e-9 < LONGEST_FILLED_GAP_S
        whole = self._full.image(image)
        pose = self._finder.find(whole, near=self._near if is_recent else None)
        self._stamp_ns = stamp_ns
        if isinstance(pose, NoPose):
            self._near = self._near if is_recent else None
            world_from_camera = self._table.find(whole)
            if world_from_camera is None:
                self.status = f"no camera pose: {pose.reason}"
                return []
        else:
            self._near, world_from_camera = pose, pose.world_from_camera
            self._table.locate(whole, pose)
        raw_pose = self._full.to_raw_pose(world_from_camera)
        if self._square is None:
            self._square = SquareView(self._camera, turns=upright_turns(raw_pose), side=self._options.side)
        view = View(
            stamp_ns=stamp_ns,
            image=self._square.image(image),
            camera_matrix=self._square.matrix,
            world_from_camera=self._square.from_raw_pose(raw_pose),
        )
        try:
            with threadpool_limits(1):
                observations = self._scene.add(view)
        except EpisodeError as error:
            # Try again with the next second; the object may not have been in view yet.
            self._scene = self._new_scene()
            self.status = f"learning the object at rest failed: {error}"
            return []
        if observations:
            seen = float(np.mean(observations[-1].visible))
            self.status = f"tracking {len(observations[-1].points)} points, {seen:.0%} seen"
        elif self._scene.rest is None:
            self.status = "learning the object at rest: keep hands away"
        return observations

    def _new_scene(self) -> SceneObserver:
        return SceneObserver(self._options, self._board, landmarker=self._landmarker)
