"""Replaying a log: what is the same is found the same, and what was changed is noticed."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from egophys_core.cli.main import main
from egophys_core.errors import RecordingError
from egophys_core.identification import FitOptions, build
from egophys_core.options import to_mapping
from egophys_core.planning import (
    PlanOptions,
    Start,
    carried_start,
    final_shapes,
    grasp_from_points,
    plan_to_target,
    rollout_plans,
    twin_costs,
)
from egophys_core.recording import jazzy_types, read_episode, write_episode
from egophys_core.replay import ReplayOutcome, log, replay_log
from tests.cli.loop_log import BYTES, FAILED, RUNNING, SEED, STRING, SUCCEEDED, Entry, Loop, cdr, job, model, write_log
from tests.identification.synthetic import sheet_episode

FIT = FitOptions(generations=2, population=4, frame_stride=6, dense_steps=1)
PLANNING = PlanOptions(waypoints=2, settle_s=0.2, samples=4, iterations=2)


@pytest.fixture(scope="module")
def loop(tmp_path_factory) -> Loop:
    # From a bag, as the node reads it.
    folder = tmp_path_factory.mktemp("recorded") / "towel"
    write_episode(sheet_episode(), folder)
    episode = read_episode(folder)
    twin = build([episode], FIT, seed=SEED)
    target = episode.points[-1]
    start = carried_start(twin, twin.model.graph.positions + np.float32([0.02, -0.01, 0.0]))
    plan, _ = plan_to_target(
        lambda plans: twin_costs(twin, plans, target, start=start),
        grasp_from_points(start.grasp),
        PLANNING,
        seed=SEED,
        twin_id=twin.twin_id,
    )
    return Loop(
        episode=episode,
        options=to_mapping(FIT),
        twin=twin,
        target=target,
        plan_options=to_mapping(PLANNING),
        plan=plan,
        predicted=final_shapes(twin, rollout_plans(twin, [plan], start=start))[0],
        start=start,
    )


def outcomes(folder: Path) -> dict[str, str]:
    return {each.step: str(each.outcome) for each in replay_log(folder).steps}


SAME = {"build": "same", "plan": "same", "prediction": "same"}


def test_unchanged_log_is_the_same_in_every_step(loop, tmp_path, capsys):
    folder = write_log(tmp_path / "log", loop.entries())
    assert outcomes(folder) == SAME
    assert main(["replay", str(folder), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert [step["outcome"] for step in content["steps"]] == ["same"] * 3
    assert loop.twin.twin_id in content["steps"][0]["detail"]
    assert content["lost"] == []


def moved_point(loop: Loop) -> Loop:
    points = loop.episode.points.copy()
    points[20, 3, 2] = np.nextafter(points[20, 3, 2], np.float32(1))
    return dataclasses.replace(loop, episode=dataclasses.replace(loop.episode, points=points))


def moved_hand(loop: Loop) -> Loop:
    controllers = loop.episode.controllers.copy()
    controllers[20, 0, 0] += 1e-3
    return dataclasses.replace(loop, episode=dataclasses.replace(loop.episode, controllers=controllers))


def moved_target(loop: Loop) -> Loop:
    return dataclasses.replace(loop, target=loop.target + np.float32(1e-4))


def moved_start(loop: Loop) -> Loop:
    nodes = loop.start.nodes.copy()
    nodes[3, 0] += np.float32(1e-3)
    return dataclasses.replace(loop, start=Start(nodes=nodes, grasp=loop.start.grasp))


def moved_grasp(loop: Loop) -> Loop:
    grasp = loop.start.grasp.copy()
    grasp[0, 0] += np.float32(1e-3)
    return dataclasses.replace(loop, start=Start(nodes=loop.start.nodes, grasp=grasp))


def changed_plan(loop: Loop) -> Loop:
    positions = loop.plan.positions.copy()
    positions[-1, 0] += 1e-6
    return dataclasses.replace(loop, plan=dataclasses.replace(loop.plan, positions=positions))


def changed_cost(loop: Loop) -> Loop:
    cost = float(np.nextafter(loop.plan.predicted_cost, 1))
    return dataclasses.replace(loop, plan=dataclasses.replace(loop.plan, predicted_cost=cost))


def changed_prediction(loop: Loop) -> Loop:
    predicted = loop.predicted.copy()
    predicted[7, 1] = np.nextafter(predicted[7, 1], np.float32(1))
    return dataclasses.replace(loop, predicted=predicted)


@pytest.mark.parametrize(
    ("change", "different"),
    [
        (moved_point, {"build"}),
        (moved_hand, {"build"}),
        (lambda loop: dataclasses.replace(loop, seed=SEED + 1), {"build"}),
        (lambda loop: dataclasses.replace(loop, options={**loop.options, "frame_stride": 5}), {"build"}),
        (moved_target, {"plan"}),
        (lambda loop: dataclasses.replace(loop, plan_seed=SEED + 1), {"plan"}),
        (lambda loop: dataclasses.replace(loop, plan_options={**loop.plan_options, "noise_m": 0.04}), {"plan"}),
        (moved_start, {"plan", "prediction"}),
        (moved_grasp, {"plan", "prediction"}),
        (changed_plan, {"plan", "prediction"}),
        (changed_cost, {"plan"}),
        (changed_prediction, {"prediction"}),
        (lambda loop: dataclasses.replace(loop, predicted=loop.predicted[:-1]), {"prediction"}),
    ],
    ids=[
        "point",
        "hand",
        "build seed",
        "build option",
        "target",
        "plan seed",
        "plan option",
        "start",
        "grasp",
        "waypoint",
        "cost",
        "predicted point",
        "missing predicted point",
    ],
)
def test_change_is_noticed_in_its_step_and_nowhere_else(
    loop, tmp_path, capsys, change: Callable[[Loop], Loop], different
):
    folder = write_log(tmp_path / "log", change(loop).entries())
    expected = {step: "different" if step in different else "same" for step in SAME}
    assert outcomes(folder) == expected
    assert main(["replay", str(folder)]) == 1
    assert "different" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("topic", "missing"),
    [
        ("/twin_node/training/build", {"build"}),
        ("/twin_node/training/object_points", {"build"}),
        ("/twin_node/training/controller_points", {"build"}),
        ("/twin_node/model", {"build", "plan", "prediction"}),
        ("/mppi_planner_node/problem", {"plan"}),
        ("/mppi_planner_node/target", {"plan"}),
        ("/mppi_planner_node/plan", {"plan"}),
        ("/twin_node/predicted/plan", {"prediction"}),
        ("/twin_node/predicted/points", {"prediction"}),
    ],
)
def test_step_without_its_topic_is_not_recorded(loop, tmp_path, topic, missing):
    folder = write_log(tmp_path / "log", [entry for entry in loop.entries() if entry[0] != topic])
    expected = {step: "not recorded" if step in missing else "same" for step in SAME}
    assert outcomes(folder) == expected
    # What was not recorded is no finding as long as something was compared.
    assert main(["replay", str(folder)]) == (0 if len(missing) < 3 else 1)


def without_build(entries: list[Entry]) -> list[Entry]:
    """Of a log of plan and prediction alone, which are done again in no time."""
    return [entry for entry in entries if "/training/" not in entry[0]]


def test_training_frames_that_are_missing_are_lost(loop, tmp_path, capsys):
    entries = loop.entries()
    folder = write_log(tmp_path / "stopped", entries[:11])
    assert outcomes(folder) == {"build": "lost", "plan": "not recorded", "prediction": "not recorded"}
    assert main(["replay", str(folder)]) == 1
    assert "nothing could be compared" in capsys.readouterr().out
    lost = [entry for index, entry in enumerate(entries) if index != 5]
    steps = {each.step: each for each in replay_log(write_log(tmp_path / "lossy", lost)).steps}
    assert steps["build"].outcome == ReplayOutcome.LOST
    assert f"the build had {loop.episode.frames} frames" in steps["build"].detail
    assert steps["plan"].outcome == ReplayOutcome.SAME
    assert main(["replay", str(tmp_path / "lossy")]) == 1


def test_first_difference_is_shown_with_both_values(loop, tmp_path, capsys):
    positions = loop.plan.positions.copy()
    positions[1, 2] += 1e-6
    changed = dataclasses.replace(loop, plan=dataclasses.replace(loop.plan, positions=positions))
    changed = dataclasses.replace(changed_prediction(changed), seed=SEED + 1)
    folder = write_log(tmp_path / "log", changed.entries())
    assert main(["replay", str(folder), "--json"]) == 1
    build, plan, prediction = (step["difference"] for step in json.loads(capsys.readouterr().out)["steps"])
    assert build["quantity"].startswith("parameters.")
    assert build["recorded"] != build["replayed"]
    assert (plan["quantity"], plan["place"], plan["index"], plan["differing"]) == ("positions", "waypoint", 1, 1)
    assert plan["recorded"] == positions[1].tolist()
    assert plan["replayed"] == loop.plan.positions[1].tolist()
    # The plan that is rolled out is the changed one, so every point may differ; the first is named.
    assert prediction["place"] == "point"
    assert prediction["recorded"] != prediction["replayed"]
    assert main(["replay", str(folder)]) == 1
    shown = capsys.readouterr().out
    assert "plan: positions, waypoint 1\n" in shown
    assert f"recorded {' '.join(map(repr, positions[1].tolist()))} m" in shown
    assert f"replayed {' '.join(map(repr, loop.plan.positions[1].tolist()))} m" in shown


def test_log_that_lost_messages_is_a_finding(loop, tmp_path, capsys):
    folder = write_log(tmp_path / "log", without_build(loop.entries()), lost={"/bridge_node/tool_pose": 12})
    assert main(["replay", str(folder)]) == 1
    assert "lost: 12 messages lost on /bridge_node/tool_pose: they did not reach" in capsys.readouterr().out
    # The file alone says so, too.
    (file,) = folder.glob("*.mcap")
    assert main(["replay", str(file), "--json"]) == 1
    content = json.loads(capsys.readouterr().out)
    assert [step["outcome"] for step in content["steps"]] == ["not recorded", "same", "same"]
    (sentence,) = content["lost"]
    assert sentence.startswith("12 messages lost on /bridge_node/tool_pose")
    # A recorder that is killed writes no footer; what came since its last flush is not in the log.
    file.write_bytes(file.read_bytes()[:-8])
    assert main(["replay", str(file)]) == 1
    assert "the summary at the end is cut" in capsys.readouterr().out.replace("\n", " ")


def test_messages_that_are_no_longer_readable_are_counted(loop, tmp_path):
    entries = without_build(loop.entries())
    folder = write_log(tmp_path / "log", entries)
    less = write_log(tmp_path / "less", [entry for entry in entries if entry[0] != "/mppi_planner_node/plan"])
    next(less.glob("*.mcap")).replace(folder / "log_0.mcap")
    (sentence,) = replay_log(folder).lost
    assert sentence == "1 message lost on /mppi_planner_node/plan: 1 was written, 0 can be read"


def made_with(twin, **provenance):
    return dataclasses.replace(twin, provenance=dataclasses.replace(twin.provenance, **provenance))


@pytest.mark.parametrize(
    "earlier",
    [
        {"seed": SEED + 1},
        {"episodes": ({"name": "other", "sha256": ""},)},
        {"settings": to_mapping(FitOptions(generations=9))},
    ],
    ids=["seed", "episode", "settings"],
)
def test_twin_from_before_a_build_is_not_taken_for_its_result(loop, tmp_path, earlier):
    # The latched model of an earlier build is in the log, the recorder stopped before the new one.
    before = [entry for entry in loop.entries() if entry[0].startswith("/twin_node/training")]
    folder = write_log(tmp_path / "log", [("/twin_node/model", BYTES, model(made_with(loop.twin, **earlier))), *before])
    assert outcomes(folder)["build"] == "not recorded"


def test_latched_messages_may_come_in_any_order(loop, tmp_path):
    # A recorder that joins late gets each topic's messages in order, but the topics in any order.
    entries = loop.entries()
    topics = sorted({topic for topic, _, _ in entries})
    grouped = [entry for topic in topics for entry in entries if entry[0] == topic]
    assert outcomes(write_log(tmp_path / "one", grouped)) == SAME
    backward = [entry for topic in reversed(topics) for entry in entries if entry[0] == topic]
    assert outcomes(write_log(tmp_path / "other", backward)) == SAME


def test_plan_is_replayed_with_the_twin_it_was_made_with(loop, tmp_path):
    # A later twin is in use when the log ends; the plan names the earlier one.
    later = dataclasses.replace(loop.twin, ground_height=-0.5)
    entries = [*loop.entries(), ("/twin_node/model", BYTES, model(later))]
    assert outcomes(write_log(tmp_path / "log", entries))["plan"] == "same"


def test_replay_that_fails_is_a_difference_with_the_reason(loop, tmp_path):
    far = loop.episode.controllers + np.float32([0, 0, 2])
    entries = dataclasses.replace(loop, episode=dataclasses.replace(loop.episode, controllers=far)).entries()
    build = replay_log(write_log(tmp_path / "log", entries)).steps[0]
    assert build.outcome == ReplayOutcome.DIFFERENT
    assert "the replay failed" in build.detail
    assert "no hand moves the object" in build.detail


def renamed(loop: Loop, twin_node: str, planner_node: str) -> list[Entry]:
    return [
        (topic.replace("/twin_node", twin_node).replace("/mppi_planner_node", planner_node), kind, message)
        for topic, kind, message in without_build(loop.entries())
    ]


def test_nodes_in_a_namespace_or_of_other_names_are_found(loop, tmp_path, capsys):
    other = renamed(loop, "/lab/twin", "/lab/planner")
    folder = write_log(tmp_path / "log", other)
    with pytest.raises(RecordingError, match="no topic of /twin_node or /mppi_planner_node to replay; the log has"):
        replay_log(folder)
    assert main(["replay", str(folder), "--twin-node", "/lab/twin", "--planner-node", "/lab/planner"]) == 0
    in_namespace = renamed(loop, "/lab/twin_node", "/lab/mppi_planner_node")
    assert outcomes(write_log(tmp_path / "lab", in_namespace)) == {**SAME, "build": "not recorded"}
    both = write_log(tmp_path / "both", [*in_namespace, *renamed(loop, "/b/twin_node", "/lab/mppi_planner_node")])
    assert main(["replay", str(both)]) == 2
    assert "recorded of /b/twin_node and /lab/twin_node; choose one with --twin-node" in capsys.readouterr().err
    assert main(["replay", str(both), "--twin-node", "/b/twin_node"]) == 0


def test_log_without_definitions_says_how_to_record_one(loop, tmp_path, monkeypatch):
    # As one in SQLite has them: none.
    monkeypatch.setattr(log, "types_of_topics", lambda topics: jazzy_types())
    folder = write_log(tmp_path / "log", loop.entries())
    with pytest.raises(RecordingError, match=r"does not hold the definition of egophys_msgs/msg/.* needs; record"):
        replay_log(folder)


def test_bag_that_is_no_log_is_bad_input(tmp_path, capsys):
    write_episode(sheet_episode(), tmp_path / "towel")
    assert main(["replay", str(tmp_path / "towel")]) == 2
    assert main(["replay", str(tmp_path / "no")]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "the log has /object/points, /controller/points" in err


@pytest.mark.parametrize("topic", ["/twin_node/training/build", "/mppi_planner_node/problem", "/twin_node/model"])
def test_damaged_content_is_one_error_that_names_the_log(loop, tmp_path, topic, capsys):
    def damaged(entry: Entry) -> Entry:
        name, kind, _ = entry
        if name != topic:
            return entry
        return name, kind, cdr(STRING, data="{") if kind == STRING else model(loop.twin)[:200]

    folder = write_log(tmp_path / "log", [damaged(entry) for entry in loop.entries()])
    assert main(["replay", str(folder)]) == 2
    assert str(folder) in capsys.readouterr().err


@pytest.mark.parametrize(
    "ended", [job(RUNNING), job(FAILED), job(SUCCEEDED, bytes(16))], ids=["running", "failed", "other"]
)
def test_build_without_its_successful_end_is_not_replayed(loop, tmp_path, ended):
    entries = [
        (topic, name, ended if topic == "/twin_node/job" else message) for topic, name, message in loop.entries()
    ]
    assert outcomes(write_log(tmp_path / "log", entries))["build"] == "not recorded"
