"""How good a calibration is, why, and what to film differently."""

import numpy as np

from egophys_core.errors import EpisodeError
from egophys_core.perception.camera.lens import SquareView
from egophys_core.perception.camera.lens_calibration import LensCalibration
from egophys_core.perception.remarks import Level, Remark, graded, verdict_of

FLATNESS = 0.0003
"""Share of the focal length: no board is so flat and no lens so rigid that it is known better."""
CELLS = 8
"""Parts of the image along its longer side, for what of it the board was in."""


def judge_calibration(calibration: LensCalibration) -> tuple[str, tuple[Remark, ...]]:
    """`good`, `usable` or `poor`, and what says so."""
    camera = calibration.camera
    views, diagonal = len(calibration.views), float(np.hypot(camera.width, camera.height))
    deviation = focal_deviation(calibration)
    tilt = float(np.percentile(tilts_deg(calibration), 80))
    covered = coverage(calibration)
    error = calibration.held_out_px
    remarks = [
        graded(
            "views",
            views,
            ok=15,
            bad=8,
            text=f"{views} sharp, different ones",
            advice="film longer, 20 to 60 s, slowly",
        ),
        graded(
            "tilt",
            tilt,
            ok=25,
            bad=12,
            text=f"a fifth of the views are tilted by more than {tilt:.0f} degrees",
            advice="tilt the camera: look at the board from the left, the right, above and below, by 30 to 45 degrees; "
            "seen straight on, a longer lens and a longer distance look alike",
        ),
        graded(
            "coverage",
            covered,
            ok=0.6,
            bad=0.3,
            text=f"the board was in {100 * covered:.0f} % of the image",
            advice="bring the board near, so that it fills half the image, and into each corner in turn",
        ),
        graded(
            "error",
            error / diagonal,
            ok=0.0006,
            bad=0.002,
            text=f"tags of views left out of the fit are {error:.2f} pixels beside (root mean square)",
            advice="lay the board flat on something hard, switch off autofocus, zoom and stabilisation, more light",
        ),
        graded(
            "focal length",
            deviation,
            ok=0.003,
            bad=0.01,
            text=f"{camera.matrix[0, 0]:.1f} pixels, certain to {100 * deviation:.2f} %",
            advice="film more views that differ: tilted, near and far, in the corners",
        ),
    ]
    try:
        SquareView(camera)
    except EpisodeError as problem:
        remarks.append(Remark(name="lens", level=Level.BAD, text=str(problem), advice="fill the corners of the image"))
    return verdict_of(remarks), tuple(remarks)


def focal_deviation(calibration: LensCalibration) -> float:
    """Standard deviation of the focal length, share of it, with what a flat board and a rigid lens leave."""
    return float(np.hypot(calibration.focal_deviation, FLATNESS))


def tilts_deg(calibration: LensCalibration) -> np.ndarray:
    """[V] degrees between the camera's axis and the board's normal."""
    return np.asarray(np.degrees(np.arccos(np.clip(np.abs(calibration.camera_from_board[:, 2, 2]), 0, 1))))


def coverage(calibration: LensCalibration) -> float:
    """Share of the image's cells that a corner of a tag was in, 0..1."""
    camera = calibration.camera
    cell = max(camera.width, camera.height) / CELLS
    size = np.ceil(np.array([camera.width, camera.height]) / cell).astype(int)
    corners = np.concatenate([view.corners.reshape(-1, 2) for view in calibration.views])
    places = np.clip((corners + 0.5) // cell, 0, size - 1).astype(int)
    return len(np.unique(places, axis=0)) / float(np.prod(size))
