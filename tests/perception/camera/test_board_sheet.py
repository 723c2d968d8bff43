"""The printable board: right size, right tags, and the command that writes it."""

import argparse
import json
import re

import cv2
import numpy as np
import pytest

from egophys_core.cli import board as board_command
from egophys_core.errors import OptionsError, OutputError
from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.board_sheet import (
    PAPER_SIZES,
    Paper,
    black_rectangles,
    board_pdf,
    sheet_figure,
    sheet_origin,
)


def run(*arguments: str) -> int:
    parser = argparse.ArgumentParser()
    board_command.add_arguments(parser)
    return board_command.run(parser.parse_args(arguments))


def test_rectangles_are_the_black_cells():
    board = Board()
    rectangles = black_rectangles(board)
    cell = board.tag_side / board.cells_per_tag
    areas = sum(np.count_nonzero(~board.cells(tag)) for tag in range(12)) * cell**2
    assert (rectangles[:, 2] * rectangles[:, 3]).sum() == pytest.approx(areas)
    assert rectangles[:, :2].min(axis=0) == pytest.approx([0, 0])
    assert (rectangles[:, :2] + rectangles[:, 2:]).max(axis=0) == pytest.approx([0.285, 0.21])


def test_layout_is_that_of_opencv_grid_board():
    board = Board()
    grid = cv2.aruco.GridBoard((4, 3), 0.06, 0.015, board.dictionary)
    corners = np.array(grid.getObjPoints())[:, 0, :2]
    assert board.tag_corners == pytest.approx(corners, abs=1e-6)
    assert np.array_equal(grid.getIds().reshape(-1), np.arange(12))


@pytest.mark.parametrize(
    ("board", "paper"),
    [
        (Board(), Paper.A3),
        (Board(), Paper.TABLOID),
        (Board(columns=3, rows=2, tag_side=0.05, first_id=7), Paper.A4),
        (Board(family="25h9", tag_side=0.04, first_id=3), Paper.A3),
    ],
)
def test_opencv_finds_every_tag_of_the_drawn_page_in_its_place(board, paper):
    dots = 127  # five a millimetre: every paper is a whole number of them
    figure = sheet_figure(board, paper)
    figure.set_dpi(dots)
    figure.canvas.draw()
    page = cv2.cvtColor(np.asarray(figure.canvas.buffer_rgba()), cv2.COLOR_RGBA2GRAY)
    assert (page.shape[1], page.shape[0]) == pytest.approx(np.array(PAPER_SIZES[paper]) / 0.0254 * dots, abs=1)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    corners, ids, _ = cv2.aruco.ArucoDetector(board.dictionary, parameters).detectMarkers(page)
    assert sorted(ids.reshape(-1)) == list(range(board.first_id, board.first_id + board.columns * board.rows))
    left, top = sheet_origin(board, paper)
    for tag, found in zip(ids.reshape(-1) - board.first_id, corners, strict=True):
        square = board.tag_corners[tag] + np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * board.tag_side
        metres = np.column_stack([left + square[:, 0], PAPER_SIZES[paper][1] - top + square[:, 1]])
        assert found[0] == pytest.approx(metres / 0.0254 * dots - 0.5, abs=0.8)


def test_pdf_has_the_size_of_the_paper_and_depends_on_the_board_only():
    content = board_pdf(Board())
    assert content == board_pdf(Board())
    assert content.startswith(b"%PDF")
    box = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+)", content)
    assert box is not None
    points = np.array([float(value) for value in box.groups()])
    assert points * 0.0254 / 72 == pytest.approx([0.420, 0.297], abs=1e-6)
    assert b"/Subtype /Image" not in content


def test_board_larger_than_the_paper_is_refused():
    with pytest.raises(OptionsError, match=r"315 x 260 mm, A4 has 297 x 210"):
        board_pdf(Board(), Paper.A4)


def test_command_writes_the_sheet(tmp_path, capsys):
    path = tmp_path / "board.pdf"
    assert run("--out", str(path)) == 0
    assert path.read_bytes() == board_pdf(Board())
    assert "285 x 210 mm" in capsys.readouterr().out
    assert run("--out", str(path), "--paper", "A4", "--tag-side-mm", "40", "--gap-mm", "10", "--json") == 0
    assert json.loads(capsys.readouterr().out)["width_mm"] == pytest.approx(190)


def test_command_refuses_what_cannot_be(tmp_path):
    with pytest.raises(OptionsError, match="tag side"):
        run("--out", str(tmp_path / "board.pdf"), "--tag-side-mm", "60000")
    with pytest.raises(OutputError, match="does not exist"):
        run("--out", str(tmp_path / "nowhere" / "board.pdf"))
