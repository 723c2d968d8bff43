"""Images -> files and messages."""

import cv2
import numpy as np

from egophys_core.recording import jazzy_types

COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
JPEG_QUALITY = 90


def png_of(image: np.ndarray) -> bytes:
    """PNG of an image [H, W, 3] uint8 BGR."""
    return bytes(cv2.imencode(".png", image)[1])


def jpeg_message(image: np.ndarray, *, stamp_ns: int, frame_id: str, quality: int = JPEG_QUALITY) -> bytes:
    """Serialized sensor_msgs/CompressedImage of an image [H, W, 3] uint8 BGR.

    Args:
        image: to compress.
        stamp_ns: of the header, nanoseconds since the epoch.
        frame_id: of the header.
        quality: of the JPEG, 1..100.
    """
    types = jazzy_types()
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    message = types.types[COMPRESSED_IMAGE](
        header=types.types["std_msgs/msg/Header"](
            stamp=types.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds), frame_id=frame_id
        ),
        format="jpeg",
        data=cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].ravel(),
    )
    return bytes(types.serialize_cdr(message, COMPRESSED_IMAGE))
