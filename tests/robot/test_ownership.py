"""One owner of an arm at a time, of this machine or another; a killed one's note does not stand for ever."""

import itertools
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from egophys_core.errors import RobotError
from egophys_core.robot import ArmTakenError, Ownership
from tests.robot.second_arm import NOTES, SecondArm

numbers = itertools.count()


@pytest.fixture
def address():
    return f"box{os.getpid()}-{next(numbers)}"


def connected(address):
    driver = SecondArm(address)
    driver.connect()
    return driver


def owner(address, machine="here"):
    """An ownership as of a process on a machine; the lock file tells machines apart."""
    return Ownership(connected(address), f"{address}-{machine}", f"/{machine}/bridge_node")


def rest(seconds):
    """Time passes, and nobody does anything."""


def test_another_machine_is_told_who_has_it_until_it_is_released(address):
    first, second = owner(address, "lab"), owner(address, "office")
    first.acquire(sleep=rest)
    assert first.is_seen_elsewhere
    with pytest.raises(ArmTakenError, match=r"is driven by /lab/bridge_node \(process \d+ on"):
        second.acquire(sleep=lambda seconds: first.renew())
    first.release()
    assert NOTES[address] == [0] * 32
    second.acquire(sleep=rest)
    assert second.abandoned_by == ""


def test_who_was_killed_is_followed(address):
    killed, next_one = owner(address, "lab"), owner(address, "office")
    killed.acquire(sleep=rest)
    next_one.acquire(sleep=rest)
    assert next_one.abandoned_by.startswith("/lab/bridge_node")
    with pytest.raises(ArmTakenError, match="/office/bridge_node"):
        killed.renew()  # it was only asleep


def test_of_two_that_come_at_once_one_owns(address):
    first, second = owner(address, "lab"), owner(address, "office")

    def meanwhile(seconds):
        second.acquire(sleep=rest)

    with pytest.raises(ArmTakenError, match="/office/bridge_node"):
        first.acquire(sleep=meanwhile)
    second.renew()


def test_a_box_that_was_started_anew_is_told_again(address):
    first = owner(address)
    first.acquire(sleep=rest)
    NOTES[address][:] = [0] * 32
    first.renew()
    with pytest.raises(ArmTakenError):
        owner(address, "office").acquire(sleep=lambda seconds: first.renew())


def test_an_owner_that_slept_too_long_may_not_move(address, monkeypatch):
    first = owner(address)
    with pytest.raises(ArmTakenError, match="has not told"):
        first.require()
    first.acquire(sleep=rest)
    first.require()
    now = time.monotonic()
    monkeypatch.setattr("egophys_core.robot.ownership.time.monotonic", lambda: now + 10.0)
    with pytest.raises(ArmTakenError, match=r"has not told .* for 1\d\.\d s"):
        first.require()


def test_a_box_without_notes_is_locked_on_this_machine_only(address):
    class Forgetful(SecondArm):
        def read_note(self, size):
            raise RobotError("no such registers")

    driver = Forgetful(address)
    first = Ownership(driver, address, "first")
    first.acquire(sleep=rest)
    assert not first.is_seen_elsewhere
    first.renew()
    with pytest.raises(ArmTakenError, match="another process of this machine"):
        Ownership(driver, address, "second").acquire(sleep=rest)
    first.release()
    Ownership(driver, address, "third").acquire(sleep=rest)


HOLD = """
import sys
from egophys_core.robot import Ownership
from tests.robot.second_arm import SecondArm
driver = SecondArm(sys.argv[1]); driver.connect()
Ownership(driver, sys.argv[1], "holder").acquire(sleep=lambda seconds: None)
print("held", flush=True); sys.stdin.read()
"""


def test_the_lock_of_a_killed_process_is_free(address):
    root = Path(__file__).resolve().parents[2]
    command = [sys.executable, "-c", HOLD, address]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "cwd": root}
    with subprocess.Popen(command, **pipes) as holder:
        assert holder.stdout.readline() == "held\n"
        mine = Ownership(connected(address), address, "mine")
        with pytest.raises(ArmTakenError, match="another process of this machine"):
            mine.acquire(sleep=rest)
        holder.kill()
    mine.acquire(sleep=rest)
