"""The printable sheet of a board: vector rectangles at exact scale, with a ruler to check the print with."""

import io
from collections.abc import Iterator
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from egophys_core.errors import OptionsError
from egophys_core.files import FileKind
from egophys_core.perception.camera.board import Board

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_INCH = 0.0254
_RULER = 0.1
"""Metres."""
_FOOT = 0.035
"""Metres below the board for ruler and text."""


class Paper(StrEnum):
    """Paper sizes, landscape."""

    A2 = "A2"
    A3 = "A3"
    A4 = "A4"
    LETTER = "letter"
    TABLOID = "tabloid"


PAPER_SIZES = {
    Paper.A2: (0.594, 0.420),
    Paper.A3: (0.420, 0.297),
    Paper.A4: (0.297, 0.210),
    Paper.LETTER: (11 * _INCH, 8.5 * _INCH),
    Paper.TABLOID: (17 * _INCH, 11 * _INCH),
}
"""Width and height, metres."""


def black_rectangles(board: Board) -> np.ndarray:
    """[R, 4] metres: x, y, width, height of what is black, board coordinates (y down), none overlapping.

    Cells that lie side by side are one rectangle, so that no printer draws a hairline between them.
    """
    cell = board.tag_side / board.cells_per_tag
    return np.array(
        [
            (left + start * cell, top + row * cell, length * cell, cell)
            for tag, (left, top) in enumerate(board.tag_corners)
            for row, line in enumerate(~board.cells(tag))
            for start, length in _runs(line)
        ]
    )


BOARD_FILE = FileKind(name="a board that this wrote", head=rb"%PDF-1\.4\n%\xac\xdc \xab\xba")
"""A PDF of matplotlib."""


def board_pdf(board: Board, paper: Paper = Paper.A3) -> bytes:
    """The PDF of a board, one page; the same board gives the same bytes.

    Raises:
        OptionsError: the board is larger than the paper.
    """
    stream = io.BytesIO()
    # Without a date the file depends on nothing but the board.
    sheet_figure(board, paper).savefig(stream, format="pdf", metadata={"CreationDate": None})
    return stream.getvalue()


def sheet_figure(board: Board, paper: Paper = Paper.A3) -> "Figure":
    """The page as a matplotlib figure of the paper's size; its only axes are in metres from the lower left corner.

    Raises:
        OptionsError: the board is larger than the paper.
    """
    # The Agg canvas needs no display; pyplot would keep global state.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.collections import PatchCollection
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    width, height = PAPER_SIZES[paper]
    left, top = sheet_origin(board, paper)
    figure = Figure(figsize=(width / _INCH, height / _INCH))
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_xlim(0, width)
    axes.set_ylim(0, height)
    axes.axis("off")
    rectangles = [Rectangle((left + x, top - y - h), w, h) for x, y, w, h in black_rectangles(board)]
    axes.add_collection(PatchCollection(rectangles, facecolor="black", linewidth=0, edgecolor="none", snap=False))

    foot = top - board.size[1] - board.gap
    for step in range(11):
        tick = 0.004 if step % 5 == 0 else 0.0025
        axes.plot([left + step * _RULER / 10] * 2, [foot, foot - tick], color="black", linewidth=0.5)
    axes.plot([left, left + _RULER], [foot, foot], color="black", linewidth=0.5)
    last = board.first_id + board.columns * board.rows - 1
    text = (
        f"{1000 * _RULER:.0f} mm: measure this bar after printing; print at 100 %, not fitted to the page\n"
        f"{board.columns} x {board.rows} tags, AprilTag {board.family}, ids {board.first_id} to {last}, "
        f"side {1000 * board.tag_side:g} mm, gap {1000 * board.gap:g} mm; glue it to something flat"
    )
    axes.text(left, foot - 0.006, text, fontsize=8, va="top", linespacing=1.4)
    return figure


def sheet_origin(board: Board, paper: Paper) -> tuple[float, float]:
    """Where on the page the upper left corner of the board is, metres from the lower left corner of the paper.

    Raises:
        OptionsError: the board, with the white around it, is larger than the paper.
    """
    width, height = PAPER_SIZES[paper]
    needed_width, needed_height = board.size[0] + 2 * board.gap, board.size[1] + board.gap + _FOOT
    if needed_width > width or needed_height > height:
        raise OptionsError(
            f"the board needs {1000 * needed_width:.0f} x {1000 * needed_height:.0f} mm, {paper} has "
            f"{1000 * width:.0f} x {1000 * height:.0f}; take larger paper, smaller or fewer tags"
        )
    return (width - board.size[0]) / 2, height - (height - needed_height) / 2 - board.gap / 2


def _runs(line: np.ndarray) -> Iterator[tuple[int, int]]:
    """Start and length of each run of True in [M] bool."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], line, [False]])))
    for start, end in edges.reshape(-1, 2):
        yield int(start), int(end - start)
