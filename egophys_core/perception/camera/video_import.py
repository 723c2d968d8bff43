"""Anyone's video -> the standard bag: images as JPEG and the CameraInfo that belongs to them."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from egophys_core.errors import EpisodeError, RecordingError
from egophys_core.perception.camera.frame_source import FrameSource
from egophys_core.perception.camera.image_encoding import COMPRESSED_IMAGE, jpeg_message
from egophys_core.perception.camera.lens import Camera
from egophys_core.perception.camera.video import IMAGE_TOPIC, INFO_TOPIC
from egophys_core.recording import SENSOR_QOS, LogWriter, jazzy_types
from egophys_core.recording.camera_messages import INFO_TYPE, lens_info, stamped_header
from egophys_core.recording.new_bag import new_bag

FRAME_ID = "ego_camera_optical"
JPEG_QUALITY = 95
"""A second lossy coding after the film's own; at 95 it adds less than the film has."""


@dataclass(frozen=True, kw_only=True)
class ImportedFrames:
    """What was written."""

    frames: int
    """Images."""
    seconds: float
    """From the first to the last."""


def import_frames(
    source: FrameSource, camera: Camera, bag: Path | str, *, progress: Callable[[float], None] = lambda share: None
) -> ImportedFrames:
    """Write a video as a bag with `/ego/image_raw/compressed` and `/ego/camera_info`; whole, or not at all.

    Args:
        source: the video.
        camera: of its images (`camera_of`).
        bag: rosbag2 folder to write; must not exist.
        progress: called with the share done, 0..1.

    Raises:
        RecordingError: the video cannot be read or the bag not written.
        EpisodeError: the camera is of images of another size.
    """
    if (camera.width, camera.height) != (source.width, source.height):
        raise EpisodeError(
            f"{source.path}: the camera is of {camera.width} x {camera.height} images, these are "
            f"{source.width} x {source.height}; calibrate at this size"
        )
    size = (camera.width, camera.height)
    stamps: list[int] = []
    with new_bag(Path(bag)) as part, LogWriter(part) as log:
        log.add_topic(IMAGE_TOPIC, COMPRESSED_IMAGE, SENSOR_QOS)
        log.add_topic(INFO_TOPIC, INFO_TYPE, SENSOR_QOS)
        for index, frame in enumerate(source.frames()):
            stamp_ns = frame.stamp_ns
            info = lens_info(
                stamped_header(stamp_ns, FRAME_ID),
                camera.matrix,
                size,
                model=str(camera.model),
                coefficients=camera.coefficients,
            )
            image = jpeg_message(frame.image, stamp_ns=stamp_ns, frame_id=FRAME_ID, quality=JPEG_QUALITY)
            log.write(IMAGE_TOPIC, image, stamp_ns)
            log.write(INFO_TOPIC, bytes(jazzy_types().serialize_cdr(info, INFO_TYPE)), stamp_ns)
            stamps.append(stamp_ns)
            progress(min((index + 1) / source.count, 1.0))
        if not stamps:
            raise RecordingError(f"{source.path}: holds no images that can be read; nothing was written")
    return ImportedFrames(frames=len(stamps), seconds=(stamps[-1] - stamps[0]) * 1e-9)
