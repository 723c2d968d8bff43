"""The `egophys` command: parse, run a subcommand, turn errors into one line and an exit code.

Only the subcommand that is asked for is imported, and it imports what it needs when it runs: `egophys --help` answers
at once.
"""

import argparse
import difflib
import importlib
import io
import keyword
import os
import signal
import sys
import warnings
from collections.abc import Sequence

from egophys_core import __version__
from egophys_core.errors import EgophysError

SUBCOMMANDS = {
    "board": "Write the printable tag board that tells the camera where it is.",
    "calibrate": "Find where the robot stands from points that its arm touched; writes the bridge's calibration file.",
    "calibrate-camera": "Find a camera's lens from a video of the printed tag board, and say how good that is.",
    "import": "Write a film, a folder of pictures or a recording of Aria glasses as a bag.",
    "check": "Say in seconds whether a video will do and what to film differently; draws one picture.",
    "perceive": "Reconstruct object and hand of an egocentric video: an episode, pictures to check, and a report.",
    "build": "Fit a twin to recorded episodes of one object and write it to a file.",
    "evaluate": "Errors of a twin on an episode of its object: train, test and all frames.",
    "simulate": "Move a twin with an episode's controllers and write the predicted points as a bag.",
    "plan": "Plan tool waypoints that bring the object to a target shape; writes them as JSON.",
    "execute": "Execute a plan file on an arm, or on the emulator, without ROS.",
    "replay": "Feed a log's inputs to the same code and compare the outputs; exit code 1 if one differs.",
    "diagnose": "Say what a twin lacks to predict recorded episodes, with the evidence, and write a better twin.",
    "experiment": "Say which motion would show what recordings so far could not, with a plan for each hand.",
    "rehearse": "Record episodes of a soft object in a physics engine that is not the twin's, with injected effects.",
    "info": "What is in a twin file or a bag.",
    "benchmark": "Errors of perception on bags that hold a video and what was measured meanwhile.",
}
"""What each does, by name. `egophys_core/cli/NAME.py` (see `module_name`) has `add_arguments(parser)` and
`run(arguments) -> exit code`; what is slow to load is imported in `run`."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand.

    Returns:
        0 good, 1 a finding (a replay that differs), 2 bad input, 130 stopped by Ctrl-C or SIGTERM, 141 nobody reads the
        output any more, as after `| head`.
    """
    words = sys.argv[1:] if arguments is None else list(arguments)
    # No option stands before the subcommand but --help and --version, which have no values.
    command = next((word for word in words if not word.startswith("-")), "")
    warnings.showwarning = _show_warning
    _prepare_streams()
    # As Ctrl-C, so that what is half written is removed.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        parsed = make_parser(command).parse_args(words)
        code = int(parsed.run(parsed))
        sys.stdout.flush()
        return code
    except EgophysError as error:
        print(f"egophys {command}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"egophys {command}: stopped; nothing was written", file=sys.stderr)
        return 130
    except BrokenPipeError:
        _drop_output()
        return 141
    except OSError as error:
        print(f"egophys {command}: {_in_words(error)}", file=sys.stderr)
        return 2


def make_parser(command: str) -> argparse.ArgumentParser:
    """The parser of `egophys`, which knows all subcommands by name and the arguments of one.

    Args:
        command: the subcommand that is to be parsed; empty for none.
    """
    parser = argparse.ArgumentParser(
        prog="egophys",
        description="Physical twins of soft objects: perceive, build, evaluate, simulate, plan, replay, diagnose.",
        epilog="`egophys COMMAND --help` shows the arguments of a subcommand.",
    )
    parser.add_argument("--version", action="version", version=f"egophys {__version__}")
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    if command and command not in SUBCOMMANDS:
        near = difflib.get_close_matches(command, SUBCOMMANDS, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(SUBCOMMANDS)}"
        parser.error(f"no subcommand is called {command!r}; {hint}")
    for name, description in SUBCOMMANDS.items():
        subparser = subparsers.add_parser(name, help=description, description=description)
        if name == command:
            module = importlib.import_module(f"egophys_core.cli.{module_name(name)}")
            module.add_arguments(subparser)
            subparser.set_defaults(run=module.run)
    return parser


def module_name(command: str) -> str:
    """Name of a subcommand's module; a keyword of Python, which no module may be called, gets an underscore."""
    return command.replace("-", "_") + "_" * keyword.iskeyword(command)


def _prepare_streams() -> None:
    """Have both streams where the shell closed one (`>&-`), and write what an encoding lacks as `\\xfc`."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115  # it is open as long as the command runs
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _drop_output() -> None:
    """Lose what waits for standard output, which Python would try to write once more as it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _in_words(error: OSError) -> str:
    """What failed, as far as it says, and why."""
    place = error.filename
    try:
        sys.stdout.flush()
    except OSError:
        _drop_output()
        place = "standard output"
    reason = error.strerror or str(error)
    return f"{place}: {reason}" if place else reason


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print(f"warning: {message}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
