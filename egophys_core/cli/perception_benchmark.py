"""Perception of one bag against what else is in it: measured points and, if it has them, true poses and masks."""

import resource
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from egophys_core.errors import EpisodeError
from egophys_core.evaluation import camera_pose_scores, mask_scores
from egophys_core.evaluation.perception import (
    PointPaths,
    TrackedViews,
    pair_frames,
    points_in_masks,
    score_points,
    score_tracks,
)
from egophys_core.perception.options import PerceptionOptions
from egophys_core.recording import OBJECT_TOPIC, decode_points, list_topics, read_records
from egophys_core.recording.point_tracks import order_by_stamp, stack_by_id

if TYPE_CHECKING:
    from egophys_core.perception.camera.board import Board
    from egophys_core.perception.observation import Observation

TRUE_POSE_TOPIC = "/truth/camera_pose"
"""geometry_msgs/PoseStamped: the recording camera (x right, y down, z forward) in the world."""
TRUE_MASK_TOPIC = "/truth/object_mask/compressed"
"""sensor_msgs/CompressedImage, PNG of the recorded image's size: not black where the object is seen."""
POSE_TYPE, MASK_TYPE = "geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/CompressedImage"

KEYS = (
    "video",
    *("mean_mm", "p95_mm", "coverage", "id_stability"),
    *("pose_mm", "pose_deg", "pose_coverage"),
    *("mask_j", "mask_f", "points_in_mask"),
    *("track_delta_avg", "track_aj", "track_oa"),
    *("seconds", "cpu_seconds", "views", "posed"),
)
"""Of a row; the value is None where the bag has nothing to compare with."""


def read_measured(bag: Path) -> PointPaths:
    """The measured points of the object in a bag.

    Raises:
        RecordingError: not a bag, or it has no such topic.
        EpisodeError: no message is in it.
    """
    frames = [decode_points(record.cdr, source=str(bag)) for record in read_records(bag, (OBJECT_TOPIC,))]
    if not frames:
        raise EpisodeError(f"{bag}: no messages on {OBJECT_TOPIC}; there is nothing to compare with")
    frames = order_by_stamp(frames, f"{bag} {OBJECT_TOPIC}")
    _, points, _ = stack_by_id(frames, f"{bag} {OBJECT_TOPIC}")
    return PointPaths(stamps_ns=np.array([frame.stamp_ns for frame in frames], np.int64), points=points.astype(float))


def measure(
    bag: Path,
    measured: PointPaths,
    options: PerceptionOptions,
    board: "Board",
    progress: Callable[[str, float], None] | None = None,
) -> dict[str, Any]:
    """Perceive a bag and compare; a row with `KEYS`.

    `mean_mm`, `p95_mm`, `coverage` and `id_stability` are of the episode's points. Tracks (`track_*`) are those of the
    observations, compared with the measured points projected with the true poses, or those found where there are none.
    `seconds` are elapsed, `cpu_seconds` those of all threads, both of perceiving alone.

    Raises:
        EpisodeError: what `perceive` refuses.
    """
    from egophys_core.perception.perceive import perceive

    seen = _Collected()
    began, cpu_began = time.perf_counter(), _cpu_seconds()
    perceived = perceive(bag, options=options, board=board, on_observation=seen.add, progress=progress)
    seconds, cpu_seconds = time.perf_counter() - began, _cpu_seconds() - cpu_began
    row: dict[str, Any] = {
        **dict.fromkeys(KEYS),
        "video": video_name(bag),
        "seconds": seconds,
        "cpu_seconds": cpu_seconds,
        "views": perceived.report.frames,
        "posed": perceived.report.posed,
    }
    episode = perceived.episode
    stamps = perceived.start_ns + np.rint(episode.times * 1e9).astype(np.int64)
    row |= score_points(PointPaths(stamps_ns=stamps, points=episode.points.astype(float)), measured).as_dict()
    views = seen.views()
    truth = _Truth(bag, views, options.side)
    poses = truth.poses()
    tracks = score_tracks(views, measured, poses=poses)
    row |= {
        "track_delta_avg": tracks.delta_avg,
        "track_aj": tracks.average_jaccard,
        "track_oa": tracks.occlusion_accuracy,
        "points_in_mask": points_in_masks(seen.masks(), views, measured, poses=poses),
    }
    if poses is not None:
        known = np.isfinite(poses).all(axis=(1, 2))
        row |= camera_pose_scores(views.world_from_camera[known], poses[known]).as_dict()
    row |= truth.mask_errors(seen)
    return {key: None if isinstance(value, float) and not np.isfinite(value) else value for key, value in row.items()}


