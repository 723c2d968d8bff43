"""`egophys calibrate-camera VIDEO --out YAML`."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from egophys_core.cli.board_arguments import add_board_arguments, board_from
from egophys_core.cli.display import Report, print_json, print_remarks, progress_bar
from egophys_core.cli.import_ import add_source_arguments, source_paths
from egophys_core.files import require_writable, write_atomically

if TYPE_CHECKING:
    from egophys_core.perception.camera.board import Board
    from egophys_core.perception.camera.frame_source import FrameSource
    from egophys_core.perception.camera.tag_edges import SeenTags

MODELS = ("plumb_bob", "rational_polynomial", "equidistant")
"""Those of `DistortionModel`, which is not loaded for `--help`."""
MOST_FRAMES = 240
"""Frames that are looked at, evenly over the video."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument(
        "video", type=Path, metavar="VIDEO", help="of the printed board: film, folder of pictures, or bag"
    )
    parser.add_argument("--out", required=True, type=Path, metavar="YAML", help="calibration to write")
    parser.add_argument(
        "--model",
        choices=("auto", *MODELS),
        default="auto",
        help="of the lens; equidistant is a fisheye; auto (default): what predicts views left out of the fit best",
    )
    parser.add_argument("--force", action="store_true", help="also write a calibration that is poor")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    parser.add_argument("--image-topic", default="/ego/image_raw/compressed", metavar="TOPIC", help="of a bag")
    add_source_arguments(parser, intrinsics=False)
    add_board_arguments(parser, prefix="board-")


def run(parsed: argparse.Namespace) -> int:
    """Calibrate."""
    from egophys_core.perception.camera.calibration_verdict import focal_deviation, judge_calibration
    from egophys_core.perception.camera.frame_source import open_frames
    from egophys_core.perception.camera.intrinsics_file import INTRINSICS_FILE, Intrinsics, intrinsics_text
    from egophys_core.perception.camera.lens import DistortionModel
    from egophys_core.perception.camera.lens_calibration import calibrate, choose_views

    board = board_from(parsed)
    require_writable(parsed.out, INTRINSICS_FILE, inputs=source_paths(parsed))
    source = open_frames(parsed.video, rate_hz=parsed.rate, times=parsed.times, image_topic=parsed.image_topic)
    size = (source.width, source.height)
    with progress_bar() as report:
        seen = _find_tags(source, board, report)
        report("fit", 0.8)
        model = None if parsed.model == "auto" else DistortionModel(parsed.model)
        calibration = calibrate(choose_views(seen, size, board), size, board, model)
    verdict, remarks = judge_calibration(calibration)
    camera, deviation = calibration.camera, focal_deviation(calibration)
    written = verdict != "poor" or parsed.force
    if written:
        comment = (
            f"{verdict}: {calibration.held_out_px:.2f} pixels on views left out of the fit, "
            f"focal length certain to {100 * deviation:.2f} %"
        )
        text = intrinsics_text(Intrinsics(camera=camera, rotation_deg=source.rotation_deg), comment=comment)
        write_atomically(parsed.out, text.encode())
    if parsed.json:
        content: dict[str, Any] = {
            "out": str(parsed.out) if written else None,
            "verdict": verdict,
            "model": str(camera.model),
            "width": camera.width,
            "height": camera.height,
            "camera_matrix": camera.matrix.tolist(),
            "distortion": camera.coefficients.tolist(),
            "held_out_px": calibration.held_out_px,
            "focal_deviation": deviation,
            "views": len(calibration.views),
            "tried_px": calibration.tried,
            "remarks": [vars(each) for each in remarks],
        }
        print_json(content)
    else:
        found = f"{camera.model}, {len(calibration.views)} views of {len(seen)} frames"
        print_remarks(f"{parsed.video.resolve().name}: {found}", remarks)
        done = f"written to {parsed.out}" if written else "not written; --force writes it all the same"
        print(f"{verdict}: {done}")
    return 0 if verdict != "poor" else 1


def _find_tags(source: "FrameSource", board: "Board", report: Report) -> "list[SeenTags]":
    from egophys_core.perception.camera.tag_edges import TagEdgeFinder

    finder = TagEdgeFinder(board)
    seen = []
    for index, frame in enumerate(source.frames(_every(-(-source.count // MOST_FRAMES)))):
        seen.append(finder.find(frame.image, frame.stamp_ns))
        report("tags", 0.8 * min((index + 1) / min(source.count, MOST_FRAMES), 1.0))
    return seen


def _every(step: int) -> Callable[[int], bool]:
    """Of things asked for one after the other, whether this is the first of `step`."""
    asked = -1

    def wanted(_: int) -> bool:
        nonlocal asked
        asked += 1
        return asked % step == 0

    return wanted
