"""`egophys board --out PDF`."""

import argparse
from pathlib import Path

from egophys_core.cli.board_arguments import add_board_arguments, board_from
from egophys_core.cli.display import print_json
from egophys_core.files import require_writable, write_atomically

PAPERS = ("A2", "A3", "A4", "letter", "tabloid")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument("--out", required=True, type=Path, metavar="PDF", help="file to write")
    parser.add_argument("--paper", choices=PAPERS, default="A3", help="default A3")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a sentence")
    add_board_arguments(parser)


def run(parsed: argparse.Namespace) -> int:
    """Draw and write."""
    # OpenCV takes an eighth of a second to load; the other subcommands do without.
    from egophys_core.perception.camera.board_sheet import BOARD_FILE, Paper, board_pdf

    board = board_from(parsed)
    require_writable(parsed.out, BOARD_FILE)
    write_atomically(parsed.out, board_pdf(board, Paper(parsed.paper)))
    width, height = (1000 * extent for extent in board.size)
    if parsed.json:
        print_json({"board": str(parsed.out), "width_mm": width, "height_mm": height, "paper": parsed.paper})
    else:
        print(f"board of {width:g} x {height:g} mm written to {parsed.out}; print it at 100 % on {parsed.paper}")
    return 0
