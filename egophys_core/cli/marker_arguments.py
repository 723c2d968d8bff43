"""Command-line arguments for objects that are seen at a few markers."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from egophys_core.errors import OptionsError

if TYPE_CHECKING:
    from egophys_core.episode import Episode

DENSITY, MOST_MARKERS = 1000.0, 12
"""Those of `build_marker_twin` and of `is_sparse`, which are not loaded for `--help`."""


def add_marker_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments for objects that are seen at a few markers."""
    group = parser.add_argument_group(f"markers, for recordings of at most {MOST_MARKERS} points")
    group.add_argument(
        "--template",
        metavar="SHAPE",
        help="box:LxWxH or an .obj or .stl file, in metres; by default a rod along markers that lie one after the "
        "other, else a bar from the held points to the markers",
    )
    group.add_argument("--density", type=float, default=DENSITY, help="kg/m^3 (default %(default)g)")
    add_load_argument(group)


def add_load_argument(group: argparse._ArgumentGroup | argparse.ArgumentParser) -> None:
    """What hangs at the free end."""
    group.add_argument(
        "--load",
        action="append",
        default=[],
        metavar="EPISODE=N",
        help="weight in newtons of what hangs at the free end in an episode, by its file's name; may be repeated",
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


def load_of(given: Sequence[str], episode: "Episode") -> float:
    """Newtons that hang in one episode, 0 unless said.

    Raises:
        OptionsError: of a wrong form, or for an object that is seen all over.
    """
    from egophys_core.observation.markers import is_sparse

    if not is_sparse(episode):
        refuse_loads(given)
    return loads_from(given, [episode.name]).get(episode.name, 0.0)


def refuse_loads(given: Sequence[str]) -> None:
    """Check that no weight is given for an object that is seen all over.

    Raises:
        OptionsError: one is.
    """
    if given:
        raise OptionsError(f"--load is for recordings of at most {MOST_MARKERS} points; leave it out")
