"""The emulator on the wire: framing, malformed bytes, clients that vanish, and the reports byte for byte."""

import itertools
import math
import socket
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from xarm.x3.report import ReportDataStructure
from xarm_bridge.emulator.controller import Controller
from xarm_bridge.emulator.faults import Fault
from xarm_bridge.emulator.protocol import ProtocolError, RequestReader
from xarm_bridge.emulator.report import normal_report, real_report, rich_report
from xarm_bridge.kinematics import Pose

from tests.xarm_bridge.emulator_process import EmulatorProcess

START = (300.0, 0.0, 300.0, math.pi, 0.0, 0.0)

requests = st.builds(
    lambda transaction, protocol, register, params: (transaction, protocol, register, params),
    st.integers(0, 0xFFFF),
    st.sampled_from([0, 1, 2, 3]),
    st.integers(0, 255),
    st.binary(max_size=80),
)


def encode(transaction, protocol, register, params):
    """Written out from the protocol's description, not with the code under test."""
    return struct.pack(">HHHB", transaction, protocol, 1 + len(params), register) + params


@given(sent=st.lists(requests, max_size=6), cuts=st.lists(st.integers(0, 500), max_size=8))
def test_requests_survive_any_chunking(sent, cuts):
    stream = b"".join(encode(*request) for request in sent)
    borders = sorted({0, len(stream), *(cut for cut in cuts if cut < len(stream))})
    reader = RequestReader()
    received = [request for start, end in itertools.pairwise(borders) for request in reader.feed(stream[start:end])]
    assert [(r.transaction, r.protocol, r.register, r.params) for r in received] == sent


@given(st.binary(min_size=6, max_size=200))
def test_any_bytes_give_requests_or_a_protocol_error(noise):
    try:
        requests = RequestReader().feed(noise)
    except ProtocolError:
        return
    assert sum(7 + len(request.params) for request in requests) <= len(noise)


def ask_version(stream):
    stream.sendall(encode(7, 2, 1, b""))
    reply = stream.recv(4096)
    assert struct.unpack(">HHHBB", reply[:8])[:4] == (7, 2, 42, 1)
    return reply[8:].rstrip(b"\0").decode()


@pytest.mark.parametrize(
    "noise",
    [
        b"GET / HTTP/1.0\r\n\r\n",
        b"\0" * 64,
        b"\xff" * 64,
        encode(1, 2, 21, b"\1\2\3"),
        encode(1, 2, 250, b""),
        b"",
    ],
    ids=["http", "zeros", "ones", "short-parameters", "unknown-register", "hang-up"],
)
def test_malformed_bytes_do_not_end_the_emulator(shared_emulator, noise):
    with socket.create_connection((shared_emulator.host, 502), timeout=5) as stream:
        stream.sendall(noise + struct.pack(">H", 9))  # ends inside a header
    with socket.create_connection((shared_emulator.host, 502), timeout=5) as stream:
        assert ask_version(stream).startswith("6,6,")
    assert shared_emulator.alive


def test_a_report_client_that_never_reads_does_not_stop_the_others(start_emulator):
    emulator = start_emulator("--report-rate", "100")
    with (
        socket.create_connection((emulator.host, 30002), timeout=5),
        socket.create_connection((emulator.host, 30002), timeout=5) as stream,
    ):
        for _ in range(5):
            size = struct.unpack(">I", stream.recv(4, socket.MSG_WAITALL))[0]
            assert size == 587
            stream.recv(size - 4, socket.MSG_WAITALL)


def test_standard_modbus_knows_the_user_defined_registers(shared_emulator):
    """Frames written out from UFACTORY's Modbus manual."""
    exchanges = [
        (struct.pack(">BHH", 3, 0x1FE, 2), b"\x03\x04\0\0\0\0"),
        (struct.pack(">BHHB2H", 0x10, 0x100, 2, 4, 7, 8), struct.pack(">BHH", 0x10, 0x100, 2)),
        (struct.pack(">BHH", 6, 0x101, 9), struct.pack(">BHH", 6, 0x101, 9)),
        (struct.pack(">BHH", 3, 0x100, 2), struct.pack(">BBHH", 3, 4, 7, 9)),
        (struct.pack(">BHH", 3, 0x20, 1), b"\x83\x02"),
        (struct.pack(">BHH", 3, 0x1FF, 2), b"\x83\x02"),
        (struct.pack(">BHHBH", 0x10, 0xFF, 1, 2, 1), b"\x90\x02"),
        (struct.pack(">BHH", 3, 0x100, 0), b"\x83\x03"),
        (struct.pack(">BHHBH", 0x10, 0x100, 2, 4, 1), b"\x90\x03"),
        (struct.pack(">BHHB", 0x10, 0x100, 1, 9), b"\x90\x03"),
        (struct.pack(">BHH", 1, 0x100, 1), b"\x81\x01"),
        (b"", b"\x80\x01"),
    ]
    with socket.create_connection((shared_emulator.host, 502), timeout=5) as stream:
        for pdu, reply in exchanges:
            stream.sendall(struct.pack(">HHHB", 5, 0, 1 + len(pdu), 1) + pdu)
            assert stream.recv(64) == struct.pack(">HHHB", 5, 0, 1 + len(reply), 1) + reply


def test_a_second_emulator_on_the_same_address_is_refused(shared_emulator):
    with pytest.raises(AssertionError, match="did not start"):
        EmulatorProcess(shared_emulator.host, ())


def test_reports_are_read_as_written_by_the_sdk():
    """The SDK's own structures decode what the emulator encodes."""
    controller = Controller(Pose.from_wire(START))
    controller.enable_motors(8, True)
    controller.set_state(0)
    controller.line(lambda tool: Pose.from_wire((350, 0, 300, math.pi, 0, 0)), 50.0, 500.0)
    controller.advance(0.2)
    for port, frame in (
        (30001, normal_report(controller)),
        (30002, rich_report(controller, 17)),
        (30003, None),
    ):
        frame = real_report(controller) if frame is None else frame
        decoded = ReportDataStructure.create(port, is_radian=True)
        assert len(frame) == len(decoded)
        decoded.update(frame)
        assert decoded.data_size == len(frame)
        assert (decoded.state, decoded.mode, decoded.cmd_num) == (1, 0, 1)
        np.testing.assert_allclose(decoded.actual_tcp_pose, controller.arm.tool.to_wire(), atol=1e-4)
        np.testing.assert_allclose(decoded.actual_joint_angle[:6], controller.arm.joints, atol=1e-6)
    controller.raise_error(31)
    decoded = ReportDataStructure.create(30002, is_radian=True)
    decoded.update(rich_report(controller, 18))
    assert (decoded.state, decoded.error_code, decoded.motor_enable_status) == (4, 31, 0x7F)
    assert (decoded.robot_type, decoded.robot_axis, decoded.version, decoded.counter) == (
        6,
        6,
        "v2.5.0",
        18,
    )
    assert decoded.tcp_max_speed == 1000.0
    assert decoded.joint_voltages == [4800] * 7
    assert decoded.reduced_tcp_boundary == [[-9999, 9999]] * 3


@pytest.mark.parametrize(
    "text",
    ["error@1", "silence=0@1", "error=0@1", "error=300@1", "mode@1", "mode=2@1", "stop=1@1", "smoke@1", "error=31"],
)
def test_a_fault_that_is_none_is_refused(text):
    with pytest.raises(ValueError, match="fault"):
        Fault.parse(text)
