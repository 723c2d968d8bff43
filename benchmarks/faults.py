"""What goes wrong with an arm, one after another: does it hold still, is the reason told once, does it go on?"""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from egophys_ros_common.processes import Client
from lifecycle_msgs.msg import Transition

from benchmarks.fault_rig import (
    BRIDGE,
    CONFIG,
    LONG,
    SHORT,
    FaultRig,
    commanded,
    loopback_addresses,
    moved,
    of_another_twin,
)

GRACE_S = 1.5
"""After a fault: for what is under way on the wire to be noticed as lost."""
STILL_M = 0.005
"""Servo mode ends at its newest target, which is at most 2.5 mm away."""


@dataclass(frozen=True, kw_only=True)
class FaultScenario:
    """One thing that goes wrong while a plan is executed, unless `cause` says otherwise."""

    name: str
    cause: Callable[[FaultRig], None]
    """Lets it happen; returns once it is over."""
    reason: str
    """What the reason that is published has in it."""
    user: str
    """What the user does to go on."""
    mend: Callable[[FaultRig], Any] = lambda rig: None
    """Does it."""
    goes_on: bool = False
    """The fault concerns another plan or process; the arm goes on with the plan under way, and does nothing else."""
    idle: bool = False
    """No plan is under way."""
    same_process: bool = True
    """The bridge that met the fault is the one that goes on."""
    late_poses: int = 0
    """Poses that it may have been about to send, and sends once it can: each is within 2.5 mm of the one before."""


@dataclass(frozen=True, kw_only=True)
class FaultOutcome:
    """What was seen of it."""

    fault: str
    arm: str
    """What the arm did, where it did what it should."""
    held_still: bool
    """It did; only where another plan was under way it did not stand still but followed that one, and nothing else."""
    reason_published_once: bool
    recovered_without_restart: bool
    published: str
    user: str


def _inject(text: str, seconds: float) -> Callable[[FaultRig], None]:
    def cause(rig: FaultRig) -> None:
        rig.emulator.say(text)
        time.sleep(seconds)

    return cause


def _kill_controller(rig: FaultRig) -> None:
    rig.emulator.kill()
    time.sleep(GRACE_S)


def _restart_controller(rig: FaultRig) -> None:
    rig.emulator.kill()
    rig.emulator = rig.start_emulator()


def _start_controller(rig: FaultRig) -> None:
    rig.emulator = rig.start_emulator()


def _send_another_twins_plan(rig: FaultRig) -> None:
    rig.use_twin("fedcba9876543210")
    time.sleep(1.0)
    rig.client.result(rig.send(of_another_twin(SHORT)))


def _lose_the_transform(rig: FaultRig) -> None:
    for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP):
        assert rig.client.change_state(BRIDGE, transition)
    assert rig.client.set_parameter(BRIDGE, "calibration_file", "/nowhere/world_to_base.yaml").successful
    assert not rig.client.change_state(BRIDGE, Transition.TRANSITION_CONFIGURE)


def _give_the_transform(rig: FaultRig) -> None:
    assert rig.client.set_parameter(BRIDGE, "calibration_file", str(CONFIG / "world_to_base.yaml")).successful
    rig.client.start(BRIDGE)


def _kill_bridge(rig: FaultRig) -> None:
    rig.bridge.kill()
    time.sleep(GRACE_S)


def _start_bridge(rig: FaultRig) -> None:
    rig.bridge = rig.start_bridge()
    rig.client.wait_for_state(BRIDGE, "active")


def _start_second_bridge(rig: FaultRig) -> None:
    second = rig.start_bridge("-r", "__node:=second_bridge_node")
    assert second.wait_for_end() == 1


def _freeze_bridge(rig: FaultRig) -> None:
    rig.bridge.pause()
    time.sleep(3.0)
    rig.bridge.resume()


CLEAR = "calls ~/clear_error, sends the next plan"
NEXT = "sends the next plan"

