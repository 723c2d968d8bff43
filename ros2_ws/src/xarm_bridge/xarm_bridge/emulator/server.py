"""The emulator as a program: sockets, clock and command line."""

import argparse
import asyncio
import contextlib
import logging
import math
import signal
import sys
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

from xarm_bridge.emulator.controller import Controller
from xarm_bridge.emulator.faults import Fault, FaultSchedule
from xarm_bridge.emulator.gripper import Gripper
from xarm_bridge.emulator.holding import HoldingRegisters
from xarm_bridge.emulator.identity import robot_serial
from xarm_bridge.emulator.kinematics import Pose
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
UNIX_SOCKET = "/tmp/xarmcontroller_uds_{port}"
"""Where the SDK looks for a controller on the same machine before it tries TCP."""

TICK = 0.01
"""Seconds between updates when no request comes."""
REAL_REPORT_RATE = 100.0
LARGEST_BACKLOG = 65536
"""Bytes a report client may leave unread before it is dropped."""

Connection = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]


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
        self._servers: list[asyncio.Server] = []
        self._sockets: list[Path] = []

    async def open(self, host: str) -> str:
        """Start listening on TCP, or on the SDK's Unix sockets where port 502 is not permitted.

        Returns where it listens, for people.

        Raises:
            OSError: the address does not exist or is taken.
        """
        connections: dict[int, Connection] = {COMMAND_PORT: self._serve_commands}
        for port in self._reports:
            connections[port] = self._listener(port)
        try:
            for port, connection in connections.items():
                self._servers.append(await asyncio.start_server(connection, host, port))
        except PermissionError:
            for port, connection in connections.items():
                path = Path(UNIX_SOCKET.format(port=port))
                if await _is_answered(path):
                    raise OSError(f"another emulator listens on {path}; only one can without port 502") from None
                path.unlink(missing_ok=True)
                self._servers.append(await asyncio.start_unix_server(connection, path))
                self._sockets.append(path)
            return (
                f"{UNIX_SOCKET.format(port='*')} because port {COMMAND_PORT} is not permitted. While it "
                "runs, the SDK on this machine connects here for every address, a real arm's included"
            )
        return f"{host}:{COMMAND_PORT}, reports on {', '.join(map(str, self._reports))}"

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

    def close(self) -> None:
        """Stop listening, drop the clients and remove the sockets."""
        for server in self._servers:
            server.close()
        for path in self._sockets:
            path.unlink(missing_ok=True)

    def _advance(self) -> None:
        now = (time.monotonic() - self._began) * self._speedup
        self._devices.controller.advance(now)
        self._devices.gripper.advance(now)
        self._faults.advance(self._devices.controller, now)

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

    def _listener(self, port: int) -> Connection:
        async def listen(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            self._listeners[port].add(writer)
            try:
                while await reader.read(1024):  # clients only listen; whatever they say is ignored
                    pass
            except ConnectionError:
                pass
            finally:
                self._listeners[port].discard(writer)
                writer.close()

        return listen

    async def _serve_commands(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        requests = RequestReader()
        log.info("client connected")
        try:
            while data := await reader.read(4096):
                for request in requests.feed(data):
                    writer.write(self._reply(request))
                await writer.drain()
        except ProtocolError as error:
            log.warning("closing a connection that sent no request: %s", error)
        except ConnectionError:
            pass
        finally:
            log.info("client gone")
            writer.close()

    def _reply(self, request: Request) -> bytes:
        self._advance()
        if self._faults.silent:
            return b""
        if request.protocol in PRIVATE_PROTOCOLS:
            status, params = answer(self._devices, request.register, request.params)
            return encode_reply(request, status, params)
        if request.protocol == STANDARD_MODBUS:
            return encode_modbus_reply(request, self._holding.answer(request.params))
        return b""


async def _is_answered(path: Path) -> bool:
    """Whether a living process listens on a Unix socket (a killed one leaves the file)."""
    try:
        _, writer = await asyncio.open_unix_connection(path)
    except OSError:
        return False
    writer.close()
    return True


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="emulator",
        description="xArm6 controller emulator: programs that use xarm-python-sdk connect to it unchanged.",
        epilog="Example: emulator --host 127.0.0.2, then XArmAPI('127.0.0.2'). Port 502 needs root or "
        "net.ipv4.ip_unprivileged_port_start=502; without it, Unix sockets that the SDK knows are used.",
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
        type=Fault.parse,
        action="append",
        default=[],
        metavar="KIND@SECONDS",
        help="error=CODE@S, silence@S or no-reports@S, S seconds after the first motion command; repeatable",
    )
    parser.add_argument("--verbose", action="store_true", help="log connections")
    return parser


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} must be above 0")
    return value


async def _main(arguments: argparse.Namespace) -> int:
    start = Pose.from_wire((*arguments.start[:3], *map(math.radians, arguments.start[3:])))
    try:
        serial = robot_serial(arguments.host)
        emulator = Emulator(serial, start, arguments.speedup, arguments.report_rate, arguments.fault)
        where = await emulator.open(arguments.host)
    except (OSError, ValueError) as error:
        print(f"emulator: {error}; another address may be free: --host 127.0.0.2", file=sys.stderr)
        return 2
    running = asyncio.ensure_future(emulator.run())
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, running.cancel)
    # Whoever waits for this line may stop the emulator right after it.
    print(f"xArm6 emulator {serial} ready on {where}", flush=True)
    with contextlib.suppress(asyncio.CancelledError):
        await running
    emulator.close()
    return 0


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
