"""The whole loop on a recorded video, with the real nodes over DDS and the arm's controller emulated.

perceive -> build a twin -> plan to a target shape -> execute on the (emulated) xArm6 -> record -> replay -> tables
"""

import argparse
import json
import os
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from action_msgs.msg import GoalStatus
from egophys_msgs.action import BuildTwin, ExecutePlan, PlanToTarget
from egophys_msgs.msg import TwinInfo, WaypointPlan
from egophys_msgs.srv import RolloutTwin
from egophys_ros_common.conversions import executed_plan, points_message
from egophys_ros_common.processes import Client, NodeProcess
from egophys_ros_common.qos import latched
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from egophys_core.cli.display import print_scores
from egophys_core.episode import Episode
from egophys_core.errors import EgophysError, EpisodeError
from egophys_core.evaluation import baseline_scores
from egophys_core.evaluation.perception import PointPaths, score_points
from egophys_core.identification import evaluate_twin
from egophys_core.observation import contact_flags, find_hands
from egophys_core.recording import Record, decode_episode, read_episode, xyz_of_message
from egophys_core.replay import ReplayOutcome, replay_log
from egophys_core.reporting import draw_shapes
from egophys_core.twin import load_twin

REPOSITORY = Path(__file__).resolve().parents[1]
EPISODE = REPOSITORY / "examples/towel_lift_video.mcap"
MEASURED = REPOSITORY / "examples/towel_lift_video_points.mcap"
"""Points measured while that video was taken; perception does not see them."""
ROBOT_IP = "127.0.0.7"
"""The emulator's own loopback address, so that it does not meet one started by hand."""
CONFIGURATION = REPOSITORY / "ros2_ws/src"
PLAN_TIMEOUT_S = 300.0
BUILD_TIMEOUT_S = 900.0

console = Console()


@dataclass(frozen=True, kw_only=True)
class Outcomes:
    """What the nodes answered."""

    episode: Episode
    """What the twin was built from."""
    target: np.ndarray
    """[P, 3] metres, world."""
    plan: WaypointPlan
    predicted: np.ndarray
    """[S, 3] metres: the object after the plan, as the twin predicts it."""
    executed: np.ndarray
    """[S, 3] metres: the object after the tool path that was measured."""
    costs_m: tuple[float, float, float]
    """Distance to the target before, predicted and after execution."""


