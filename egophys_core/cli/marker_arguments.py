"""Command-line arguments for what hangs at objects that are seen at a few markers."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from egophys_core.errors import OptionsError


def add_load_argument(parser: argparse.ArgumentParser) -> None:
    """What hangs at the free end."""
    parser.add_argument(
        "--load",
        action="append",
        default=[],
        metavar="EPISODE=N",
        help="of an object that is seen at a few markers: weight in newtons of what hangs at the free end in an "
        "episode, by its file's name; may be repeated",
    )


def loads_from(given: Sequence[str], names: Sequence[str]) -> dict[str, float]:
    """Newtons by name of the episode, from `EPISODE=N`; the ending of the name may be left out.

    Raises:
        OptionsError: not of this form, or for none of the episodes.
    """
    loads = {}
    for text in given:
        name, _, newtons = text.rpartition("=")
        match = next((each for each in names if name in (each, Path(each).stem)), None)
        if match is None:
            raise OptionsError(f"--load {text}: give EPISODE=N with one of the episodes {', '.join(names)}")
        try:
            loads[match] = float(newtons)
        except ValueError as error:
            raise OptionsError(f"--load {text}: {newtons!r} is not a number of newtons") from error
    return loads


def load_of(given: Sequence[str], name: str) -> float:
    """Newtons that hang in one episode, 0 unless said.

    Raises:
        OptionsError: of a wrong form, or for another episode.
    """
    return loads_from(given, [name]).get(name, 0.0)
