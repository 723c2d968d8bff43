"""The world of the loop that asks for motions: the arm does them with the object that its observer sees."""

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from functools import partial

from egophys_msgs.action import ExecutePlan
from egophys_msgs.msg import WaypointPlan
from egophys_ros_common.arm_client import ArmClient, PlanExecution
from egophys_ros_common.conversions import plan_message
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.parameters import declare_names, declare_number
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import PointCloud2

from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError
from egophys_core.experiments import HandLimits, Proposal
from egophys_core.planning import grasp_from_points
from egophys_core.twin import Twin
from egophys_twin.asked_motion import Placement, placement, plan_that_lets_go, points_at_rest
from egophys_twin.diagnosis import DoMotion, Tell
from egophys_twin.episode_parameters import recorded_name
from egophys_twin.executions import execution_episode, measured_path
from egophys_twin.seen_object import ObjectRecording

EXECUTE = {
    "execute_action": ("bridge_node/execute", "ExecutePlan action of the bridge, for motions that a diagnosis asks for")
}
LIMITS = {
    "ask_max_speed_m_s": (0.25, 0.02, 1.0, "how fast the tool moves in a motion that a diagnosis asks for, m/s"),
    "ask_max_turn_rad_s": (1.0, 0.05, 3.0, "how fast the tool turns about the vertical in such a motion, rad/s"),
    "ask_highest_m": (
        0.34,
        0.05,
        2.0,
        "how high above the table the tool goes in such a motion, m; the arm must reach it over all of the object",
    ),
}

POLL_S = 0.2
"""How often a wait looks again."""
SILENCE_S = 10.0
"""An object of which nothing came for so long is not seen."""
RESTS_WITHIN_S = 180.0
"""For an object to come to rest, and a slow observer to show that."""
KEPT = 100
"""Messages that wait for a busy executor."""


def declare_arm(node: ManagedNode) -> None:
    """Declare which arm does motions that are asked for, and its limits, which are read for each request."""
    declare_names(node, EXECUTE)
    for name, (default, low, high, doc) in LIMITS.items():
        declare_number(node, name, default, low=low, high=high, doc=doc, at_once=True)


class AskedWorld:
    """Has the arm do motions. They block the worker thread that asks, never the executor's."""

    def __init__(self, node: ManagedNode) -> None:
        """Create the client of the bridge; the node destroys it at cleanup."""
        self._node = node
        self._arm = ArmClient(node)

    def limits(self) -> HandLimits:
        """What the arm may do."""
        fastest, fastest_turn, highest = (float(self._node.get_parameter(name).value) for name in LIMITS)
        return HandLimits(hands=1, fastest_m_s=fastest, fastest_turn_rad_s=fastest_turn, highest_m=highest)

    def require_bridge(self) -> None:
        """Check that there is an arm.

        Raises:
            RobotError: no bridge is there.
        """
        self._arm.require_bridge()

    def of(self, twin: Twin, limits: HandLimits) -> DoMotion:
        """Where motions are done with the object of a twin, within limits."""
        return partial(self._do, twin, limits)

    def _do(self, twin: Twin, limits: HandLimits, proposal: Proposal, number: int, tell: Tell) -> Episode:
        """Have one motion done where the object lies.

        Raises:
            EgophysError: the object is not seen, moves or does not lie as its twin does, or the arm did not do it.
        """
        (asked,), held = proposal.motion.paths, grasp_from_points(twin.grasp)
        with self._listening() as seen:
            pose = self._placement(twin, seen, tell)
            plan = plan_that_lets_go(pose.of(asked), highest=limits.highest_m + twin.ground_height)
            message = plan_message(plan, self._node.get_clock().now().to_msg())
            execution = PlanExecution(self._arm)
            try:
                executed = self._begin(execution, message)
                self._wait(executed.done, partial(tell, f"motion {number}: {proposal.motion.sentence}"))
            except BaseException:
                self._node.hand_over(execution.cancel)
                raise
            # What comes after it lets the object go; that is no part of the motion.
            path = measured_path(executed.result().executed, source=f"motion {number}").until(proposal.motion.duration)
            end = int(path.stamps_ns[-1]) if len(path.stamps_ns) else 0
            self._wait(
                lambda: seen.newest_ns() >= end or seen.silent_s() > SILENCE_S,
                partial(tell, f"motion {number}: what was seen of it comes in"),
            )
            frames = path.frames(seen.records())
        if len(frames) < 2:
            raise EpisodeError(
                f"motion {number} was done, but no points on {seen.topic} came meanwhile; keep its observer running"
            )
        return execution_episode(
            path,
            frames,
            held,
            name=f"asked_motion_{number}",
            object_topic=seen.topic,
            ground_height=twin.ground_height,
        )

    def _begin(self, execution: PlanExecution, plan: WaypointPlan) -> Future[ExecutePlan.Result]:
        """Begin to execute a plan; what it ends with, for a worker's thread."""
        executed: Future[ExecutePlan.Result] = Future()

        async def run() -> None:
            try:
                executed.set_result(await execution.run(plan))
            except Exception as error:
                executed.set_exception(error)

        self._node.hand_over(lambda: self._node.executor.create_task(run))
        return executed

    def _placement(self, twin: Twin, seen: ObjectRecording, tell: Tell) -> Placement:
        """How the object lies, once it is at rest."""
        begun, deadline = self._node.get_clock().now().nanoseconds, time.monotonic() + RESTS_WITHIN_S
        reason = ""

        def is_over() -> bool:
            nonlocal reason
            try:
                points_at_rest(seen.frames(begun))
            except EpisodeError as error:
                reason = str(error)
                return seen.silent_s() > SILENCE_S or time.monotonic() > deadline
            reason = ""
            return True

        self._wait(is_over, partial(tell, "wait until the object is at rest"))
        if reason:
            raise EpisodeError(f"{seen.topic}: {reason}; an arm can only take what its observer sees at rest")
        return placement(twin, points_at_rest(seen.frames(begun)))

    def _wait(self, is_over: Callable[[], bool], tell: Callable[[], None]) -> None:
        """Wait on a worker's thread; `tell` may raise, to stop that."""
        while not is_over():
            tell()
            time.sleep(POLL_S)

    @contextmanager
    def _listening(self) -> Iterator[ObjectRecording]:
        """What is published of the object meanwhile."""
        seen = ObjectRecording(recorded_name(self._node, "object_topic"))
        qos = QoSProfile(depth=KEPT, reliability=ReliabilityPolicy.BEST_EFFORT)
        subscriptions: list[Subscription] = []

        def begin() -> None:
            subscriptions.append(self._node.create_subscription(PointCloud2, seen.topic, seen.take, qos, raw=True))

        def end() -> None:
            while subscriptions:
                self._node.destroy_subscription(subscriptions.pop())

        self._node.hand_over(begin)
        try:
            yield seen
        finally:
            self._node.hand_over(end)
