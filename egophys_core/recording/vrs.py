"""Recordings of Project Aria glasses (VRS) -> the standard bag, undistorted and upright (the paper, Appendix B.1)."""

import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from egophys_core.errors import RecordingError
from egophys_core.recording.bag_metadata import SENSOR_QOS
from egophys_core.recording.camera_messages import INFO_TYPE, pinhole_info, stamped_header
from egophys_core.recording.log_writer import LogWriter
from egophys_core.recording.message_definitions import jazzy_types
from egophys_core.recording.new_bag import new_bag

CAMERA_LABEL = "camera-rgb"
IMAGE_TOPIC, IMAGE_TYPE = "/ego/image_raw/compressed", "sensor_msgs/msg/CompressedImage"
INFO_TOPIC = "/ego/camera_info"
FRAME_ID = "ego_camera_optical"
JPEG_QUALITY = 95
INSTALL = "pip install -e '.[aria]' in this repository"

Progress = Callable[[float], None]
"""Called with the share done, 0 to 1."""


@dataclass(frozen=True, kw_only=True)
class ImportedVideo:
    """What was written."""

    frames: int
    """Images."""
    left_out: int
    """Images that could not be decoded."""
    seconds: float
    """From the first to the last image."""
    size: int
    """Width and height of the images, pixels."""
    focal_length: float
    """Of the pinhole camera they are of, pixels."""


def import_vrs(
    vrs: Path | str,
    bag: Path | str,
    *,
    camera: str = CAMERA_LABEL,
    size: int | None = None,
    focal_length: float | None = None,
    quarter_turns: int = 1,
    progress: Progress = lambda _: None,
) -> ImportedVideo:
    """Write the images of one camera of a VRS file as a bag with `/ego/image_raw/compressed` and `/ego/camera_info`.

    The bag is whole, or there is none.

    Aria's lens model (FISHEYE624) has no name in CameraInfo, so the images are resampled by `projectaria_tools` as a
    pinhole camera without distortion takes them, then turned upright. Stamps are the capture times of the device's
    clock, which counts from its start and not from the epoch.

    Args:
        vrs: recording with factory calibration.
        bag: rosbag2 folder to write; must not exist.
        camera: label of the camera.
        size: width and height of the images, pixels; None for the width of those recorded.
        focal_length: of the pinhole camera, pixels; None keeps the recorded resolution in the middle of the image.
        quarter_turns: to the right, 0 to 3; the colour camera of Aria Gen 1 is mounted turned by one to the left.
        progress: called now and then.

    Raises:
        RecordingError: projectaria_tools is missing, the file is no VRS file, has no such camera, images or
            calibration, or the bag cannot be written.
    """
    return import_provider(
        open_vrs(vrs),
        bag,
        source=str(vrs),
        camera=camera,
        size=size,
        focal_length=focal_length,
        quarter_turns=quarter_turns,
        progress=progress,
    )


def open_vrs(vrs: Path | str) -> Any:
    """The `VrsDataProvider` of a file.

    Raises:
        RecordingError: projectaria_tools is missing or the file is no VRS file.
    """
    if not Path(vrs).is_file():
        raise RecordingError(f"{vrs}: no such file; needed is a .vrs recording of Project Aria glasses")
    provider = _aria("data_provider").create_vrs_data_provider(str(vrs))
    if provider is None:
        raise RecordingError(f"{vrs}: is no VRS file, or is cut; copy it again from the device or Aria Studio")
    return provider


