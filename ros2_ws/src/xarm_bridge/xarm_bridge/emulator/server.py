"""The emulator as a program: command line, and faults on standard input."""

import argparse
import asyncio
import contextlib
import logging
import math
import signal
import sys
import threading
from typing import TextIO

from xarm_bridge.emulator.control_box import ControlBox
from xarm_bridge.emulator.faults import HELP, Fault
from xarm_bridge.emulator.identity import robot_serial
from xarm_bridge.emulator.journal import Journal
from xarm_bridge.kinematics import Pose


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
    parser.add_argument(
        "--wire",
        type=_appended,
        metavar="FILE",
        help="append one JSON line for each command that moves the arm or lets it move, and for each change of its "
        "state: what was commanded, whether it was accepted, where the tool was",
    )
    parser.add_argument("--verbose", action="store_true", help="log connections")
    return parser


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} must be above 0")
    return value


def _appended(path: str) -> TextIO:
    try:
        return open(path, "a", encoding="utf-8")
    except OSError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _fault(text: str) -> Fault:
    try:
        return Fault.parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


async def _main(arguments: argparse.Namespace) -> int:
    start = Pose.from_wire((*arguments.start[:3], *map(math.radians, arguments.start[3:])))
    try:
        serial = robot_serial(arguments.host)
        box = ControlBox(
            serial,
            start,
            speedup=arguments.speedup,
            report_rate=arguments.report_rate,
            faults=arguments.fault,
            journal=Journal(arguments.wire) if arguments.wire else None,
        )
        where = box.network.open(arguments.host)
    except (OSError, ValueError) as error:
        print(f"emulator: {error}; another address may be free: --host 127.0.0.2", file=sys.stderr)
        return 2
    running = asyncio.ensure_future(box.run())
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, running.cancel)
    # Whoever waits for this line may stop the emulator right after it.
    print(f"xArm6 emulator {serial} ready on {where}", flush=True)
    if arguments.faults_from_stdin:
        threading.Thread(target=_read_faults, args=(box, asyncio.get_running_loop()), daemon=True).start()
    with contextlib.suppress(asyncio.CancelledError):
        await running
    box.network.close()
    if arguments.wire:
        arguments.wire.close()
    return 0


def _read_faults(box: ControlBox, loop: asyncio.AbstractEventLoop) -> None:
    """Cause the faults that come on stdin, until it ends; whatever stdin is, reading it holds up nothing else."""

    def cause(line: str) -> None:
        try:
            fault = Fault.parse(f"{line}@0")
        except ValueError as error:
            print(f"refused: {error}", flush=True)
        else:
            box.cause(fault)
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
