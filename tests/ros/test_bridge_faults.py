"""What goes wrong with an arm: it holds still, the reason is told once, and the same bridge goes on."""

import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped

from benchmarks.fault_rig import BRIDGE, SHORT, FaultRig, loopback_addresses
from benchmarks.faults import FAULTS, meet

pytestmark = pytest.mark.ros

next_address = loopback_addresses()


@pytest.fixture
def rig(client, tmp_path):
    made = FaultRig(client, tmp_path, next_address())
    yield made
    made.close()


@pytest.mark.parametrize("fault", FAULTS, ids=[fault.name for fault in FAULTS])
def test_the_arm_holds_still_and_goes_on(rig, fault):
    outcome = meet(fault, rig)
    assert outcome.held_still
    assert outcome.reason_published_once, outcome.published
    assert outcome.recovered_without_restart == fault.same_process


def test_a_stall_is_an_error_of_the_node_until_tool_poses_come_again(rig, client):
    def is_fault(message):
        (status,) = message.status
        return status.level == DiagnosticStatus.ERROR and "controller lost" in status.message

    def is_sound(message):
        (status,) = message.status
        return status.name == BRIDGE and status.level == DiagnosticStatus.OK

    rig.emulator.say("silence=3")
    client.message(DiagnosticArray, "/diagnostics", is_fault)
    assert "controller lost" in client.result(rig.send(SHORT)).result.message
    client.message(DiagnosticArray, "/diagnostics", is_sound)
    before = time.time()
    client.message(PoseStamped, f"{BRIDGE}/tool_pose", lambda pose: pose.header.stamp.sec >= int(before))
    assert client.result(rig.send(SHORT)).result.success
