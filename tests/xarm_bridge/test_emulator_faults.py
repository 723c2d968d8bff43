"""Faults of the controller and the network, as a connected SDK meets them."""

import itertools
import json
import socket

import numpy as np
import pytest

from tests.xarm_bridge.emulator_process import TOOL_DOWN as DOWN
from tests.xarm_bridge.emulator_process import wait_until

FIVE_MM_ON = [305.0, 0.0, 300.0, *DOWN]


@pytest.fixture
def faulty(start_emulator):
    return start_emulator("--faults-from-stdin", "--start", "300", "0", "300", "180", "0", "0")


@pytest.fixture
def servoing(faulty, connect_api):
    """An arm in servo mode that was just told to go 5 mm further."""
    api = connect_api(faulty)
    assert [api.motion_enable(True), api.set_mode(1), api.set_state(0)] == [0, 0, 0]
    wait_until(lambda: api.mode == 1, 5, "mode 1 in the reports")
    assert api.set_servo_cartesian(FIVE_MM_ON) == 0
    return api


def test_a_hung_controller_answers_again(faulty, servoing):
    servoing.set_timeout(0.3)
    reports = []
    servoing.register_report_callback(lambda _: reports.append(None))
    assert faulty.inject("silence=1.5") == "fault silence=1.5\n"
    reports.clear()
    assert servoing.set_state(4) == 3
    assert len(reports) <= 1, "a hung box is silent on all ports; one report may have been on its way"
    wait_until(lambda: servoing.get_state()[0] == 0, 10, "an answer")
    assert servoing.get_state() == (0, 2), "the stop was lost, not carried out late"
    np.testing.assert_allclose(servoing.get_position()[1][:3], FIVE_MM_ON[:3], atol=1e-3)
    wait_until(lambda: reports, 5, "a report")


def test_a_cut_network_comes_back_without_the_old_connections(faulty, servoing, connect_api):
    assert faulty.inject("cut=1.5") == "fault cut=1.5\n"
    with pytest.raises(TimeoutError):
        socket.create_connection((faulty.host, 502), timeout=0.3)
    servoing.set_timeout(0.3)
    assert servoing.set_state(4) == 3
    assert servoing.connected, "nobody tells that the cable is out"
    wait_until(lambda: not servoing.connected, 10, "the reset of the old connection")
    later = connect_api(faulty)
    assert later.get_state() == (0, 2), "the stop never reached the box"
    np.testing.assert_allclose(later.get_position()[1][:3], FIVE_MM_ON[:3], atol=1e-3)


def test_others_meddle_with_the_controller(faulty, servoing):
    wait_until(lambda: servoing.get_state() == (0, 2), 5, "arrival")
    for fault, state, error in [("stop", 4, 0), ("mode=0", 5, 0), ("error=31", 4, 31)]:
        servoing.clean_error()
        servoing.set_state(0)
        assert servoing.get_state() == (0, 2)
        assert faulty.inject(fault) == f"fault {fault}\n"
        assert servoing.get_state() == (0, state)
        assert servoing.get_err_warn_code() == (0, [error, 0])
    wait_until(lambda: servoing.mode == 0, 5, "the mode set by others")
    assert faulty.inject("error=0").startswith("refused: ")
    assert faulty.alive


def test_the_wire_file_tells_what_was_commanded_and_done(start_emulator, connect_api, tmp_path):
    wire = tmp_path / "wire.jsonl"
    emulator = start_emulator("--wire", str(wire), "--faults-from-stdin", "--start", "300", "0", "300", "180", "0", "0")
    api = connect_api(emulator)
    api.motion_enable(True)
    api.set_state(0)
    assert api.set_position(y=5, wait=True) == 0
    api.set_mode(1)
    api.set_state(0)
    wait_until(lambda: api.mode == 1, 5, "mode 1 in the reports")
    assert api.set_servo_cartesian(FIVE_MM_ON) == 0
    assert api.set_servo_cartesian([340, 0, 300, *DOWN]) == 0, "too far: not executed, and nobody is told"
    wait_until(lambda: api.get_state() == (0, 2), 5, "arrival")
    emulator.inject("error=31")
    api.get_state()
    assert emulator.interrupt() == 0
    lines = [json.loads(line) for line in wire.read_text().splitlines()]
    assert [line["t"] for line in lines] == sorted(line["t"] for line in lines)
    line = next(line for line in lines if line["name"] == "move_line")
    assert (line["register"], line["accepted"], line["target_mm"]) == (21, True, [None, 5.0, None])
    assert line["tool_mm"] == pytest.approx([300, 0, 300], abs=0.1)
    first, second = (line for line in lines if line["name"] == "move_servo_cart")
    assert (first["accepted"], first["target_mm"]) == (True, FIVE_MM_ON[:3])
    assert (second["accepted"], second["target_mm"]) == (False, [340.0, 0.0, 300.0])
    changes = [(line["state"], line["mode"], line["error"]) for line in lines if line["name"] == "changed"]
    assert [change for change, next_ in itertools.pairwise([*changes, None]) if change != next_] == [
        (4, 0, 0),  # switched on, then with motors on
        (2, 0, 0),
        (1, 0, 0),
        (2, 0, 0),
        (5, 1, 0),
        (2, 1, 0),
        (1, 1, 0),
        (2, 1, 0),
        (4, 1, 31),
    ]
    arrived = [line for line in lines if line["name"] == "changed" and line["state"] == 2 and line["mode"] == 0][-1]
    assert arrived["tool_mm"] == pytest.approx([300, 5, 300], abs=1e-3)
