"""Starts emulators and connects arms to them; ends both after each test."""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import pytest
from xarm.wrapper import XArmAPI

from egophys_core.robot import PlanExecutor
from tests.xarm_bridge.emulator_process import (
    CALIBRATION,
    LIMITS,
    PACKAGE,
    TOOL_DOWN,
    EmulatorProcess,
    loopback_addresses,
    wait_until,
)

sys.path.insert(0, str(PACKAGE))  # a plain checkout; an installed workspace is not needed here

from xarm_bridge.xarm6 import XArm6

ADDRESSES = loopback_addresses()


@dataclass(frozen=True)
class Arm:
    """A connected driver and what executes plans with it."""

    driver: XArm6
    executor: PlanExecutor


def arm_at(host: str) -> Arm:
    driver = XArm6(host)
    driver.connect()
    return Arm(driver, PlanExecutor(driver, calibration=CALIBRATION, limits=LIMITS))


NEAR_THE_PLANS = ("--start", "450", "20", "272", "180", "0", "17.2")
"""Flange pose where the tool is at world (0, 0, 0.1): short approaches make short tests."""


@pytest.fixture
def start_emulator() -> Iterator[Callable[..., EmulatorProcess]]:
    started: list[EmulatorProcess] = []

    def start(*arguments: str) -> EmulatorProcess:
        where = () if "--start" in arguments else NEAR_THE_PLANS
        started.append(EmulatorProcess(next(ADDRESSES), (*where, *arguments)))
        return started[-1]

    yield start
    for process in started:
        process.close()


@pytest.fixture(scope="module")
def shared_emulator() -> Iterator[EmulatorProcess]:
    """One for all tests of a module, ten times faster than life; each test leaves it running."""
    process = EmulatorProcess(next(ADDRESSES), ("--speedup", "10"))
    yield process
    process.close()


@pytest.fixture(scope="module")
def shared_arm() -> Iterator[Arm]:
    """An arm on a sound emulator, for tests that leave both in order."""
    process = EmulatorProcess(next(ADDRESSES), NEAR_THE_PLANS)
    arm = arm_at(process.host)
    yield arm
    arm.driver.close()
    process.close()


@pytest.fixture
def connect_api() -> Iterator[Callable[..., XArmAPI]]:
    """Connects the unchanged SDK."""
    opened: list[XArmAPI] = []

    def connect(emulator: EmulatorProcess, **options: Any) -> XArmAPI:
        opened.append(XArmAPI(emulator.host, is_radian=True, **options))
        return opened[-1]

    yield connect
    for api in opened:
        api.disconnect()


@pytest.fixture
def connect_arm() -> Iterator[Callable[..., Arm]]:
    opened: list[Arm] = []

    def connect(emulator: EmulatorProcess) -> Arm:
        opened.append(arm_at(emulator.host))
        return opened[-1]

    yield connect
    for arm in opened:
        arm.driver.close()


@pytest.fixture(scope="module")
def shared_api(shared_emulator: EmulatorProcess) -> Iterator[XArmAPI]:
    api = XArmAPI(shared_emulator.host, is_radian=True)
    yield api
    api.disconnect()


@pytest.fixture
def ready(shared_api: XArmAPI) -> XArmAPI:
    """A connected arm in position mode at a known pose, whatever the test before did to it."""
    api = shared_api
    assert [api.clean_error(), api.motion_enable(True), api.set_tcp_offset([0] * 6)] == [0, 0, 0]
    assert [api.set_mode(0), api.set_state(0)] == [0, 0]
    wait_until(lambda: api.error_code == 0 and api.mode == 0, 5, "a report of the reset")
    assert api.set_position(300, 0, 300, *TOOL_DOWN, speed=1000, wait=True) == 0
    return api
