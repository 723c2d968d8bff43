"""Thousands of random requests against the registers, without sockets."""

import math
import struct

import numpy as np
import pytest
from xarm.core.config.x_config import XCONF
from xarm_bridge.emulator.controller import Controller
from xarm_bridge.emulator.devices import Devices
from xarm_bridge.emulator.gripper import Gripper
from xarm_bridge.emulator.holding import HoldingRegisters
from xarm_bridge.emulator.names import NAMES
from xarm_bridge.emulator.registers import answer
from xarm_bridge.emulator.report import normal_report, real_report, rich_report
from xarm_bridge.kinematics import Pose

LIMITS = np.array(XCONF.Robot.JOINT_LIMITS[6][6])
ODD = [0.0, -0.0, 1e-40, -1.0, 1e5, 1e6, 3e38, -3e38, math.inf, -math.inf, math.nan]


def make_devices():
    return Devices(
        serial="", controller=Controller(Pose.from_wire((300.0, 0.0, 300.0, math.pi, 0.0, 0.0))), gripper=Gripper()
    )


def random_request(rng, controller):
    """A register and parameters: what moves the arm often, well formed or not."""
    if rng.random() < 0.3:  # make it ready again, in some mode
        mode = bytes([rng.choice([0, 0, 1, 4, 5])])
        return [(16, b""), (11, b"\x08\x01"), (50, b"\0"), (59, b"\0"), (19, mode), (12, b"\0")]
    if rng.random() < 0.1:
        return [(int(rng.integers(256)), rng.bytes(rng.integers(80)))]
    tool, joints = np.array(controller.arm.tool.to_wire()), controller.arm.joints
    near = tool + rng.normal(size=6) * [60, 60, 60, 0.4, 0.4, 0.4] * 10 ** rng.uniform(-2, 0.5)
    turned = [*(joints + rng.normal(size=6) * 10 ** rng.uniform(-2, 0.5)), 0.0]
    pace, flags = [rng.uniform(0, 2000), rng.uniform(0, 50000), 0.0], bytes(rng.integers(2, size=3, dtype=np.uint8))
    choices = {
        21: ([*near, *pace, -1.0], flags),
        23: ([*turned, rng.uniform(0, 4), rng.uniform(0, 20), 0.0], b""),
        25: ([1.0, 10.0, 0.0], b""),
        26: ([rng.uniform(0, 0.2)], b""),
        27: ([*near, *(near + rng.normal(size=6) * [30, 30, 30, 0.2, 0.2, 0.2]), *pace, rng.uniform(0, 200)], flags),
        29: (turned + [0.0] * 3, b""),
        30: ([*(tool + rng.normal(size=6) * [3, 3, 3, 0.1, 0.1, 0.1]), *pace], b""),
        35: ([*(rng.normal(size=6) * [50, 50, 100, 1, 1, 1])], b""),
        47: ([rng.uniform(0, 1000)], b""),
        48: ([rng.uniform(0, 4)], b""),
        50: ([], flags[:1]),
        52: ([], struct.pack("<6i", *rng.integers(-900, 900, 6))),
        58: (list(np.sort(rng.uniform(-7, 7, (7, 2))).ravel()), b""),
        59: ([], flags[:1]),
        81: ([*(rng.normal(size=7) * 2)], flags[:1] + struct.pack("<f", rng.uniform(-1, 2))),
        82: ([*(rng.normal(size=6) * [300, 300, 300, 2, 2, 2])], flags[:1]),
        83: ([*(rng.normal(size=7) * 10 ** rng.uniform(-2, 2)), *pace, -1.0], flags),
    }
    register = int(rng.choice(list(choices)))
    values, tail = choices[register]
    if values and rng.random() < 0.1:
        values[rng.integers(len(values))] = rng.choice(ODD)
    return [(register, struct.pack(f"<{len(values)}f", *values) + tail)]


@pytest.mark.filterwarnings("error")
def test_random_requests_leave_a_sound_arm_inside_its_limits():
    rng = np.random.default_rng(0)
    devices = make_devices()
    controller, now, moved, tried = devices.controller, 0.0, 0.0, 0
    while tried < 10_000:
        for register, params in random_request(rng, controller):
            tried += 1
            status, reply, _ = answer(devices, register, params)
            assert 0 <= status < 256
            assert len(reply) < 1024
        before = controller.arm.joints
        now += rng.exponential(0.03)
        controller.advance(now)
        moved += np.abs(controller.arm.joints - before).max()
        assert np.all(controller.arm.joints >= LIMITS[:, 0])
        assert np.all(controller.arm.joints <= LIMITS[:, 1])
        assert np.isfinite(controller.arm.tool.to_wire()).all()
        frames = normal_report(controller), rich_report(controller, 1), real_report(controller)
        assert [len(frame) for frame in frames] == [145, 587, 135]
    assert moved > 10, "the requests must move the arm to try anything"


def test_what_is_not_emulated_is_named_once_as_the_sdk_names_it(caplog):
    registers = {name.lower(): number for name, number in vars(XCONF.UxbusReg).items() if isinstance(number, int)}
    assert {name: number for number, name in NAMES.items()} == registers
    devices = make_devices()
    for register in (71, 71, 250, 37, 37):
        answer(devices, register, b"")
    holding = HoldingRegisters()
    for _ in range(2):
        holding.answer(struct.pack(">BHH", 1, 0, 8))
        holding.answer(struct.pack(">BHH", 3, 0x20, 1))
    assert caplog.messages == [
        "register 71 (set_timer) is not emulated",
        "register 250 is not emulated",
        "register 37 (set_collis_sens) is accepted without effect",
        "Modbus function 1 (read_coil_bits) is not emulated",
        "Modbus holding register 32 is not emulated",
    ]
