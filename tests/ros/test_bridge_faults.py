"""What goes wrong with an arm: it holds still, the reason is told once, and the same bridge goes on."""

import pytest

from benchmarks.fault_rig import FaultRig, loopback_addresses
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
