"""The steps of a log done again: build, plan, prediction. Each gives what it showed."""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from typing import Any

import numpy as np

from egophys_core.errors import EgophysError
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
from egophys_core.recording import decode_episode
from egophys_core.replay.difference import Difference, difference_of_arrays, difference_of_plans, difference_of_twins
from egophys_core.replay.log import ReplayedLog
from egophys_core.twin import Twin, encode_twin
from egophys_core.waypoint_plan import plan_of_message

JOB_SUCCEEDED = 1
"""BuildJob.SUCCEEDED of egophys_msgs."""

Progress = Callable[[str, float, float], None]
"""Called with step, share of it done (0..1) and best value so far (metres)."""


class ReplayOutcome(StrEnum):
    """What a replayed step showed."""

    SAME = "same"
    DIFFERENT = "different"
    LOST = "lost"
    """Some of its inputs are not in the log, though others of the same message stream are."""
    NOT_RECORDED = "not recorded"


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One step of the log done again."""

    step: str
    outcome: ReplayOutcome
    detail: str
    difference: Difference | None = None
    """Of a step that is `DIFFERENT`; None where it failed, or where only bits differ that no value shows."""


def replay_build(log: ReplayedLog, progress: Progress) -> Comparison:
    """Build the twin of the log's last build from its training points."""
    described = log.last(f"{log.twin_node}/training/build")
    if described is None:
        return _not_recorded("build", f"the log has no {log.twin_node}/training/build: the twin was not built in it")
    asked = log.decode_json(described, ("job_id", "seed", "options", "parent_id", "episodes"))
    topics = f"{log.twin_node}/training/object_points", f"{log.twin_node}/training/controller_points"
    frames = [int(episode["frames"]) for episode in asked["episodes"]]
    # The newest build's points are the last ones. Latched topics reach a recorder in any order, so receive
    # times do not tell what belongs together; within a topic the order is that of the publisher.
    records = [log.records(topic)[-sum(frames) :] for topic in topics]
    if any(len(each) < sum(frames) for each in records):
        found = ", ".join(f"{len(each)} on {topic}" for each, topic in zip(records, topics, strict=True))
        detail = f"the build had {sum(frames)} frames, the log has {found}"
        outcome = ReplayOutcome.LOST if all(records) else ReplayOutcome.NOT_RECORDED
        return Comparison(step="build", outcome=outcome, detail=detail)
    bounds = np.cumsum([0, *frames])
    episodes = [
        dataclasses.replace(
            decode_episode(
                [record for each in records for record in each[first:last]],
                name=episode["name"],
                object_topic=topics[0],
                controller_topic=topics[1],
                ground_height=episode["ground_height"],
            ),
            # Logs of earlier versions were of episodes of which nothing was declared.
            held=episode.get("held", False),
            no_table=episode.get("no_table", False),
        )
        for episode, (first, last) in zip(asked["episodes"], pairwise(bounds), strict=True)
    ]
    recorded = _result_of_build(log, asked)
    if recorded is None:
        return _not_recorded(
            "build", f"{log.twin_node}/job and {log.twin_node}/model do not say how the last build ended"
        )

    def work() -> tuple[bool, str, Difference | None]:
        twin = build(
            episodes,
            from_mapping(FitOptions, asked["options"]),
            # Logs of earlier versions say nothing of loads, with which no node could build then.
            loads=asked.get("loads", {}),
            seed=asked["seed"],
            parent_id=asked["parent_id"],
            progress=lambda stage, share, loss: progress("build", share, loss),
        )
        if encode_twin(twin) == encode_twin(recorded):
            return True, f"twin {recorded.twin_id}", None
        difference = difference_of_twins(recorded, twin)
        return False, f"recorded {recorded.twin_id}, replayed {twin.twin_id}", difference

    return _compare("build", work)


