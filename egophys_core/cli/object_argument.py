"""`--object`: which thing in a video is meant, by a place on the picture of a check or by a word."""

import argparse
import dataclasses

from egophys_core.errors import OptionsError
from egophys_core.perception.options import PerceptionOptions, Stages


def add_object_argument(parser: argparse.ArgumentParser) -> None:
    """Add `--object`."""
    parser.add_argument(
        "--object",
        metavar='"X Y"',
        help="the object: a place on it in pixels of the first square view, as in the upper left of the picture that "
        "`egophys check` draws; with learned stages also a word for it",
    )


def with_object(options: PerceptionOptions, named: str | None) -> PerceptionOptions:
    """Options with the object that `--object` names.

    Raises:
        OptionsError: neither two numbers nor, with learned stages, a word; or the object is given in another way, too.
    """
    if named is None:
        return options
    if any(options.object_point) or any(options.object_box):
        raise OptionsError("--object and --object-point or --object-box both say where the object is; give one of them")
    place = _place(named)
    if place is not None:
        return dataclasses.replace(options, object_point=place)
    if options.stages == Stages.LEARNED and named.strip():
        return dataclasses.replace(options, object_prompt=named.strip())
    raise OptionsError(
        f"--object must be two numbers, x and y in pixels, got {named!r}; a word for it needs learned stages "
        "(--stages learned --weights DIR)"
    )


def _place(named: str) -> tuple[float, float] | None:
    try:
        numbers = [float(each) for each in named.replace(",", " ").split()]
    except ValueError:
        return None
    return (numbers[0], numbers[1]) if len(numbers) == 2 else None
