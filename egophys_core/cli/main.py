"""The `egophys` command: parse, run a subcommand, turn errors into one line and an exit code."""

import argparse
import sys
import warnings
from collections.abc import Sequence

from egophys_core import __version__
from egophys_core.cli import (
    benchmark,
    board,
    build,
    diagnose,
    evaluate,
    import_vrs,
    info,
    perceive,
    plan,
    rehearse,
    replay,
    simulate,
)
from egophys_core.errors import EgophysError

SUBCOMMANDS = (
    board,
    import_vrs,
    perceive,
    build,
    evaluate,
    simulate,
    plan,
    replay,
    diagnose,
    rehearse,
    info,
    benchmark,
)
"""Modules with `NAME`, `HELP`, `add_arguments(parser)` and `run(arguments) -> exit code`."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand.

    Returns:
        0 good, 1 a finding (a replay that differs), 2 bad input, 130 stopped by Ctrl-C.
    """
    parsed = make_parser().parse_args(arguments)
    warnings.showwarning = _show_warning
    try:
        return int(parsed.run(parsed))
    except EgophysError as error:
        print(f"egophys {parsed.command}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"egophys {parsed.command}: stopped; nothing was written", file=sys.stderr)
        return 130


def make_parser() -> argparse.ArgumentParser:
    """The parser of `egophys` with all subcommands."""
    parser = argparse.ArgumentParser(
        prog="egophys",
        description="Physical twins of soft objects: perceive, build, evaluate, simulate, plan, replay, diagnose.",
    )
    parser.add_argument("--version", action="version", version=f"egophys {__version__}")
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for module in SUBCOMMANDS:
        subparser = subparsers.add_parser(module.NAME, help=module.HELP, description=module.HELP)
        module.add_arguments(subparser)
        subparser.set_defaults(run=module.run)
    return parser


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print(f"warning: {message}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
