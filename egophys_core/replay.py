"""Replaying a log: its inputs go through the same code again and the outputs are compared, bit for bit."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.serde import SerdeError

from egophys_core.errors import EgophysError, RecordingError
from egophys_core.identification import FitOptions, build
from egophys_core.options import from_mapping
from egophys_core.planning import (
    PlanOptions,
    Start,
    final_shapes,
    grasp_from_points,
    plan_to_target,
    rollout_plans,
    start_of_twin,
    twin_costs,
)
from egophys_core.recording import (
    Record,
    decode_episode,
    list_topics,
    read_records,
    types_of_topics,
    xyz_of_message,
)
from egophys_core.twin import Twin, decode_twin, encode_twin
from egophys_core.waypoint_plan import WaypointPlan, plan_of_message

TWIN_NODE = "/twin_node"
PLANNER_NODE = "/mppi_planner_node"

JOB_SUCCEEDED = 1
"""BuildJob.SUCCEEDED of egophys_msgs."""

Progress = Callable[[str, float, float], None]
"""Called with step, share of it done (0..1) and best value so far (metres)."""


class ReplayOutcome(StrEnum):
    """What a replayed step showed."""

    SAME = "same"
    DIFFERENT = "different"
    NOT_RECORDED = "not recorded"


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One step of the log done again."""

    step: str
    outcome: ReplayOutcome
    detail: str


def replay_log(
    path: Path,
    *,
    twin_node: str = TWIN_NODE,
    planner_node: str = PLANNER_NODE,
    progress: Progress = lambda step, share, best: None,
) -> list[Comparison]:
    """Do the build, the plan and the prediction of a log again from what it recorded of their inputs.

    A step whose inputs or outputs are not in the log is `NOT_RECORDED`. On the CPU with the code version that
    made the log every other step is `SAME`.

    Args:
        path: the log, a rosbag2 folder or an MCAP file.
        twin_node: full name of the twin node, the prefix of its topics.
        planner_node: full name of the planner node.

    Raises:
        RecordingError: not a log, or it has none of the nodes' topics.
    """
    log = _Log(path)
    if not any(name.startswith((twin_node + "/", planner_node + "/")) for name in log.topics):
        raise RecordingError(
            f"{path}: no topic of {twin_node} or {planner_node} to replay; the log has {', '.join(log.topics)}"
        )
    return [
        _replay_build(log, twin_node, progress),
        _replay_plan(log, twin_node, planner_node, progress),
        _replay_prediction(log, twin_node),
    ]


class _Log:
    """The records of a log by topic, decoded when asked for."""

    def __init__(self, path: Path) -> None:
        topics = list_topics(path)
        self.path = path
        self.topics = [topic.name for topic in topics]
        self._types = types_of_topics(topics)
        self._records: dict[str, list[Record]] = {}
        for record in read_records(path):
            self._records.setdefault(record.topic, []).append(record)

    def records(self, topic: str) -> list[Record]:
        return self._records.get(topic, [])

    def last(self, topic: str) -> Record | None:
        return self._records[topic][-1] if topic in self._records else None

    def decode(self, record: Record) -> Any:
        try:
            return self._types.deserialize_cdr(record.cdr, record.type)
        except SerdeError as error:
            raise RecordingError(f"{self.path}: a message on {record.topic} is not readable: {error}") from error

    def points(self, record: Record) -> np.ndarray:
        """[P, 3] float32 metres of a PointCloud2."""
        return xyz_of_message(self.decode(record), source=f"{self.path} {record.topic}")

    def decode_json(self, record: Record, required: Sequence[str]) -> dict[str, Any]:
        """The JSON object in a std_msgs/String, which must have the `required` keys."""
        text = self.decode(record).data
        try:
            content = json.loads(text)
        except json.JSONDecodeError as error:
            raise RecordingError(f"{self.path}: {record.topic} is not JSON: {error}") from error
        missing = [key for key in required if not isinstance(content, dict) or key not in content]
        if missing:
            raise RecordingError(
                f"{self.path}: {record.topic} lacks {', '.join(missing)}; was the log made by another version?"
            )
        return dict(content)


