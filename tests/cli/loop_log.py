"""A log as the nodes leave one, made of what the library gives: inputs and outputs of a build, a plan, a prediction."""

import dataclasses
import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np

from egophys_core.episode import Episode
from egophys_core.planning import Start
from egophys_core.recording import (
    LATCHED_QOS,
    LogWriter,
    TopicInfo,
    definition_from_folder,
    encode_points,
    standard_definition,
    types_of_topics,
)
from egophys_core.twin import Twin, encode_twin
from egophys_core.waypoint_plan import WaypointPlan

MESSAGES = Path(__file__).resolve().parents[2] / "ros2_ws" / "src" / "egophys_msgs" / "msg"
STRING, BYTES, POINTS = "std_msgs/msg/String", "std_msgs/msg/UInt8MultiArray", "sensor_msgs/msg/PointCloud2"
PLAN, JOB = "egophys_msgs/msg/WaypointPlan", "egophys_msgs/msg/BuildJob"
JOB_ID = bytes(range(16))
RUNNING, SUCCEEDED, FAILED = 0, 1, 2
SEED = 5

Entry = tuple[str, str, bytes]
"""Topic, type, serialized message."""


@cache
def own_definition(type_name: str):
    return definition_from_folder(type_name, MESSAGES)


@cache
def types():
    return types_of_topics(
        [TopicInfo(name="", type=name, messages=0, definition=own_definition(name).text) for name in (PLAN, JOB)]
    )


def cdr(type_name: str, **fields) -> bytes:
    return bytes(types().serialize_cdr(types().types[type_name](**fields), type_name))


def text(content: dict) -> bytes:
    return cdr(STRING, data=json.dumps(content))


def job(state: int, job_id: bytes = JOB_ID) -> bytes:
    identity = types().types["unique_identifier_msgs/msg/UUID"](uuid=np.frombuffer(job_id, np.uint8))
    return cdr(JOB, job_id=identity, stage="", progress=1.0, state=state, message="")


def model(twin: Twin) -> bytes:
    layout = types().types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return cdr(BYTES, layout=layout, data=np.frombuffer(encode_twin(twin), np.uint8))


def points(xyz: np.ndarray, ids: np.ndarray | None = None, confidence: np.ndarray | None = None, stamp_ns=0) -> bytes:
    count = len(xyz)
    return encode_points(
        stamp_ns=stamp_ns,
        frame_id="world",
        xyz=xyz,
        ids=np.arange(count, dtype=np.uint32) if ids is None else ids,
        confidence=np.ones(count, np.float32) if confidence is None else confidence,
    )


def plan_message(plan: WaypointPlan) -> bytes:
    def made(name: str, **fields):
        return types().types[name](**fields)

    time = made("builtin_interfaces/msg/Time", sec=0, nanosec=0)
    nanoseconds = [round(each * 1e9) for each in plan.times.tolist()]
    return cdr(
        PLAN,
        header=made("std_msgs/msg/Header", stamp=time, frame_id="world"),
        twin_id=plan.twin_id,
        poses=[
            made(
                "geometry_msgs/msg/Pose",
                position=made("geometry_msgs/msg/Point", **dict(zip("xyz", position, strict=True))),
                orientation=made("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", quaternion, strict=True))),
            )
            for position, quaternion in zip(plan.positions.tolist(), plan.quaternions.tolist(), strict=True)
        ],
        gripper_opening_m=plan.gripper_opening,
        time_from_start=[
            made("builtin_interfaces/msg/Duration", sec=each // 10**9, nanosec=each % 10**9) for each in nanoseconds
        ],
        predicted_cost=plan.predicted_cost,
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Loop:
    """One run of the system: what went in and what came out, in the order in which it is recorded."""

    episode: Episode
    seed: int = SEED
    options: dict
    twin: Twin
    target: np.ndarray
    plan_seed: int = SEED
    plan_options: dict
    plan: WaypointPlan
    predicted: np.ndarray
    start: Start
    """Where the plan and the prediction begin."""

    def entries(self) -> list[Entry]:
        build = {
            "job_id": JOB_ID.hex(),
            "seed": self.seed,
            "options": self.options,
            "parent_id": "",
            "episodes": [{"name": self.episode.name, "frames": self.episode.frames, "ground_height": 0.0}],
        }
        problem = {
            "seed": self.plan_seed,
            "options": self.plan_options,
            "twin_id": self.twin.twin_id,
            "grasp_m": self.start.grasp.tolist(),
        }
        entries = [("/twin_node/training/build", STRING, text(build))]
        for frame, seen in enumerate(self.episode.visible):
            stamp_ns = round(self.episode.times[frame] * 1e9)
            objects = points(
                self.episode.points[frame, seen],
                self.episode.point_ids[seen],
                self.episode.confidence[frame, seen],
                stamp_ns,
            )
            hands = points(self.episode.controllers[frame], self.episode.controller_ids, None, stamp_ns)
            entries += [
                ("/twin_node/training/object_points", POINTS, objects),
                ("/twin_node/training/controller_points", POINTS, hands),
            ]
        return [
            *entries,
            ("/twin_node/model", BYTES, model(self.twin)),
            ("/twin_node/job", JOB, job(SUCCEEDED)),
            ("/mppi_planner_node/problem", STRING, text(problem)),
            ("/mppi_planner_node/target", POINTS, points(self.target)),
            ("/mppi_planner_node/start", POINTS, points(self.start.nodes)),
            ("/mppi_planner_node/plan", PLAN, plan_message(self.plan)),
            ("/twin_node/predicted/start", POINTS, points(self.start.nodes)),
            ("/twin_node/predicted/grasp", POINTS, points(self.start.grasp)),
            ("/twin_node/predicted/plan", PLAN, plan_message(self.plan)),
            ("/twin_node/predicted/points", POINTS, points(self.predicted)),
        ]


def write_log(folder: Path, entries: list[Entry], lost: Mapping[str, int] | None = None) -> Path:
    with LogWriter(folder) as log:
        for topic, type_name in dict.fromkeys((topic, type_name) for topic, type_name, _ in entries):
            definition = own_definition(type_name) if type_name in (PLAN, JOB) else standard_definition(type_name)
            log.add_topic(topic, type_name, LATCHED_QOS, definition)
        for index, (topic, _, message) in enumerate(entries):
            log.write(topic, message, 1_000_000_000 + index * 1_000_000)
        for topic, messages in (lost or {}).items():
            log.note_lost(topic, messages)
    return folder
