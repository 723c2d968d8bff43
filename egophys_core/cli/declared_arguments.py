"""Command-line arguments for what a recording does not show by itself."""

import argparse
import dataclasses
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from egophys_core.episode import Episode


def add_declared_arguments(parser: argparse.ArgumentParser) -> None:
    """Who holds the object, and whether there is a table."""
    parser.add_argument(
        "--held",
        action="store_true",
        help="hands hold the object from the first frame to the last; without it that is looked for",
    )
    parser.add_argument(
        "--no-table",
        action="store_true",
        help="there is no table; without it one is taken to be at z = 0, unless the object hangs far from it",
    )


def as_declared(episode: "Episode", parsed: argparse.Namespace) -> "Episode":
    """An episode with what the command line says of it."""
    return dataclasses.replace(episode, held=parsed.held, no_table=parsed.no_table)