def _replay_build(log: _Log, twin_node: str, progress: Progress) -> Comparison:
    described = log.last(f"{twin_node}/training/build")
    if described is None:
        return _not_recorded("build", f"the log has no {twin_node}/training/build: the twin was not built in it")
    asked = log.decode_json(described, ("job_id", "seed", "options", "parent_id", "episodes"))
    topics = f"{twin_node}/training/object_points", f"{twin_node}/training/controller_points"
    frames = [int(episode["frames"]) for episode in asked["episodes"]]
    # The newest build's points are the last ones. Latched topics reach a recorder in any order, so receive
    # times do not tell what belongs together; within a topic the order is that of the publisher.
    records = [log.records(topic)[-sum(frames) :] for topic in topics]
    if any(len(each) < sum(frames) for each in records):
        found = ", ".join(f"{len(each)} on {topic}" for each, topic in zip(records, topics, strict=True))
        return _not_recorded("build", f"the build had {sum(frames)} frames, the log has {found}")
    bounds = np.cumsum([0, *frames])
    episodes = [
        decode_episode(
            [record for each in records for record in each[first:last]],
            name=episode["name"],
            object_topic=topics[0],
            controller_topic=topics[1],
            ground_height=episode["ground_height"],
        )
        for episode, (first, last) in zip(asked["episodes"], pairwise(bounds), strict=True)
    ]
    recorded = _result_of_build(log, twin_node, asked)
    if recorded is None:
        return _not_recorded("build", f"{twin_node}/job and {twin_node}/model do not say how the last build ended")

    def work() -> tuple[bool, str]:
        twin = build(
            episodes,
            from_mapping(FitOptions, asked["options"]),
            # Logs of earlier versions say nothing of loads, with which no node could build then.
            loads=asked.get("loads", {}),
            seed=asked["seed"],
            parent_id=asked["parent_id"],
            progress=lambda stage, share, loss: progress("build", share, loss),
        )
        same = encode_twin(twin) == encode_twin(recorded)
        return (
            same,
            f"twin {recorded.twin_id}" if same else f"recorded {recorded.twin_id}, replayed {twin.twin_id}",
        )

    return _compare("build", work)


def _replay_plan(log: _Log, twin_node: str, planner_node: str, progress: Progress) -> Comparison:
    names = [f"{planner_node}/{name}" for name in ("problem", "target", "plan")]
    problem, target, plan = (log.last(name) for name in names)
    if problem is None or target is None or plan is None:
        return _not_recorded("plan", f"a finished plan needs {', '.join(names)}")
    described = log.decode_json(problem, ("seed", "options", "twin_id"))
    twin = _twin_with_id(log, twin_node, described["twin_id"])
    if twin is None:
        return _not_recorded("plan", f"the log has no model of twin {described['twin_id']}, which it was planned with")
    shape = log.points(target)
    # Logs of earlier versions have no start: plans began where the twin was built.
    nodes = log.last(f"{planner_node}/start")
    grasp = np.array(described.get("grasp_m", twin.grasp), np.float32).reshape(-1, 3)
    start = Start(nodes=log.points(nodes), grasp=grasp) if nodes else start_of_twin(twin)
    recorded = plan_of_message(log.decode(plan))

    def work() -> tuple[bool, str]:
        replayed, _ = plan_to_target(
            lambda plans: twin_costs(twin, plans, shape, start=start),
            grasp_from_points(start.grasp),
            from_mapping(PlanOptions, described["options"]),
            seed=described["seed"],
            twin_id=twin.twin_id,
            progress=lambda done, total, cost: progress("plan", done / total, cost),
        )
        return _difference_of_plans(recorded, replayed)

    return _compare("plan", work)


