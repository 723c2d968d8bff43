"""The tag board on the command line; OpenCV is loaded only when the board is made."""

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from egophys_core.perception.camera.board import Board

COLUMNS, ROWS, TAG_SIDE_MM, GAP_MM, FIRST_ID, FAMILY, ORIGIN_M = 4, 3, 60.0, 15.0, 0, "36h11", (-0.1425, 0.435, 0.001)
"""Those of `Board()`, which is not asked here since that loads OpenCV for every subcommand."""
FAMILIES = ("16h5", "25h9", "36h10", "36h11")


def add_board_arguments(parser: argparse.ArgumentParser, *, prefix: str = "", placed: bool = False) -> None:
    """Add the arguments that `board_from` reads.

    Args:
        parser: to add them to.
        prefix: of the names: `board-` gives `--board-columns`.
        placed: also ask where the board lies.
    """
    group = parser.add_argument_group("board", "the printed tags on the table")

    def add(name: str, **arguments: object) -> None:
        group.add_argument(f"--{prefix}{name}", dest=f"board_{name.replace('-', '_')}", **arguments)  # type: ignore[arg-type]

    add("columns", type=int, default=COLUMNS, help=f"tags in a row (default {COLUMNS})")
    add("rows", type=int, default=ROWS, help=f"rows (default {ROWS})")
    add("tag-side-mm", type=float, default=TAG_SIDE_MM, help=f"side of a tag's black square (default {TAG_SIDE_MM:g})")
    add("gap-mm", type=float, default=GAP_MM, help=f"white between two tags (default {GAP_MM:g})")
    add("first-id", type=int, default=FIRST_ID, help=f"id of the upper left tag (default {FIRST_ID})")
    add("family", choices=FAMILIES, default=FAMILY, help=f"of the AprilTags (default {FAMILY})")
    if placed:
        shown = " ".join(f"{each:g}" for each in ORIGIN_M)
        add(
            "origin-m",
            type=float,
            nargs=3,
            metavar=("X", "Y", "Z"),
            default=ORIGIN_M,
            help=f"world position of the first tag's outer corner, metres (default {shown})",
        )


def board_from(parsed: argparse.Namespace) -> "Board":
    """The board that a command line gives.

    Raises:
        OptionsError: no such board can be; names the value.
    """
    from egophys_core.perception.camera.board import Board, TagFamily

    return Board(
        columns=parsed.board_columns,
        rows=parsed.board_rows,
        tag_side=parsed.board_tag_side_mm / 1000,
        gap=parsed.board_gap_mm / 1000,
        first_id=parsed.board_first_id,
        family=TagFamily(parsed.board_family),
        origin=tuple(getattr(parsed, "board_origin_m", ORIGIN_M)),
    )
