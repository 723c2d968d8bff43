"""The topics of the twin node: what it holds, what it does, and what it learnt from."""

import dataclasses
import json
from array import array
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from egophys_msgs.msg import BuildJob, TwinInfo, WaypointPlan
from egophys_ros_common.conversions import points_message, time_message, world_header
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.qos import latched
from rclpy.publisher import Publisher
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String, UInt8MultiArray
from unique_identifier_msgs.msg import UUID

from egophys_core.episode import Episode
from egophys_core.episode_source import EpisodeSource, LoadedEpisode
from egophys_core.kinds import kind_of
from egophys_core.options import to_mapping
from egophys_core.planning import Start
from egophys_core.twin import Twin, encode_twin
from egophys_core.waypoint_plan import NANOSECONDS
from egophys_twin.build import BuildRequest
from egophys_twin.recordings import loads_by_name

STAGES_AT_ONCE = 20
"""Messages about a job that may wait for a busy subscriber: its first stages follow each other within milliseconds."""

SCORES = ("train_chamfer_m", "train_track_m", "test_chamfer_m", "test_track_m")


class TwinTopics:
    """Publishers of the twin node; all latched, so that a recorder started later has the whole story."""

    def __init__(self, node: ManagedNode) -> None:
        """Create the publishers; the node destroys them at cleanup."""
        self._node = node
        self._info = self._publisher(TwinInfo, "~/info")
        self._model = self._publisher(UInt8MultiArray, "~/model")
        self._job = self._publisher(BuildJob, "~/job", STAGES_AT_ONCE)
        self._training = self._publisher(String, "~/training/build")
        self._predicted_plan = self._publisher(WaypointPlan, "~/predicted/plan")
        self._predicted_points = self._publisher(PointCloud2, "~/predicted/points")
        self._predicted_start = self._publisher(PointCloud2, "~/predicted/start")
        self._predicted_grasp = self._publisher(PointCloud2, "~/predicted/grasp")
        self._training_points: list[Publisher] = []
        node.own(self, TwinTopics._forget_training)

    def publish_twin(self, twin: Twin, info: TwinInfo) -> None:
        """Say which twin is in use, and hand out its file's content."""
        self._info.publish(info)
        self._model.publish(UInt8MultiArray(data=array("B", encode_twin(twin))))

    def publish_job(self, job: BuildJob) -> None:
        """State of the newest job."""
        self._job.publish(job)

    def publish_training(self, job_id: UUID, request: BuildRequest, loaded: Sequence[LoadedEpisode]) -> None:
        """Everything a build depends on, so that a log is enough to do it again, bit for bit.

        The points are kept for late subscribers until the next build: the depth is that of this build, hence
        publishers of its own.
        """
        episodes = [each.episode for each in loaded]
        build = {
            "job_id": bytes(job_id.uuid).hex(),
            "seed": request.seed,
            "options": to_mapping(request.options),
            "loads": loads_by_name(request.loads, episodes),
            "parent_id": "",
            "episodes": [_described(each, request.source) for each in loaded],
        }
        self._forget_training()
        self._training.publish(String(data=json.dumps(build)))
        frames = sum(each.frames for each in episodes)
        self._training_points = [
            self._node.create_publisher(PointCloud2, f"~/training/{name}_points", latched(depth=frames))
            for name in ("object", "controller")
        ]
        for episode in episodes:
            self._publish_points(episode)

    def publish_prediction(self, plan: WaypointPlan, points: PointCloud2, start: Start, stamp: Time) -> None:
        """A plan that was rolled out alone, from where, and the object at its end."""
        for publisher, xyz in ((self._predicted_start, start.nodes), (self._predicted_grasp, start.grasp)):
            publisher.publish(points_message(xyz, ids=np.arange(len(xyz)), stamp=stamp))
        self._predicted_plan.publish(plan)
        self._predicted_points.publish(points)

    def _publish_points(self, episode: Episode) -> None:
        objects, controllers = self._training_points
        seen = episode.visible & (episode.confidence > 0)
        stamps_ns = np.rint(episode.times * NANOSECONDS).astype(np.int64).tolist()
        for frame, (stamp_ns, mask) in enumerate(zip(stamps_ns, seen, strict=True)):
            message = partial(points_message, stamp=time_message(stamp_ns))
            objects.publish(
                message(
                    episode.points[frame, mask],
                    ids=episode.point_ids[mask],
                    confidence=episode.confidence[frame, mask],
                )
            )
            controllers.publish(message(episode.controllers[frame], ids=episode.controller_ids))

    def _forget_training(self) -> None:
        while self._training_points:
            self._node.destroy_publisher(self._training_points.pop())

    def _publisher(self, kind: type, name: str, depth: int = 1) -> Publisher:
        return self._node.own(self._node.create_publisher(kind, name, latched(depth)), self._node.destroy_publisher)


def _described(loaded: LoadedEpisode, source: EpisodeSource) -> dict[str, Any]:
    episode, report = loaded.episode, loaded.report
    described = {
        "name": episode.name,
        "frames": episode.frames,
        "ground_height": episode.ground_height,
        "held": episode.held,
        "no_table": episode.no_table,
    }
    if report is None:
        return described
    return described | {
        "perception": {
            "report": dataclasses.asdict(report),
            "options": to_mapping(source.perception),
            "board": to_mapping(source.board),
        }
    }


def info_message(twin: Twin, path: Path, built: Time) -> TwinInfo:
    """What a twin is and how it came to be."""
    graph, provenance = twin.model.graph, twin.provenance
    return TwinInfo(
        header=world_header(built),
        twin_id=twin.twin_id,
        parent_id=provenance.parent_id,
        path=str(path.absolute()),
        object_kind=kind_of(twin.model).name,
        node_count=len(graph.positions),
        spring_count=len(graph.springs),
        episodes=[episode["name"] for episode in provenance.episodes],
        seed=provenance.seed,
        code_version=provenance.code_version,
        settings_json=json.dumps(provenance.settings),
        **{name: float(provenance.scores.get(name, np.nan)) for name in SCORES},
    )