def _replay_prediction(log: _Log, twin_node: str) -> Comparison:
    names = [f"{twin_node}/predicted/{name}" for name in ("plan", "points")]
    plan, points = (log.last(name) for name in names)
    model = log.last(f"{twin_node}/model")
    if plan is None or points is None or model is None:
        return _not_recorded("prediction", f"it needs {', '.join(names)} and {twin_node}/model")
    predicted = plan_of_message(log.decode(plan))
    # A diagnosis may have published a newer version since.
    twin = _twin_with_id(log, twin_node, predicted.twin_id) or _twin(log, model)
    recorded = log.points(points)
    nodes, grasp = (log.last(f"{twin_node}/predicted/{name}") for name in ("start", "grasp"))
    start = start_of_twin(twin)
    if nodes and grasp:
        start = Start(nodes=log.points(nodes), grasp=log.points(grasp))

    def work() -> tuple[bool, str]:
        shape = final_shapes(twin, rollout_plans(twin, [predicted], start=start))[0]
        if shape.shape != recorded.shape:
            return False, f"{len(recorded)} points recorded, {len(shape)} replayed"
        largest = float(np.abs(shape - recorded).max())
        return np.array_equal(shape, recorded), f"largest difference {largest:g} m over {len(shape)} points"

    return _compare("prediction", work)


def _compare(step: str, work: Callable[[], tuple[bool, str]]) -> Comparison:
    """Do a step again; one that fails where the recorded one did not is a difference too."""
    try:
        same, detail = work()
    except EgophysError as error:
        same, detail = False, f"the replay failed: {error}"
    return Comparison(step=step, outcome=ReplayOutcome.SAME if same else ReplayOutcome.DIFFERENT, detail=detail)


def _not_recorded(step: str, detail: str) -> Comparison:
    return Comparison(step=step, outcome=ReplayOutcome.NOT_RECORDED, detail=detail)


def _difference_of_plans(recorded: WaypointPlan, replayed: WaypointPlan) -> tuple[bool, str]:
    for name in ("times", "positions", "quaternions", "gripper_opening"):
        one, other = getattr(recorded, name), getattr(replayed, name)
        if one.shape != other.shape or not np.array_equal(one, other):
            return False, f"{name} differ: recorded {_brief(one)}, replayed {_brief(other)}"
    if recorded.predicted_cost != replayed.predicted_cost:
        return False, f"cost {recorded.predicted_cost!r} m recorded, {replayed.predicted_cost!r} m replayed"
    return True, f"{len(recorded.times)} waypoints, cost {recorded.predicted_cost:.6f} m"


def _brief(values: np.ndarray) -> Sequence[float]:
    return list(np.round(values[-1:].ravel(), 6).tolist())


def _twin(log: _Log, record: Record) -> Twin:
    return decode_twin(bytes(log.decode(record).data), name=f"{log.path} {record.topic}")


def _twin_with_id(log: _Log, twin_node: str, twin_id: str) -> Twin | None:
    twins = (_twin(log, record) for record in reversed(log.records(f"{twin_node}/model")))
    return next((twin for twin in twins if twin.twin_id == twin_id), None)


def _result_of_build(log: _Log, twin_node: str, build: Mapping[str, Any]) -> Twin | None:
    """The twin that a build ended with, None if the log does not have its successful end.

    Jobs and models of a diagnosis, which makes versions of the twin, may follow it in the log.
    """
    jobs = (log.decode(record) for record in log.records(f"{twin_node}/job"))
    if not any(job.state == JOB_SUCCEEDED and bytes(job.job_id.uuid).hex() == build["job_id"] for job in jobs):
        return None
    twins = (_twin(log, record) for record in reversed(log.records(f"{twin_node}/model")))
    return next((twin for twin in twins if twin.provenance.parent_id == build["parent_id"]), None)