def video_name(bag: Path) -> str:
    """Of a bag's folder, or of its file without the suffix."""
    bag = bag.resolve()
    return bag.name if bag.is_dir() else bag.stem


class _Collected:
    """What the comparison needs of the observations; images are not kept."""

    def __init__(self) -> None:
        self._kept: list[tuple[int, np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
        self._masks: list[np.ndarray] = []
        self._camera_matrix = np.eye(3)
        self._size = (1, 1)

    def add(self, observation: "Observation") -> None:
        view = observation.view
        known = (observation.confidence > 0)[:, None]
        self._kept.append(
            (
                view.stamp_ns,
                np.where(known, observation.points, np.nan),
                np.where(known, observation.pixels, np.nan),
                observation.visible,
                view.world_from_camera,
            )
        )
        self._masks.append(np.packbits(observation.masks.object))
        self._camera_matrix, self._size = view.camera_matrix, (view.image.shape[1], view.image.shape[0])

    def views(self) -> TrackedViews:
        stamps, points, pixels, visible, poses = (np.stack(each) for each in zip(*self._kept, strict=True))
        return TrackedViews(
            paths=PointPaths(stamps_ns=stamps, points=points),
            pixels=pixels,
            visible=visible,
            world_from_camera=poses,
            camera_matrix=self._camera_matrix,
            size=self._size,
        )

    def masks(self) -> Iterator[np.ndarray]:
        width, height = self._size
        for packed in self._masks:
            yield np.unpackbits(packed, count=width * height).reshape(height, width).astype(bool)


class _Truth:
    """True poses and masks of a bag, turned and cropped as the views of perception are."""

    def __init__(self, bag: Path, views: TrackedViews, side: int) -> None:
        self._bag, self._views, self._side = bag, views, side
        self._turns = 0
        self._topics = {topic.name for topic in list_topics(bag) if topic.messages > 0}

    def poses(self) -> np.ndarray | None:
        """[T, 4, 4] of the views, NaN where a view has none; None if the bag has none."""
        from egophys_core.perception.camera.lens import turn_rotation, upright_turns

        if TRUE_POSE_TOPIC not in self._topics:
            return None
        stamped = [(_stamp(message), _matrix(message.pose)) for message in self._messages(TRUE_POSE_TOPIC, POSE_TYPE)]
        self._turns = upright_turns(stamped[0][1])
        return self._of_views(stamped) @ turn_rotation(self._turns)

    def mask_errors(self, seen: _Collected) -> dict[str, float]:
        """J and F over the views that have a true mask; empty if the bag has none. Call `poses` before."""
        from egophys_core.perception.camera.image_message import image_of_message
        from egophys_core.perception.camera.lens import SquareView
        from egophys_core.perception.camera.video import open_video

        if TRUE_MASK_TOPIC not in self._topics:
            return {}
        view = SquareView(open_video(self._bag).camera, turns=self._turns, side=self._side)
        stamps = [_stamp(message) for message in self._messages(TRUE_MASK_TOPIC, MASK_TYPE)]
        pairs = pair_frames(np.array(stamps, np.int64), self._views.paths.stamps_ns)

        def truths() -> Iterator[np.ndarray]:
            for pair, message in zip(pairs, self._messages(TRUE_MASK_TOPIC, MASK_TYPE), strict=True):
                if pair >= 0:
                    image = image_of_message(message, source=f"{self._bag}: {TRUE_MASK_TOPIC}")
                    yield view.image(np.where(image > 0, 255, 0).astype(np.uint8))[..., 0] > 127

        paired = set(pairs.tolist())
        scores = mask_scores((mask for index, mask in enumerate(seen.masks()) if index in paired), truths())
        return {"mask_j": scores.region, "mask_f": scores.contour}

    def _messages(self, topic: str, type_name: str) -> Iterator[Any]:
        from egophys_core.recording import jazzy_types

        for record in read_records(self._bag, (topic,)):
            yield jazzy_types().deserialize_cdr(record.cdr, type_name)

    def _of_views(self, stamped: list[tuple[int, np.ndarray]]) -> np.ndarray:
        pairs = pair_frames(self._views.paths.stamps_ns, np.array([stamp for stamp, _ in stamped], np.int64))
        poses = np.stack([pose for _, pose in stamped])[pairs]
        poses[pairs < 0] = np.nan
        return poses


def _stamp(message: Any) -> int:
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def _matrix(pose: Any) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    matrix = np.eye(4)
    turn = pose.orientation
    matrix[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    matrix[:3, 3] = pose.position.x, pose.position.y, pose.position.z
    return matrix


def _cpu_seconds() -> float:
    """Of this process, all threads, and of its finished children."""
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in used)