FAULTS = (
    FaultScenario(
        name="controller killed",
        cause=_kill_controller,
        reason="controller",
        user="starts it again, sends the next plan",
        mend=_start_controller,
    ),
    FaultScenario(name="controller hangs for 3 s", cause=_inject("silence=3", 4.0), reason="no answer", user=NEXT),
    FaultScenario(name="controller restarted", cause=_restart_controller, reason="controller", user=NEXT),
    FaultScenario(
        name="error 31 (collision)",
        cause=_inject("error=31", GRACE_S),
        reason="controller error 31",
        user=CLEAR,
        mend=lambda rig: rig.call("clear_error"),
    ),
    FaultScenario(
        name="stopped at the controller", cause=_inject("stop", GRACE_S), reason="stopped or disabled", user=NEXT
    ),
    FaultScenario(
        name="mode changed from elsewhere (state 5)", cause=_inject("mode=0", GRACE_S), reason="stopped", user=NEXT
    ),
    FaultScenario(name="network cut for 3 s", cause=_inject("cut=3", 5.0), reason="controller", user=NEXT),
    FaultScenario(
        name="~/stop", cause=lambda rig: assert_true(rig.call("stop")), reason="stopped on request", user=NEXT
    ),
    FaultScenario(
        name="stale plan",
        cause=lambda rig: ignore(rig.client.result(rig.send(SHORT, age_s=3600.0))),
        reason="made 3600 s ago",
        user="plans again",
        idle=True,
    ),
    FaultScenario(
        name="plan of another twin",
        cause=_send_another_twins_plan,
        reason="0123456789abcdef",
        user="plans again",
        idle=True,
    ),
    FaultScenario(
        name="second plan",
        cause=lambda rig: ignore(rig.client.result(rig.send(LONG))),
        reason="another plan is being executed",
        user="waits, or cancels the first",
        goes_on=True,
    ),
    FaultScenario(
        name="second bridge",
        cause=_start_second_bridge,
        reason="is driven by",
        user="ends one of them",
        goes_on=True,
    ),
    FaultScenario(
        name="transform missing",
        cause=_lose_the_transform,
        reason="world_to_base.yaml",
        user="sets calibration_file, configures and activates again",
        mend=_give_the_transform,
    ),
    FaultScenario(
        name="bridge stands still for 3 s",
        cause=_freeze_bridge,
        reason="plan not executed",
        user=NEXT,
        late_poses=1,
    ),
    FaultScenario(
        name="bridge killed",
        cause=_kill_bridge,
        reason="left the arm without releasing it",
        user="starts it again",
        mend=_start_bridge,
        same_process=False,
    ),
)


def assert_true(value: bool) -> None:
    """Insist on an answer."""
    assert value


def ignore(value: Any) -> None:
    """Want no answer."""


def meet(fault: FaultScenario, rig: FaultRig) -> FaultOutcome:
    """Let a fault happen to a rig that is in order, and look."""
    began = time.time()
    handle = None if fault.idle else rig.begin_long_plan()
    happened = time.time()
    fault.cause(rig)
    time.sleep(GRACE_S)
    until = time.time()
    if fault.goes_on:
        held_still = rig.only_followed(LONG, happened, until)
        rig.client.cancel(handle)
        rig.client.result(handle)
    else:
        wire = rig.wire(happened + GRACE_S, until)
        held_still = len(commanded(wire)) <= fault.late_poses and moved(wire) < STILL_M
    if fault.same_process:
        told = rig.told(began, fault.reason)
        fault.mend(rig)
    else:
        fault.mend(rig)
        told = rig.told(began, fault.reason)
    return FaultOutcome(
        fault=fault.name,
        arm="went on with the first plan" if fault.goes_on else "held still",
        held_still=held_still,
        reason_published_once=len(told) == 1 and fault.reason in told[0],
        recovered_without_restart=rig.recovers() and fault.same_process,
        published="; ".join(told),
        user=fault.user,
    )


def measure() -> list[dict[str, Any]]:
    """All faults, each on a bridge and an emulator of its own."""
    address, rows = loopback_addresses(), []
    for fault in FAULTS:
        client = Client()
        with TemporaryDirectory() as folder:
            rig = FaultRig(client, Path(folder), address())
            try:
                rows.append(asdict(meet(fault, rig)))
            finally:
                rig.close()
                client.close()
        print(rows[-1], flush=True)
    return rows
