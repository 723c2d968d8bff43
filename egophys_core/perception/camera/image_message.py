"""sensor_msgs/CompressedImage and Image -> BGR arrays; one implementation for bags and for ROS nodes."""

from typing import Any

import cv2
import numpy as np
from rosbags.serde import SerdeError

from egophys_core.errors import RecordingError
from egophys_core.recording import jazzy_types

COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
IMAGE = "sensor_msgs/msg/Image"

_CHANNELS_AND_CONVERSION: dict[str, tuple[int, int | None]] = {
    "bgr8": (3, None),
    "8UC3": (3, None),
    "rgb8": (3, cv2.COLOR_RGB2BGR),
    "bgra8": (4, cv2.COLOR_BGRA2BGR),
    "rgba8": (4, cv2.COLOR_RGBA2BGR),
    "mono8": (1, cv2.COLOR_GRAY2BGR),
    "8UC1": (1, cv2.COLOR_GRAY2BGR),
    "bayer_rggb8": (1, cv2.COLOR_BayerRGGB2BGR),
    "bayer_bggr8": (1, cv2.COLOR_BayerBGGR2BGR),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGBRG2BGR),
    "bayer_grbg8": (1, cv2.COLOR_BayerGRBG2BGR),
}
"""sensor_msgs/image_encodings that are read."""


def decode_image(type_name: str, cdr: bytes, *, source: str) -> np.ndarray:
    """[H, W, 3] uint8 BGR of a serialized CompressedImage or Image.

    Args:
        type_name: which of the two, `sensor_msgs/msg/Image`.
        cdr: the message with its CDR encapsulation.
        source: where it came from, for error messages.

    Raises:
        RecordingError: not such a message, or one `image_of_message` refuses.
    """
    try:
        message = jazzy_types().deserialize_cdr(cdr, type_name)
    # On a cut or damaged message rosbags also fails in numpy, struct and the text decoder.
    except (SerdeError, ValueError, IndexError, AssertionError, MemoryError) as error:
        raise RecordingError(f"{source}: not a readable {type_name}: {error}") from error
    return image_of_message(message, source=source)


def image_of_message(message: Any, *, source: str) -> np.ndarray:
    """[H, W, 3] uint8 BGR of a CompressedImage or Image message object (rclpy's or rosbags').

    JPEG, PNG and what else OpenCV decodes; raw images of 8 bits a channel, with padded rows or not.

    Raises:
        RecordingError: it does not decode, is cut, or has another encoding (names those that are read).
    """
    data = np.frombuffer(message.data, np.uint8)
    if hasattr(message, "encoding"):
        return _raw_image(message, data, source)
    if data.size == 0 or _is_cut_jpeg(data):
        raise RecordingError(f"{source}: the image data are cut after {data.size} bytes")
    try:
        image = cv2.imdecode(data, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error as error:
        raise RecordingError(f"{source}: the image does not decode: {error}") from error
    if image is None:
        raise RecordingError(
            f"{source}: {data.size} bytes that are no image OpenCV decodes (format {message.format!r})"
        )
    return np.asarray(image)


def _is_cut_jpeg(data: np.ndarray) -> bool:
    """Whether a JPEG has no end marker; decoders fill what is missing with grey instead of failing."""
    return data[:2].tobytes() == b"\xff\xd8" and b"\xff\xd9" not in data[-64:].tobytes()


def _raw_image(message: Any, data: np.ndarray, source: str) -> np.ndarray:
    if message.encoding not in _CHANNELS_AND_CONVERSION:
        raise RecordingError(
            f"{source}: image encoding {message.encoding!r} is not read; record one of "
            f"{', '.join(_CHANNELS_AND_CONVERSION)}, or compressed images"
        )
    channels, conversion = _CHANNELS_AND_CONVERSION[message.encoding]
    height, width, step = int(message.height), int(message.width), int(message.step)
    if height < 1 or width < 1 or step < width * channels or data.size < height * step:
        raise RecordingError(
            f"{source}: the image declares {height} rows of {width} pixels, {step} bytes a row, but holds "
            f"{data.size} bytes of {message.encoding}"
        )
    rows = data[: height * step].reshape(height, step)[:, : width * channels]
    image = np.ascontiguousarray(rows).reshape(height, width, channels)
    return image.copy() if conversion is None else np.asarray(cv2.cvtColor(image, conversion))