def replay_plan(log: ReplayedLog, progress: Progress) -> Comparison:
    """Plan the log's last plan again, with the twin it was planned with."""
    names = [f"{log.planner_node}/{name}" for name in ("problem", "target", "plan")]
    problem, target, plan = (log.last(name) for name in names)
    if problem is None or target is None or plan is None:
        return _not_recorded("plan", f"a finished plan needs {', '.join(names)}")
    described = log.decode_json(problem, ("seed", "options", "twin_id"))
    twin = log.twin_with_id(described["twin_id"])
    if twin is None:
        return _not_recorded("plan", f"the log has no model of twin {described['twin_id']}, which it was planned with")
    shape = log.points(target)
    # Logs of earlier versions have no start: plans began where the twin was built.
    nodes = log.last(f"{log.planner_node}/start")
    grasp = np.array(described.get("grasp_m", twin.grasp), np.float32).reshape(-1, 3)
    start = Start(nodes=log.points(nodes), grasp=grasp) if nodes else start_of_twin(twin)
    recorded = plan_of_message(log.decode(plan))

    def work() -> tuple[bool, str, Difference | None]:
        replayed, _ = plan_to_target(
            lambda plans: twin_costs(twin, plans, shape, start=start),
            grasp_from_points(start.grasp),
            from_mapping(PlanOptions, described["options"]),
            seed=described["seed"],
            twin_id=twin.twin_id,
            progress=lambda done, total, cost: progress("plan", done / total, cost),
        )
        difference = difference_of_plans(recorded, replayed)
        if difference is not None:
            return False, str(difference), difference
        return True, f"{len(recorded.times)} waypoints, cost {recorded.predicted_cost:.6f} m", None

    return _compare("plan", work)


def replay_prediction(log: ReplayedLog) -> Comparison:
    """Roll the log's last rollout out again."""
    names = [f"{log.twin_node}/predicted/{name}" for name in ("plan", "points")]
    plan, points = (log.last(name) for name in names)
    model = log.last(f"{log.twin_node}/model")
    if plan is None or points is None or model is None:
        return _not_recorded("prediction", f"it needs {', '.join(names)} and {log.twin_node}/model")
    predicted = plan_of_message(log.decode(plan))
    # A diagnosis may have published a newer version since.
    twin = log.twin_with_id(predicted.twin_id) or log.decode_twin(model)
    recorded = log.points(points)
    nodes, grasp = (log.last(f"{log.twin_node}/predicted/{name}") for name in ("start", "grasp"))
    start = start_of_twin(twin)
    if nodes and grasp:
        start = Start(nodes=log.points(nodes), grasp=log.points(grasp))

    def work() -> tuple[bool, str, Difference | None]:
        shape = final_shapes(twin, rollout_plans(twin, [predicted], start=start))[0]
        difference = difference_of_arrays(recorded, shape, "positions", "point", "m")
        if difference is None:
            return True, f"largest difference 0 m over {len(shape)} points", None
        if shape.shape != recorded.shape:
            return False, f"{len(recorded)} points recorded, {len(shape)} replayed", difference
        largest = float(np.abs(shape - recorded).max())
        return False, f"{difference}, by up to {largest:g} m", difference

    return _compare("prediction", work)


def _compare(step: str, work: Callable[[], tuple[bool, str, Difference | None]]) -> Comparison:
    """Do a step again; one that fails where the recorded one did not is a difference too."""
    try:
        same, detail, difference = work()
    except EgophysError as error:
        same, detail, difference = False, f"the replay failed: {error}", None
    outcome = ReplayOutcome.SAME if same else ReplayOutcome.DIFFERENT
    return Comparison(step=step, outcome=outcome, detail=detail, difference=difference)


def _not_recorded(step: str, detail: str) -> Comparison:
    return Comparison(step=step, outcome=ReplayOutcome.NOT_RECORDED, detail=detail)


def _result_of_build(log: ReplayedLog, build: Mapping[str, Any]) -> Twin | None:
    """The twin that a build ended with, None if the log does not have its successful end.

    Jobs and models of a diagnosis, which makes versions of the twin, may follow it in the log.
    """
    jobs = (log.decode(record) for record in log.records(f"{log.twin_node}/job"))
    if not any(job.state == JOB_SUCCEEDED and bytes(job.job_id.uuid).hex() == build["job_id"] for job in jobs):
        return None
    twins = (log.decode_twin(record) for record in reversed(log.records(f"{log.twin_node}/model")))
    return next((twin for twin in twins if twin.provenance.parent_id == build["parent_id"]), None)
