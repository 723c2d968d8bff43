"""A camera's intrinsics as a file, in the YAML that ROS's camera_calibration writes and camera_info_manager reads."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from egophys_core.errors import EpisodeError, RecordingError
from egophys_core.files import FileKind
from egophys_core.perception.camera.frame_source import FrameSource
from egophys_core.perception.camera.lens import Camera, DistortionModel, require_plausible, turned_matrix

_ALIASES = {"fisheye": DistortionModel.EQUIDISTANT, "": DistortionModel.PLUMB_BOB}
_SAME_SHAPE = 0.005
"""Ratios of width to height that differ by less, relatively, are one: sizes are even numbers of pixels."""


@dataclass(frozen=True, kw_only=True)
class Intrinsics:
    """What a file says of a camera."""

    camera: Camera
    """For images of its own size."""
    rotation_deg: int | None = None
    """Clockwise turn that the film asked for which it was calibrated with; None if the file does not say."""
    source: str = ""
    """Where it came from, for messages."""


def read_intrinsics(path: Path | str) -> Intrinsics:
    """Read a calibration.

    Raises:
        RecordingError: no such file, no YAML, or a part is missing; names it.
        EpisodeError: numbers that describe no camera.
    """
    path = Path(path)
    try:
        content = yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise RecordingError(f"cannot read intrinsics {path}: {error}") from error
    needed = ("image_width", "image_height", "camera_matrix", "distortion_coefficients")
    missing = [name for name in needed if not isinstance(content, dict) or name not in content]
    if missing:
        raise RecordingError(
            f"{path}: is no camera calibration of ROS, {', '.join(missing)} missing; `egophys calibrate-camera` "
            "writes one"
        )
    named = str(content.get("distortion_model", ""))
    try:
        camera = Camera(
            width=_whole_number(content, "image_width"),
            height=_whole_number(content, "image_height"),
            matrix=_numbers(content, "camera_matrix", count=9).reshape(3, 3),
            model=_ALIASES.get(named, named),  # type: ignore[arg-type]  # Camera says which there are
            coefficients=_numbers(content, "distortion_coefficients"),
        )
        require_plausible(camera)
        rotation = None if content.get("rotation_deg") is None else _whole_number(content, "rotation_deg")
        if rotation is not None and rotation % 90:
            raise ValueError(f"rotation_deg must be a multiple of 90, got {rotation}")
        return Intrinsics(camera=camera, rotation_deg=None if rotation is None else rotation % 360, source=str(path))
    except EpisodeError as error:
        raise EpisodeError(f"{path}: {error}") from error
    except (TypeError, ValueError) as error:
        raise RecordingError(f"{path}: not the numbers of a camera calibration: {error}") from error


INTRINSICS_FILE = FileKind(name="a calibration of a camera", head=rb".*^camera_matrix:")


def intrinsics_text(intrinsics: Intrinsics, *, name: str = "ego", comment: str = "") -> str:
    """The YAML of a calibration, which `read_intrinsics` and ROS read.

    Args:
        intrinsics: to write.
        name: of the camera.
        comment: lines that are put before it.
    """
    camera = intrinsics.camera
    projection = np.hstack([camera.matrix, np.zeros((3, 1))])
    content: dict[str, Any] = {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": name,
        "camera_matrix": _matrix(camera.matrix),
        "distortion_model": str(camera.model),
        "distortion_coefficients": _matrix(camera.coefficients[None]),
        "rectification_matrix": _matrix(np.eye(3)),
        "projection_matrix": _matrix(projection),
    }
    if intrinsics.rotation_deg is not None:
        content["rotation_deg"] = intrinsics.rotation_deg
    commented = "".join(f"# {line}\n" for line in comment.splitlines())
    return commented + yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120)


def camera_of(source: FrameSource, intrinsics: Intrinsics) -> tuple[Camera, tuple[str, ...]]:
    """The camera of a video's images, from a calibration at the same or another size, held alike or turned.

    Returns:
        The camera, and sentences for the user on what was done to the calibration.

    Raises:
        EpisodeError: the images have another ratio of width to height, so they show another part of what the sensor
            sees, and nobody knows which.
    """
    camera, notes = intrinsics.camera, []
    turns = _quarter_turns(source, intrinsics)
    if turns:
        camera = turned(camera, -turns)
        notes.append(f"the calibration was turned by {90 * turns} degrees, as the film was against it")
    if not _has_shape(camera, source):
        raise EpisodeError(
            f"{source.path}: its images are {source.width} x {source.height}, {intrinsics.source or 'the calibration'} "
            f"is of {camera.width} x {camera.height}, another ratio of width to height: calibrate at the setting that "
            "the video was filmed with"
        )
    if (camera.width, camera.height) != (source.width, source.height):
        notes.append(
            f"the calibration of {camera.width} x {camera.height} was scaled to {source.width} x {source.height}; "
            "that is right only if the camera shows the same part of the scene at both sizes"
        )
        camera = scaled(camera, source.width, source.height)
    return camera, tuple(notes)


def scaled(camera: Camera, width: int, height: int) -> Camera:
    """The camera of the same images at another size, pixels."""
    shares = np.array([width / camera.width, height / camera.height])
    matrix = camera.matrix.copy()
    matrix[[0, 1], [0, 1]] *= shares
    # Pixel centres are at integers, so the image's corner at -0.5 stays.
    matrix[:2, 2] = (matrix[:2, 2] + 0.5) * shares - 0.5
    return replace(camera, width=width, height=height, matrix=matrix)


def turned(camera: Camera, turns: int) -> Camera:
    """The camera of the images turned counter-clockwise by so many quarter turns."""
    for _ in range(turns % 4):
        coefficients = camera.coefficients.copy()
        if camera.model != DistortionModel.EQUIDISTANT:
            # The tangential part is a vector, (p2, p1) at the places (3, 2), and turns with the image.
            coefficients[2], coefficients[3] = -camera.coefficients[3], camera.coefficients[2]
        camera = replace(
            camera,
            width=camera.height,
            height=camera.width,
            matrix=turned_matrix(camera.matrix, camera.width),
            coefficients=coefficients,
        )
    return camera


def _quarter_turns(source: FrameSource, intrinsics: Intrinsics) -> int:
    """Clockwise, of the video's images against those of the calibration."""
    if source.rotation_deg is None:
        return 0
    if intrinsics.rotation_deg is not None:
        return (source.rotation_deg - intrinsics.rotation_deg) // 90 % 4
    # A calibration that does not say how the camera was held is of images as they are shown, unless only those as
    # the sensor takes them have its shape.
    camera = intrinsics.camera
    if _has_shape(camera, source) or not _has_shape(turned(camera, 1), source):
        return 0
    return source.rotation_deg // 90