def import_provider(
    provider: Any,
    bag: Path | str,
    *,
    source: str,
    camera: str = CAMERA_LABEL,
    size: int | None = None,
    focal_length: float | None = None,
    quarter_turns: int = 1,
    progress: Progress = lambda _: None,
) -> ImportedVideo:
    """`import_vrs` of a `VrsDataProvider` already opened; `source` names it in messages."""
    calibration = _aria("calibration")
    if quarter_turns not in range(4):
        raise RecordingError(f"quarter turns must be 0, 1, 2 or 3, got {quarter_turns}")
    stream = provider.get_stream_id_from_label(camera)
    count = provider.get_num_data(stream) if stream is not None else 0
    if count == 0:
        raise RecordingError(f"{source}: holds no images of {camera!r}; was the camera on in the recording profile?")
    device = provider.get_device_calibration()
    lens = device.get_camera_calib(camera) if device is not None else None
    if lens is None:
        raise RecordingError(f"{source}: holds no calibration of {camera!r}; without it no pinhole image can be made")
    width = int(lens.get_image_size()[0])
    size = width if size is None else size
    focal_length = float(lens.get_focal_lengths()[0]) * size / width if focal_length is None else focal_length
    if size < 1 or not focal_length > 0:
        raise RecordingError(f"size and focal length must be above 0 pixels, got {size} and {focal_length}")
    pinhole = calibration.get_linear_camera_calibration(size, size, focal_length, camera)
    info = camera_info(size, focal_length)
    stamps: list[int] = []
    with new_bag(Path(bag)) as part, LogWriter(part) as log:
        log.add_topic(IMAGE_TOPIC, IMAGE_TYPE, SENSOR_QOS)
        log.add_topic(INFO_TOPIC, INFO_TYPE, SENSOR_QOS)
        for index, (stamp_ns, image) in enumerate(_images(provider, stream, count, source)):
            progress(index / count)
            if image is None:
                continue
            if image.shape[:2] != tuple(int(each) for each in lens.get_image_size()[::-1]):
                raise RecordingError(
                    f"{source}: image {index} is {image.shape[1]} x {image.shape[0]}, the calibration is of "
                    f"{lens.get_image_size().tolist()}; the file does not belong to its calibration"
                )
            flat = calibration.distort_by_calibration(image, pinhole, lens)
            upright = np.rot90(flat, -quarter_turns)
            log.write(IMAGE_TOPIC, _image_message(stamp_ns, upright), stamp_ns)
            log.write(INFO_TOPIC, _stamped(info, stamp_ns, INFO_TYPE), stamp_ns)
            stamps.append(stamp_ns)
        if not stamps:
            raise RecordingError(f"{source}: none of {count} images can be decoded; nothing was written")
    progress(1.0)
    return ImportedVideo(
        frames=len(stamps),
        left_out=count - len(stamps),
        seconds=(max(stamps) - min(stamps)) * 1e-9,
        size=size,
        focal_length=focal_length,
    )


def camera_info(size: int, focal_length: float) -> Any:
    """CameraInfo, without a stamp, of square pinhole images whose principal point is the middle, turned or not."""
    middle = (size - 1) / 2
    matrix = np.array([[focal_length, 0, middle], [0, focal_length, middle], [0, 0, 1.0]])
    return pinhole_info(stamped_header(0, FRAME_ID), matrix, (size, size))


def _images(provider: Any, stream: Any, count: int, source: str) -> Iterator[tuple[int, np.ndarray | None]]:
    """Capture time in nanoseconds and image [H, W, 3] uint8 RGB of each; None where it cannot be decoded."""
    for index in range(count):
        data, record = provider.get_image_data_by_index(stream, index)
        image = data.to_numpy_array() if data.is_valid() else None
        if image is not None and (image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8):
            raise RecordingError(
                f"{source}: images are {image.dtype} {image.shape}, needed are uint8 RGB; record with a profile that "
                "stores colour as JPEG, not raw"
            )
        yield int(record.capture_timestamp_ns), image


def _image_message(stamp_ns: int, image: np.ndarray) -> bytes:
    ok, jpeg = cv2.imencode(".jpg", np.ascontiguousarray(image[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not ok:
        raise RecordingError(f"an image of {image.shape} cannot be written as JPEG")
    message = jazzy_types().types[IMAGE_TYPE](header=stamped_header(0, FRAME_ID), format="jpeg", data=jpeg.ravel())
    return _stamped(message, stamp_ns, IMAGE_TYPE)


def _stamped(message: Any, stamp_ns: int, type_name: str) -> bytes:
    message.header = stamped_header(stamp_ns, FRAME_ID)
    return bytes(jazzy_types().serialize_cdr(message, type_name, little_endian=True))


def _aria(module: str) -> Any:
    try:
        return importlib.import_module(f"projectaria_tools.core.{module}")
    except ImportError as error:
        raise RecordingError(f"cannot import projectaria_tools ({error}); install it: {INSTALL}") from error