def main() -> int:
    """Run the demo; 0 if every step worked and the replay gave the same."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episode", type=Path, default=EPISODE, help="recorded video, or points, to build from")
    parser.add_argument("--measured", type=Path, help="measured points to compare those perceived with")
    parser.add_argument("--out", type=Path, default=Path("out/demo"), help="folder for twin, log and picture")
    parser.add_argument("--target-frame", type=int, default=70, help="the shape seen in this frame is the target")
    parser.add_argument("--generations", type=int, default=50, help="generations of the fit")
    parser.add_argument("--seed", type=int, default=0)
    parsed = parser.parse_args()
    # A graph of its own, on this machine only: nodes that already run are left alone.
    os.environ.setdefault("ROS_DOMAIN_ID", "71")
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    folder = new_folder(parsed.out)
    try:
        return report(parsed, folder, run_nodes(parsed, folder))
    except (EgophysError, RuntimeError, TimeoutError) as error:
        console.print(f"[red]demo failed:[/red] {error}\nThe nodes' output is in {folder}")
        return 1


def new_folder(wanted: Path) -> Path:
    """`wanted` if it is free, else the first free `wanted-2`, `wanted-3`, ...: no earlier run is overwritten."""
    folder, number = wanted, 2
    while folder.exists():
        folder, number = wanted.with_name(f"{wanted.name}-{number}"), number + 1
    folder.mkdir(parents=True)
    return folder


def run_nodes(parsed: argparse.Namespace, folder: Path) -> Outcomes:
    """Start the nodes, drive them through the story, stop them; the log is then complete."""
    # The stack ends every process, also those after one that does not end well.
    with ExitStack() as stack:
        client = Client()
        stack.callback(client.close)
        start_nodes(parsed, folder, stack)
        for node in ("/recorder_node", "/twin_node", "/mppi_planner_node", "/bridge_node"):
            client.wait_for_state(node, "active")
        return drive(parsed, folder, client)


def start_nodes(parsed: argparse.Namespace, folder: Path, stack: ExitStack) -> None:
    """Start the emulator and the nodes; what they print goes to files in the folder."""

    def start(package: str, executable: str, *arguments: str) -> None:
        stack.callback(NodeProcess(package, executable, list(arguments), folder / f"{executable}.txt").stop)

    def start_node(package: str, executable: str, config: str, **parameters: str) -> None:
        values = {"autostart": "true", **parameters}
        assignments = [part for name, value in values.items() for part in ("-p", f"{name}:={value}")]
        file = CONFIGURATION / package / "config" / config
        start(package, executable, "--ros-args", "--params-file", str(file), *assignments)

    console.print("starting the nodes: twin_node, mppi_planner_node, recorder_node, bridge_node, xArm6 emulator")
    start("xarm_bridge", "emulator", "--host", ROBOT_IP)
    calibration = CONFIGURATION / "xarm_bridge/config/world_to_base.yaml"
    start_node("egophys_twin", "recorder_node", "recorder.yaml", output_folder=str(folder / "log"))
    start_node("egophys_twin", "twin_node", "twin.yaml", generations=str(parsed.generations))
    start_node("egophys_planner", "mppi_planner_node", "planner.yaml")
    arm = {"robot_ip": ROBOT_IP, "allow_emulator": "true", "calibration_file": str(calibration)}
    start_node("xarm_bridge", "bridge_node", "bridge.yaml", **arm)


def drive(parsed: argparse.Namespace, folder: Path, client: Client) -> Outcomes:
    """Build, plan, execute, and ask the twin what the executed path does."""
    build_twin(parsed, folder, client)
    episode = training_episode(client)
    if not 0 <= parsed.target_frame < episode.frames:
        raise EpisodeError(f"--target-frame must be in 0 .. {episode.frames - 1}, got {parsed.target_frame}")
    seen = np.isfinite(episode.points[parsed.target_frame]).all(axis=1)
    target = episode.points[parsed.target_frame, seen]
    target_message = points_message(target, ids=episode.point_ids[seen])
    planned = act(
        client,
        PlanToTarget,
        "/mppi_planner_node/plan_to_target",
        PlanToTarget.Goal(target=target_message, seed=parsed.seed),
        "plan",
        lambda f: (f.iteration / max(f.iterations, 1), f"distance {1000 * f.best_cost:.1f} mm"),
        PLAN_TIMEOUT_S,
    )
    executed = act(
        client,
        ExecutePlan,
        "/bridge_node/execute",
        ExecutePlan.Goal(plan=planned.plan),
        "execute",
        lambda f: (f.progress, f"tool at z = {f.current.pose.position.z:.3f} m"),
        PLAN_TIMEOUT_S,
    )

    def roll_out(plan: WaypointPlan) -> tuple[float, np.ndarray]:
        request = RolloutTwin.Request(plans=[plan], target=target_message, return_shapes=True)
        response = client.call(RolloutTwin, "/twin_node/rollout", request, PLAN_TIMEOUT_S)
        if not response.success:
            raise RuntimeError(f"rollout: {response.message}")
        return response.costs[0], xyz_of_message(response.final_shapes[0], source="final shape")

    predicted_cost, predicted = roll_out(planned.plan)
    executed_cost, after = roll_out(executed_plan(executed.executed, planned.plan))
    return Outcomes(
        episode=episode,
        target=target,
        plan=planned.plan,
        predicted=predicted,
        executed=after,
        costs_m=(planned.initial_cost, predicted_cost, executed_cost),
    )


def build_twin(parsed: argparse.Namespace, folder: Path, client: Client) -> TwinInfo:
    """Have the twin node build from the episode."""
    goal = BuildTwin.Goal(
        episode_paths=[str(parsed.episode.resolve())],
        output_path=str((folder / "object.twin").resolve()),
        seed=parsed.seed,
    )
    return act(
        client,
        BuildTwin,
        "/twin_node/build",
        goal,
        "build",
        lambda f: (f.progress, f"loss {1000 * f.best_loss:.1f} mm" if np.isfinite(f.best_loss) else f.stage),
        BUILD_TIMEOUT_S,
    ).info


def training_episode(client: Client) -> Episode:
    """The points that the twin was built from, as the twin node has published them."""
    prefix = "/twin_node/training"
    build = json.loads(client.message(String, f"{prefix}/build", qos=latched()).data)
    (described,) = build["episodes"]
    topics = f"{prefix}/object_points", f"{prefix}/controller_points"
    frames = described["frames"]
    records = [
        Record(topic=topic, type="sensor_msgs/msg/PointCloud2", log_time_ns=0, cdr=cdr)
        for topic in topics
        for cdr in client.messages(PointCloud2, topic, frames, qos=latched(frames), raw=True)
    ]
    if "perception" in described:
        found = described["perception"]["report"]
        console.print(
            f"perceived {found['tracked']} points of a {found['kind']} in {found['frames']} frames, "
            f"camera pose found in {found['posed']}, places in {found['coverage']:.0%}"
        )
    return decode_episode(
        records,
        name=described["name"],
        object_topic=topics[0],
        controller_topic=topics[1],
        ground_height=described["ground_height"],
    )


def act(client, kind, name, goal, label, describe, timeout_s):  # type: ignore[no-untyped-def]
    """Send a goal, show its feedback as a bar, and return its result.

    Raises:
        RuntimeError: the goal was rejected or did not succeed; says what the node answered.
    """
    columns = (TextColumn("{task.description:<8}"), BarColumn(), TextColumn("{task.fields[note]}"), TimeElapsedColumn())
    with Progress(*columns, console=console) as progress:
        task = progress.add_task(label, total=1.0, note="")

        def show(feedback) -> None:  # type: ignore[no-untyped-def]
            share, note = describe(feedback)
            progress.update(task, completed=share, note=note)

        handle = client.send_goal(kind, name, goal, on_feedback=show)
        if not handle.accepted:
            raise RuntimeError(f"{name} rejected the goal; its reason is in the node's output")
        answer = client.result(handle, timeout_s)
        if answer.status != GoalStatus.STATUS_SUCCEEDED:
            raise RuntimeError(f"{name}: {answer.result.message}")
        progress.update(task, completed=1.0)
    return answer.result


def paths(episode: Episode) -> PointPaths:
    """The points of an episode, stamped from its start."""
    return PointPaths(stamps_ns=np.rint(episode.times * 1e9).astype(np.int64), points=episode.points)


def report(parsed: argparse.Namespace, folder: Path, outcomes: Outcomes) -> int:
    """Evaluate, replay, draw, and print the tables; 0 if the replay was the same."""
    episode = outcomes.episode
    twin = load_twin(folder / "object.twin")
    measured = parsed.measured or (MEASURED if parsed.episode == EPISODE else None)
    # Perception leaves out what it cannot see; what was measured judges the twin on that too.
    judge = read_episode(measured) if measured is not None else episode
    scores, _ = evaluate_twin(twin, judge)
    with console.status("replaying the log"):
        replay = replay_log(folder / "log")
    picture = folder / "shapes.png"
    before, planned, after = outcomes.costs_m
    draw_shapes(
        picture,
        {
            f"observed at the start\n{1000 * before:.1f} mm from the target": episode.points[0][episode.visible[0]],
            f"predicted after the plan\n{1000 * planned:.1f} mm": outcomes.predicted,
            f"twin under the executed path\n{1000 * after:.1f} mm": outcomes.executed,
            f"target\nobserved at {episode.times[parsed.target_frame]:.1f} s": outcomes.target,
        },
        title=f"plan to a target shape (grey), twin of {episode.name}",
        ghost=outcomes.target,
        ground=twin.ground_height,
    )
    if measured is not None:
        errors = score_points(paths(episode), paths(judge))
        console.print(
            f"perceived against measured points: {1000 * errors.mean_m:.1f} mm on average, 95 % within "
            f"{1000 * errors.p95_m:.1f} mm, over {errors.coverage:.0%} of the points seen"
        )
    contact = contact_flags(judge, find_hands(judge))
    print_scores(f"fit of {episode.name} against {judge.name}", {"twin": scores, **baseline_scores(judge, contact)})
    table = Table(title="distance of the object to the target shape (two-way Chamfer, mm)", title_justify="left")
    for name in ("before planning", "predicted", "after execution*"):
        table.add_column(name, justify="right")
    table.add_row(*(f"{1000 * cost:.1f}" for cost in outcomes.costs_m))
    console.print(table)
    console.print("* the twin driven by the tool path that the controller reported; nothing real is there to measure")
    for each in replay.steps:
        console.print(f"replay {each.step}: {each.outcome} ({each.detail})")
    for sentence in replay.lost:
        console.print(f"replay: {sentence}")
    console.print(f"twin    {folder / 'object.twin'}\nlog     {folder / 'log'}\npicture {picture}", soft_wrap=True)
    return 0 if not replay.lost and all(each.outcome == ReplayOutcome.SAME for each in replay.steps) else 1


if __name__ == "__main__":
    sys.exit(main())
