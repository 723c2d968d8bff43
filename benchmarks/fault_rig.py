"""Emulator and bridge as installed processes, a plan under way, and what is seen of both from outside."""

import itertools
import json
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from egophys_msgs.action import ExecutePlan
from egophys_msgs.msg import TwinInfo
from egophys_ros_common.conversions import plan_message, time_message, world_header
from egophys_ros_common.processes import Client, NodeProcess, wait_until
from egophys_ros_common.qos import latched
from rcl_interfaces.msg import Log
from rclpy.action.client import ClientGoalHandle
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import Trigger

from egophys_core.robot import Calibration, Transform
from egophys_core.waypoint_plan import NANOSECONDS, WaypointPlan

BRIDGE = "/bridge_node"
CONFIG = Path(__file__).resolve().parents[1] / "ros2_ws/src/xarm_bridge/config"
UNDER_WAY = 0.05
"""Share of the long plan after which something goes wrong."""
MOTION = {"move_line", "move_lineb", "move_joint", "move_jointb", "move_home", "move_line_tool"}
MOTION |= {"move_servoj", "move_servo_cart", "move_relative"}
"""The emulator's names of commands that move the arm."""


def plan_through(positions: list[list[float]], times: list[float], twin_id: str = "") -> WaypointPlan:
    """Waypoints in the world, gripper down and half open."""
    return WaypointPlan(
        times=np.array(times),
        positions=np.array(positions),
        quaternions=np.tile([1.0, 0.0, 0.0, 0.0], (len(times), 1)),
        gripper_opening=np.full(len(times), 0.05),
        twin_id=twin_id,
        predicted_cost=0.0,
    )


SHORT = plan_through([[-0.1, 0.0, 0.12], [-0.1, 0.05, 0.12]], [0.0, 0.6])
LONG = plan_through([[-0.1, 0.0, 0.12], [0.1, 0.2, 0.12]], [0.0, 15.0])