def _has_shape(camera: Camera, source: FrameSource) -> bool:
    return abs(camera.width * source.height / (camera.height * source.width) - 1) < _SAME_SHAPE


def _whole_number(content: dict[str, Any], name: str) -> int:
    try:
        value = float(content[name])
    except (TypeError, ValueError, OverflowError):
        value = np.nan
    # Infinity and NaN are equal to no integer, and `%` makes NaN of them.
    if value % 1 != 0:
        raise ValueError(f"{name} must be a whole number, got {content[name]!r}")
    return int(value)


def _numbers(content: dict[str, Any], name: str, *, count: int | None = None) -> np.ndarray:
    matrix = content[name]
    if isinstance(matrix, dict) and "data" not in matrix:
        raise ValueError(f"{name} has no data")
    try:
        numbers = np.array(matrix["data"] if isinstance(matrix, dict) else matrix, dtype=np.float64).reshape(-1)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{name} is no list of numbers, {error}") from error
    if count is not None and len(numbers) != count:
        raise ValueError(f"{name} must be {count} numbers, got {len(numbers)}")
    return numbers


def _matrix(values: np.ndarray) -> dict[str, Any]:
    data = [float(f"{value:.10g}") for value in values.ravel()]
    return {"rows": values.shape[0], "cols": values.shape[1], "data": data}
