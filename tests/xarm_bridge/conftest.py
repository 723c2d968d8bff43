"""Starts emulators and connects arms to them; ends both after each test."""

import sys
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from xarm.wrapper import XArmAPI

from tests.xarm_bridge.emulator_process import (
    CALIBRATION,
    LIMITS,
    PACKAGE,
    EmulatorProcess,
    loopback_addresses,
)

sys.path.insert(0, str(PACKAGE))  # a plain checkout; an installed workspace is not needed here

from xarm_bridge.arm import Arm
from xarm_bridge.connection import Connection

ADDRESSES = loopback_addresses()
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
    arm = Arm(Connection(process.host), calibration=CALIBRATION, limits=LIMITS)
    yield arm
    arm.close()
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
        opened.append(Arm(Connection(emulator.host), calibration=CALIBRATION, limits=LIMITS))
        return opened[-1]

    yield connect
    for arm in opened:
        arm.close()
