"""The emulator as a program: sockets, clock and command line."""

import argparse
import asyncio
import contextlib
import logging
import math
import signal
import sys
import threading
import time
from collections.abc import Callable
from functools import partial

from xarm_bridge.emulator.controller import Controller
from xarm_bridge.emulator.faults import HELP, Fault, FaultSchedule
from xarm_bridge.emulator.gripper import Gripper
from xarm_bridge.emulator.holding import HoldingRegisters
from xarm_bridge.emulator.identity import robot_serial
from xarm_bridge.emulator.kinematics import Pose
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
from xarm_bridge.emulator.registers import Devices, answer
from xarm_bridge.emulator.report import normal_report, real_report, rich_report

log = logging.getLogger("xarm_emulator")

COMMAND_PORT = 502
NORMAL_PORT, RICH_PORT, REAL_PORT = 30001, 30002, 30003
TICK = 0.01
"""Seconds between updates when no request comes."""
REAL_REPORT_RATE = 100.0
LARGEST_BACKLOG = 65536
"""Bytes a report client may leave unread before it is dropped."""


class Emulator:
    """One emulated controller and the clients connected to it; everything runs on one event loop."""

    def __init__(self, serial: str, start: Pose, speedup: float, report_rate: float, faults: list[Fault]) -> None:
        self._devices = Devices(serial=serial, controller=Controller(start), gripper=Gripper())
        self._holding = HoldingRegisters()
        self._faults = FaultSchedule(faults)
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

    def _now(self) -> float:
        """The arm's clock, seconds."""
        return (time.monotonic() - self._began) * self._speedup

    def _advance(self) -> None:
        now = self._now()
        self._devices.controller.advance(now)
        self._devices.gripper.advance(now)
        self._faults.advance(self._devices.controller, now)
        self._follow_cut()

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
                    writer.write(self._reply(request))
                await writer.drain()
        except ProtocolError as error:
            log.warning("closing a connection that sent no request: %s", error)
        finally:
            log.info("client gone")

    def _reply(self, request: Request) -> bytes:
        if self._faults.silent:
            return b""
        if request.protocol in PRIVATE_PROTOCOLS:
            status, params = answer(self._devices, request.register, request.params)
            return encode_reply(request, status, params)
        if request.protocol == STANDARD_MODBUS:
            return encode_modbus_reply(request, self._holding.answer(request.params))
        return b""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="emulator",
        description="xArm6 controller emulator: programs that use xarm-python-sdk connect to it unchanged.",
        epilog=f"{HELP}\n\nExample: emulator --host 127.0.0.2, then XArmAPI('127.0.0.2'). Port 502 needs root or\n"
        "net.ipv4.ip_unprivileged_port_start=502; without it, Unix sockets that the SDK knows are used.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default %(default)s)")
    parser.add_argument(
        "--speedup",
        type=_positive,
        default=1.0,
        help="run the arm this much faster than life; for demos and tests",
    )
    parser.add_argument(
        "--report-rate",
        type=_positive,
        default=5.0,
        metavar="HZ",
        help="status reports (default %(default)s)",
    )
    parser.add_argument(
        "--start",
        type=float,
        nargs=6,
        default=[300.0, 0.0, 300.0, 180.0, 0.0, 0.0],
        metavar=("X", "Y", "Z", "ROLL", "PITCH", "YAW"),
        help="flange pose at power-up, mm and degrees (default %(default)s)",
    )
    parser.add_argument(
        "--fault",
        type=_fault,
        action="append",
        default=[],
        metavar="FAULT@SECONDS",
        help="a fault (below) so many seconds after the first motion command; repeatable",
    )
    parser.add_argument(
        "--faults-from-stdin",
        action="store_true",
        help="each line on stdin is a fault without @SECONDS, such as error=31 or silence=3: it happens at once "
        "and is answered on stdout with 'fault ...' or 'refused: ...'",
    )
    parser.add_argument("--verbose", action="store_true", help="log connections")
    return parser


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} must be above 0")
    return value


def _fault(text: str) -> Fault:
    try:
        return Fault.parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


async def _main(arguments: argparse.Namespace) -> int:
    start = Pose.from_wire((*arguments.start[:3], *map(math.radians, arguments.start[3:])))
    try:
        serial = robot_serial(arguments.host)
        emulator = Emulator(serial, start, arguments.speedup, arguments.report_rate, arguments.fault)
        where = emulator.network.open(arguments.host)
    except (OSError, ValueError) as error:
        print(f"emulator: {error}; another address may be free: --host 127.0.0.2", file=sys.stderr)
        return 2
    running = asyncio.ensure_future(emulator.run())
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, running.cancel)
    # Whoever waits for this line may stop the emulator right after it.
    print(f"xArm6 emulator {serial} ready on {where}", flush=True)
    if arguments.faults_from_stdin:
        threading.Thread(target=_read_faults, args=(emulator, asyncio.get_running_loop()), daemon=True).start()
    with contextlib.suppress(asyncio.CancelledError):
        await running
    emulator.network.close()
    return 0


def _read_faults(emulator: Emulator, loop: asyncio.AbstractEventLoop) -> None:
    """Cause the faults that come on stdin, until it ends; whatever stdin is, reading it holds up nothing else."""

    def cause(line: str) -> None:
        try:
            fault = Fault.parse(f"{line}@0")
        except ValueError as error:
            print(f"refused: {error}", flush=True)
        else:
            emulator.cause(fault)
            print(f"fault {fault}", flush=True)

    # Unbuffered: a lock of the buffer, held by this thread, would abort the interpreter when it ends.
    with open(0, "rb", buffering=0, closefd=False) as lines, contextlib.suppress(RuntimeError):  # the loop is closed
        for line in lines:
            if line.strip():
                loop.call_soon_threadsafe(cause, line.decode(errors="replace").strip())


def main() -> None:
    """Entry point of the `emulator` command; ROS arguments that `launch` appends are ignored."""
    words = sys.argv[1:]
    if "--ros-args" in words:
        words = words[: words.index("--ros-args")]
    arguments = _parser().parse_args(words)
    level = logging.INFO if arguments.verbose else logging.WARNING
    logging.basicConfig(level=level, format="emulator: %(message)s")
    sys.exit(asyncio.run(_main(arguments)))


if __name__ == "__main__":
    main()
