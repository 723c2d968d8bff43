"""The client of scripts and tests, against an action server in this process."""

import sys
import threading
import time

import pytest
import rclpy
import rclpy.action.client
from action_msgs.msg import GoalStatus
from egophys_msgs.action import BuildTwin
from egophys_ros_common.qos import latched
from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from std_msgs.msg import String

pytestmark = pytest.mark.ros

ACTION = "/answers_at_once"
SHORT_SUBSCRIPTIONS = 300


@pytest.fixture
def waiting_server():
    """An action server that works on a goal until it is canceled and answers everything at once."""
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("waiting_server", context=context)

    test_ended = threading.Event()

    def work(goal):
        while not goal.is_cancel_requested and not test_ended.wait(0.01):
            pass
        (goal.canceled if goal.is_cancel_requested else goal.abort)()
        return BuildTwin.Result()

    server = ActionServer(
        node,
        BuildTwin,
        ACTION,
        work,
        cancel_callback=lambda _: CancelResponse.ACCEPT,
        callback_group=ReentrantCallbackGroup(),
    )
    executor = MultiThreadedExecutor(context=context)
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    yield
    test_ended.set()
    executor.shutdown()
    thread.join()
    server.destroy()
    node.destroy_node()
    rclpy.try_shutdown(context=context)


def test_an_answer_that_comes_before_its_request_is_noted_is_not_lost(waiting_server, client, monkeypatch):
    expected = rclpy.action.client.Future

    def noted_late():
        """Made by rclpy between sending a request and expecting its answer."""
        time.sleep(0.5)
        return expected()

    monkeypatch.setattr(rclpy.action.client, "Future", noted_late)
    handle = client.send_goal(BuildTwin, ACTION, BuildTwin.Goal())
    assert handle.accepted
    assert len(client.cancel(handle).goals_canceling) == 1
    assert client.result(handle).status == GoalStatus.STATUS_CANCELED


def test_the_client_outlives_subscriptions_that_end_while_it_turns_to_them(client):
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)  # the threads meet amid rclpy's preparations, as they do on a busy machine
    try:
        for _ in range(SHORT_SUBSCRIPTIONS):
            with pytest.raises(TimeoutError, match="0 of 1 such messages"):
                client.messages(String, "/nobody_publishes", 1, timeout=0.0)
    finally:
        sys.setswitchinterval(interval)
    publisher = client.node.create_publisher(String, "/somebody_publishes", latched())
    publisher.publish(String(data="heard"))
    assert client.message(String, "/somebody_publishes", qos=latched()).data == "heard"
