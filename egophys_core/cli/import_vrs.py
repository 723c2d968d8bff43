"""`egophys import-vrs VRS --out BAG`."""

import argparse
from dataclasses import asdict
from pathlib import Path

from egophys_core.cli.display import print_json, progress_bar

CAMERA_LABEL = "camera-rgb"
"""That of `import_vrs`, which is not loaded for `--help`."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument("vrs", type=Path, metavar="VRS", help=".vrs file")
    parser.add_argument("--out", required=True, type=Path, metavar="BAG", help="rosbag2 folder to write")
    parser.add_argument("--camera", default=CAMERA_LABEL, help=f"label of the camera (default {CAMERA_LABEL})")
    parser.add_argument("--size", type=int, help="width and height of the images (default: as recorded)")
    parser.add_argument("--focal-length", type=float, help="of the images, pixels (default: keeps the resolution)")
    parser.add_argument(
        "--quarter-turns",
        type=int,
        default=1,
        choices=range(4),
        help="to the right until upright (default 1, as Aria Gen 1 needs)",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a line")


def run(parsed: argparse.Namespace) -> int:
    """Import."""
    from egophys_core.recording.vrs import import_vrs

    with progress_bar() as report:
        video = import_vrs(
            parsed.vrs,
            parsed.out,
            camera=parsed.camera,
            size=parsed.size,
            focal_length=parsed.focal_length,
            quarter_turns=parsed.quarter_turns,
            progress=lambda share: report("import", share),
        )
    if parsed.json:
        print_json({"bag": str(parsed.out), **asdict(video)})
    else:
        left_out = f", {video.left_out} not decodable left out" if video.left_out else ""
        print(f"{video.frames} images of {video.size} x {video.size}, {video.seconds:.1f} s{left_out}, in {parsed.out}")
    return 0
