"""A plan that is sent to a bridge is executed or an error says why not, whatever of its answers is lost."""

import itertools
from uuid import uuid4

import pytest
import rclpy
from egophys_msgs.action import ExecutePlan
from egophys_msgs.msg import WaypointPlan
from egophys_ros_common import arm_client
from egophys_ros_common.arm_client import ArmClient, PlanExecution
from egophys_ros_common.goal_server import GoalServer
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.worker import CanceledError
from rclpy.action.client import ClientGoalHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from unique_identifier_msgs.msg import UUID

from egophys_core.errors import RobotError

pytestmark = pytest.mark.ros

NAME = "/lonely_bridge/execute"


class Bridge(ManagedNode):
    """Executes one plan at a time, which lasts until `release` or a cancellation; `forgets` goals it has accepted."""

    def __init__(self):
        super().__init__("lonely_bridge")
        self.forgets = 0
        self.begun = 0
        self.release = True
        self.end = None
        GoalServer(self, ExecutePlan, NAME, noun="plan", begin=self._begin, run=self._work, cancel=self._cancel)
        accept = self.server._handle_accepted_callback

        def accept_or_forget(handle):
            self.forgets -= 1
            if self.forgets < 0:
                accept(handle)

        self.server.register_handle_accepted_callback(accept_or_forget)

    def own(self, entity, destroy):
        self.server = entity
        return super().own(entity, destroy)

    def _begin(self, handle):
        if self.end is not None:
            raise RobotError("the arm is busy")
        self.end = Future()
        if self.release:
            self.end.set_result(True)
        self.begun += 1
        return handle

    async def _work(self, job, handle):
        succeeded = await self.end
        self.end = None
        (handle.succeed if succeeded else handle.canceled)()
        return ExecutePlan.Result(success=succeeded, message="done" if succeeded else "it stands")

    def _cancel(self):
        self.end.set_result(False)
        return True


class Sender(ManagedNode):
    """Has an arm client."""

    def __init__(self):
        super().__init__("sender")
        self.declare_parameter("execute_action", NAME)
        self.arm = ArmClient(self)


@pytest.fixture
def world(monkeypatch):
    """Bridge, sender, and their executor."""
    monkeypatch.setattr(arm_client, "ANSWER_S", 1.0)
    rclpy.init()
    executor = SingleThreadedExecutor()
    nodes = Bridge(), Sender()
    for each in nodes:
        executor.add_node(each)
    meet(executor, nodes[1].arm)
    yield *nodes, executor
    executor.shutdown()
    for each in nodes:
        each.close()
        each.destroy_node()
    rclpy.shutdown()


def spin_until(executor, condition):
    for _ in range(1000):
        if condition():
            return
        executor.spin_once(0.02)
    raise AssertionError("it did not happen in 20 s")


def meet(executor, arm):
    """Spin until the bridge's answers reach the client: it is found by its client before it has found that client."""
    spin_until(executor, arm.action.server_is_ready)
    answers = []

    def is_answered():
        stranger = UUID(uuid=list(uuid4().bytes))
        answers.append(ClientGoalHandle(arm.action, stranger, None).cancel_goal_async())
        return any(answer.done() for answer in answers)

    spin_until(executor, is_answered)


def lose_answers(arm, monkeypatch, numbers):
    """Have some answers to goals, counted from 0, not reach the client."""
    take, count = arm.action.take_data, itertools.count()

    def take_all_but_some():
        data = take()
        if "goal" in data and next(count) in numbers:
            del data["goal"]
        return data

    monkeypatch.setattr(arm.action, "take_data", take_all_but_some)


def sent(executor, sender):
    execution = PlanExecution(sender.arm)
    return execution, executor.create_task(execution.run(WaypointPlan()))


def begun(bridge, sender, executor):
    """As `sent`, of a plan that lasts, once the bridge executes it."""
    bridge.release = False
    execution, task = sent(executor, sender)
    spin_until(executor, lambda: bridge.begun == 1)
    return execution, task


def ended(executor, task):
    spin_until(executor, task.done)
    return task.result()


def test_a_plan_that_was_accepted_and_never_begun_is_sent_again(world, monkeypatch):
    bridge, sender, executor = world
    bridge.forgets = 1
    lose_answers(sender.arm, monkeypatch, [0])
    _, task = sent(executor, sender)
    assert ended(executor, task).message == "done"
    assert bridge.begun == 1


def test_a_plan_that_began_unheard_is_stopped_and_not_begun_again(world, monkeypatch):
    bridge, sender, executor = world
    bridge.release = False
    lose_answers(sender.arm, monkeypatch, [0])
    _, task = sent(executor, sender)
    with pytest.raises(RobotError, match=f"{NAME} did not say within .* look after the arm"):
        ended(executor, task)
    assert bridge.begun == 1
    spin_until(executor, lambda: bridge.end is None)


def test_to_cancel_what_was_never_begun_leaves_the_arm_to_whom_it_serves(world, monkeypatch):
    bridge, sender, executor = world
    lose_answers(sender.arm, monkeypatch, [1])
    _, first = begun(*world)
    bridge.forgets = 1
    _, second = sent(executor, sender)
    with pytest.raises(RobotError, match="the arm is busy"):
        ended(executor, second)
    assert not first.done()
    bridge.end.set_result(True)
    assert ended(executor, first).success


def test_a_bridge_that_never_answers_is_an_error(world, monkeypatch):
    bridge, sender, executor = world
    bridge.forgets = 100
    lose_answers(sender.arm, monkeypatch, range(100))
    _, task = sent(executor, sender)
    with pytest.raises(RobotError, match="did not say"):
        ended(executor, task)
    assert bridge.begun == 0


def test_a_plan_is_canceled(world):
    execution, task = begun(*world)
    execution.cancel()
    with pytest.raises(CanceledError, match="it stands"):
        ended(world[-1], task)


def test_a_bridge_that_goes_is_an_error(world):
    bridge, _, executor = world
    _, task = begun(*world)
    bridge.close()
    with pytest.raises(RobotError, match="has gone while it had the plan"):
        ended(executor, task)
