"""The control box as its clients see it: the command port, the report ports, and the clock behind them."""

import asyncio
import logging
import time
from collections.abc import Callable
from functools import partial

from xarm_bridge.emulator.controller import Controller
from xarm_bridge.emulator.devices import Devices
from xarm_bridge.emulator.faults import Fault, FaultSchedule
from xarm_bridge.emulator.feedback import SET_TYPES, Feedback
from xarm_bridge.emulator.gripper import Gripper
from xarm_bridge.emulator.holding import HoldingRegisters
from xarm_bridge.emulator.journal import Journal
from xarm_bridge.emulator.network import Network, Service
from xarm_bridge.emulator.protocol import (
    PRIVATE_PROTOCOLS,
    STANDARD_MODBUS,
    ProtocolError,
    Request,
    RequestReader,
    encode_modbus_reply,
    encode_reply,
)
from xarm_bridge.emulator.registers import answer
from xarm_bridge.emulator.report import normal_report, real_report, rich_report
from xarm_bridge.kinematics import Pose

log = logging.getLogger("xarm_emulator")

COMMAND_PORT = 502
NORMAL_PORT, RICH_PORT, REAL_PORT = 30001, 30002, 30003
TICK = 0.01
"""Seconds between updates when no request comes."""
REAL_REPORT_RATE = 100.0
LARGEST_BACKLOG = 65536
"""Bytes a report client may leave unread before it is dropped."""


class ControlBox:
    """One emulated controller and the clients connected to it; everything runs on one event loop."""

    def __init__(
        self,
        serial: str,
        start: Pose,
        *,
        speedup: float,
        report_rate: float,
        faults: list[Fault],
        journal: Journal | None,
    ) -> None:
        self._devices = Devices(serial=serial, controller=Controller(start), gripper=Gripper())
        self._holding = HoldingRegisters()
        self._faults = FaultSchedule(faults)
        self._feedback = Feedback()
        self._journal = journal
        self._speedup = speedup
        self._began = time.monotonic()
        self._counter = 0
        self._reports: dict[int, tuple[float, Callable[[], bytes]]] = {
            NORMAL_PORT: (report_rate, lambda: normal_report(self._devices.controller)),
            RICH_PORT: (report_rate, lambda: rich_report(self._devices.controller, self._counter)),
            REAL_PORT: (REAL_REPORT_RATE, lambda: real_report(self._devices.controller)),
        }
        self._listeners: dict[int, set[asyncio.StreamWriter]] = {port: set() for port in self._reports}
        services: dict[int, Service] = {COMMAND_PORT: self._serve_commands}
        services.update({port: partial(self._serve_reports, port) for port in self._reports})
        self.network = Network(services)

    async def run(self) -> None:
        """Let time pass and send reports until cancelled."""
        due = dict.fromkeys(self._reports, 0.0)
        while True:
            self._advance()
            now = time.monotonic()
            for port, (rate, encode) in self._reports.items():
                if now >= due[port]:
                    due[port] = max(due[port] + 1 / rate, now - 1 / rate)
                    if not self._faults.reports_stopped:
                        self._send_report(port, encode)
            await asyncio.sleep(TICK)

    def cause(self, fault: Fault) -> None:
        """Let a fault happen now."""
        self._advance()
        self._faults.cause(fault, self._devices.controller, self._now())
        self._follow_cut()
        self._note_changes()

    def _now(self) -> float:
        """The arm's clock, seconds."""
        return (time.monotonic() - self._began) * self._speedup

    def _advance(self) -> None:
        now = self._now()
        self._devices.controller.advance(now)
        self._devices.gripper.advance(now)
        self._faults.advance(self._devices.controller, now)
        self._follow_cut()
        self._note_changes()
        for client, frame in self._feedback.frames(self._devices.controller.queue.events, now):
            if not (self._faults.silent or client.is_closing()):
                client.write(frame)

    def _note_changes(self) -> None:
        if self._journal:
            self._journal.notice_changes(self._devices.controller)

    def _follow_cut(self) -> None:
        if self._faults.cut and not self.network.is_cut:
            self.network.cut()
        elif self.network.is_cut and not self._faults.cut:
            self.network.restore()

    def _send_report(self, port: int, encode: Callable[[], bytes]) -> None:
        if not self._listeners[port]:
            return
        if port == RICH_PORT:
            self._counter += 1
        frame = encode()
        for writer in list(self._listeners[port]):
            if writer.is_closing() or writer.transport.get_write_buffer_size() > LARGEST_BACKLOG:
                self._listeners[port].discard(writer)
                writer.close()
            else:
                writer.write(frame)

    async def _serve_reports(self, port: int, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._listeners[port].add(writer)
        try:
            while await reader.read(1024):  # clients only listen; whatever they say is ignored
                pass
        finally:
            self._listeners[port].discard(writer)

    async def _serve_commands(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        requests = RequestReader()
        log.info("client connected")
        try:
            while data := await reader.read(4096):
                for request in requests.feed(data):
                    self._advance()
                    if writer.is_closing():  # reset just now, because a cut is over
                        return
                    writer.write(self._reply(request, writer))
                await writer.drain()
        except ProtocolError as error:
            log.warning("closing a connection that sent no request: %s", error)
        finally:
            self._feedback.forget(writer)
            log.info("client gone")

    def _reply(self, request: Request, client: asyncio.StreamWriter) -> bytes:
        if self._faults.silent:
            return b""
        if request.protocol in PRIVATE_PROTOCOLS:
            return self._carry_out(request, client)
        if request.protocol == STANDARD_MODBUS:
            return encode_modbus_reply(request, self._holding.answer(request.params))
        return b""

    def _carry_out(self, request: Request, client: asyncio.StreamWriter) -> bytes:
        controller = self._devices.controller
        if request.register == SET_TYPES and request.params:
            self._feedback.choose(client, request.params[0])
            return encode_reply(request, controller.status)
        tasks = controller.queue.tasks
        status, params, accepted = answer(self._devices, request.register, request.params)
        if controller.queue.tasks > tasks:
            self._feedback.expect(controller.queue.tasks, client, request)
        if self._journal:
            self._journal.command(controller, request.register, request.params, accepted=accepted)
            self._journal.notice_changes(controller)
        return encode_reply(request, status, params)