class FaultRig:
    """One bridge in front of one emulator."""

    def __init__(self, client: Client, folder: Path, address: str) -> None:
        """Start both; the bridge is active when this returns."""
        self.client = client
        self.address = address
        self._folder = folder
        self._names = itertools.count()
        self._logged: list[tuple[float, str]] = []
        qos = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._subscription = client.node.create_subscription(Log, "/rosout", self._note, qos)
        self._info = client.node.create_publisher(TwinInfo, "/twin_node/info", latched())
        self._started: list[NodeProcess] = []
        self.emulator = self.start_emulator()
        self.bridge = self.start_bridge()
        client.wait_for_state(BRIDGE, "active")

    def start_emulator(self) -> NodeProcess:
        """Start the emulator; it appends what it was told to the file of the wire."""
        wire = ("--wire", str(self._folder / "wire.jsonl"))
        process = self._start("emulator", "--host", self.address, "--faults-from-stdin", *wire)
        process.wait_for_output("ready on")
        return process

    def start_bridge(self, *remaps: str, **changed: Any) -> NodeProcess:
        """Start a bridge; not to wait for it lets it fail."""
        calibration = str(CONFIG / "world_to_base.yaml")
        values = {"autostart": True, "robot_ip": self.address, "allow_emulator": True, "calibration_file": calibration}
        words = [word for name, value in {**values, **changed}.items() for word in ("-p", f"{name}:={value}")]
        return self._start("bridge_node", "--ros-args", "--params-file", str(CONFIG / "bridge.yaml"), *remaps, *words)

    def close(self) -> None:
        """End what still runs."""
        for process in reversed(self._started):
            if process.alive:
                process.kill()
        self.client.node.destroy_subscription(self._subscription)
        self.client.node.destroy_publisher(self._info)

    def send(self, plan: WaypointPlan, *, age_s: float = 0.0) -> ClientGoalHandle:
        """Send a plan that was made so long ago."""
        stamp = time_message(time.time_ns() - round(age_s * NANOSECONDS))
        return self.client.send_goal(ExecutePlan, f"{BRIDGE}/execute", ExecutePlan.Goal(plan=plan_message(plan, stamp)))

    def begin_long_plan(self) -> ClientGoalHandle:
        """Send the long plan; its handle, once it is under way."""
        shares = [0.0]
        goal = ExecutePlan.Goal(plan=plan_message(LONG, time_message(time.time_ns())))
        handle = self.client.send_goal(
            ExecutePlan, f"{BRIDGE}/execute", goal, lambda each: shares.append(each.progress)
        )
        ended = handle.get_result_async()
        wait_until(lambda: max(shares) > UNDER_WAY or ended.done(), 30, "the plan under way")
        if ended.done():
            raise RuntimeError(f"the plan ended before anything went wrong: {ended.result().result.message}")
        return handle

    def succeeds(self, plan: WaypointPlan) -> bool:
        """Whether a plan is executed."""
        return bool(self.client.result(self.send(plan)).result.success)

    def recovers(self, within_s: float = 30.0) -> bool:
        """Whether a plan is executed before time is up, asked again and again."""
        deadline = time.monotonic() + within_s
        while time.monotonic() < deadline:
            if self.succeeds(SHORT):
                return True
            time.sleep(0.5)
        return False

    def call(self, service: str) -> bool:
        """Call one of the bridge's Trigger services."""
        return bool(self.client.call(Trigger, f"{BRIDGE}/{service}").success)

    def use_twin(self, twin_id: str) -> None:
        """Say, as the twin node would, which twin is in use."""
        self._info.publish(TwinInfo(header=world_header(), twin_id=twin_id))

    def told(self, since: float, reason: str) -> list[str]:
        """Warnings and errors of bridges since a time; waits until one has the reason in it, or time is up."""

        def texts() -> list[str]:
            return [text for stamp, text in self._logged if stamp >= since]

        deadline = time.monotonic() + 5.0
        while not any(reason in text for text in texts()) and time.monotonic() < deadline:
            time.sleep(0.1)
        return texts()

    def wire(self, since: float, until: float) -> list[dict[str, Any]]:
        """What the emulator was told between two times."""
        time.sleep(1.2)  # it flushes each second
        lines = (self._folder / "wire.jsonl").read_text().splitlines()
        every = [json.loads(line) for line in lines if line.endswith("}")]
        return [line for line in every if since <= line["t"] <= until]

    def only_followed(self, plan: WaypointPlan, since: float, until: float) -> bool:
        """Whether the arm was streamed between two times, and only along the line of a plan of two waypoints."""
        world_to_base = Calibration.load(CONFIG / "world_to_base.yaml")
        first, last = (
            1000.0 * world_to_base.tcp_in_base(Transform.from_quaternion(*pose)).translation
            for pose in zip(plan.positions, plan.quaternions, strict=True)
        )
        along = (last - first) / np.linalg.norm(last - first)
        targets = np.array([line["target_mm"] for line in commanded(self.wire(since, until))]).reshape(-1, 3)
        aside = np.linalg.norm(np.cross(targets - first, along), axis=1)
        return len(targets) > 0 and bool(aside.max() < 0.1)

    def _start(self, executable: str, *arguments: str) -> NodeProcess:
        log = self._folder / f"{next(self._names)}_{executable}.txt"
        self._started.append(NodeProcess("xarm_bridge", executable, list(arguments), log))
        return self._started[-1]

    def _note(self, message: Log) -> None:
        if message.level >= Log.WARN and "bridge_node" in message.name:
            self._logged.append((message.stamp.sec + 1e-9 * message.stamp.nanosec, message.msg))


def commanded(wire: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Those of the commands that moved the arm."""
    return [line for line in wire if line["name"] in MOTION and line["accepted"]]


def moved(wire: list[dict[str, Any]]) -> float:
    """Metres that the tool was moved meanwhile."""
    places = [line["tool_mm"] for line in wire]
    return float(np.ptp(np.array(places), axis=0).max()) / 1000.0 if places else 0.0


def loopback_addresses() -> Callable[[], str]:
    """Addresses of this process alone, one a call."""
    numbers = itertools.count(2)
    return lambda: f"127.{101 + os.getpid() // 256 % 100}.{os.getpid() % 256}.{next(numbers)}"


def of_another_twin(plan: WaypointPlan) -> WaypointPlan:
    """A plan that was made with a twin that is not in use."""
    return replace(plan, twin_id="0123456789abcdef")
