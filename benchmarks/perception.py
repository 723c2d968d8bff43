"""Errors and cost of perception on recorded videos with measured points, and on drawn ones with exact truth."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.drawn_video import SCENES, draw_video, write_bag
from egophys_core.cli.perception_benchmark import measure, read_measured
from egophys_core.perception.camera.board import Board
from egophys_core.perception.options import PerceptionOptions

RECORDED = Path(__file__).resolve().parents[2] / "shared/data/video"
HOW = {
    "points": "points of the episode that stand for a measured one at rest, followed by their ids; recorded videos: "
    "noise of 1.5 mm along each axis is in the measured points, and so 2.4 mm in the mean; drawn ones: exact",
    "coverage": "share of the measured (visible) points of all frames that are reconstructed",
    "pose": "drawn videos: against the exact poses; null for recorded ones, which have no true poses",
    "mask": "drawn videos: J and F of the object's mask; null for recorded ones; points_in_mask is the share of the "
    "measured points whose projection lies in the mask",
    "track": "TAP-Vid's delta_avg, AJ and OA of the measured points projected with the true poses, or those found",
    "seconds": "elapsed time of perceiving on this machine; cpu_seconds: of all threads",
}
"""Where the numbers come from; written beside them."""


def run() -> dict[str, Any]:
    """Measure; the keys of `results/perception.json`."""
    rows = [_row(bag) for bag in sorted(RECORDED.iterdir())]
    with TemporaryDirectory() as folder:
        rows += [_row(write_bag(Path(folder) / name, draw_video(name))) for name in SCENES]
    return {"rows": rows, "how": HOW}


def _row(bag: Path) -> dict[str, Any]:
    row = measure(bag, read_measured(bag), PerceptionOptions(), Board())
    print(f"{row['video']}: {row['mean_mm']:.2f} mm, {row['seconds']:.0f} s", flush=True)
    return row
