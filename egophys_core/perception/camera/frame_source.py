"""Anyone's video as frames with times: a film (MP4, MOV ...), a folder of pictures, or a bag, all read alike."""

import os
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from egophys_core.episode import LONGEST_GAP_S
from egophys_core.errors import EpisodeError, RecordingError
from egophys_core.perception.camera.image_message import COMPRESSED_IMAGE, IMAGE, decode_image
from egophys_core.perception.camera.lens import Camera
from egophys_core.perception.camera.video import IMAGE_TOPIC, INFO_TOPIC, Frame, VideoWarning, open_video
from egophys_core.recording import list_topics, read_records

FILMS = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm")
PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
BAGS = (".mcap", ".db3")
FIRST_STAMP_NS = 1_000_000_000
"""Stamp of the first frame of a film or folder: they count from their own start, and a stamp of 0 is none in ROS."""

_ERRORS_ONLY = 2
"""Level of OpenCV's log."""
_USUAL_RATE = 30.0
"""Frames a second of a film that says nothing of its rate."""

_SHORTEST_STEP_S = 0.0005
"""Seconds from one picture to the next: half of that at the largest rate, as times are rounded."""

Wanted = Callable[[int], bool]


@dataclass(frozen=True, kw_only=True)
class FrameSource:
    """A video of any kind; it is read anew each time it is iterated."""

    path: Path
    """File or folder."""
    width: int
    """Pixels, of the images as they are yielded."""
    height: int
    count: int
    """Frames there are, about; for progress."""
    rotation_deg: int | None
    """Clockwise turn that a film asks for and that its images have been given: 0, 90, 180, 270; None if not told."""
    camera: Camera | None
    """Intrinsics that the recording holds itself; films and folders hold none."""
    read: Callable[[Wanted], Iterator[Frame]]
    """See `frames`."""

    def frames(self, wanted: Wanted = lambda stamp_ns: True) -> Iterator[Frame]:
        """Yield the frames in order of time.

        Args:
            wanted: asked with the stamp of each frame, nanoseconds, in order; those it declines are not yielded, which
                saves most of the time they take.

        Raises:
            RecordingError: the file cannot be read any more, or an image is of another size than the first.
        """
        for frame in self.read(wanted):
            height, width = frame.image.shape[:2]
            if (width, height) != (self.width, self.height):
                raise RecordingError(
                    f"{self.path}: the image at {frame.stamp_ns * 1e-9:.3f} s is {width} x {height}, the first is "
                    f"{self.width} x {self.height}; a video is of one size"
                )
            yield frame


def open_frames(
    path: Path | str,
    *,
    rate_hz: float | None = None,
    times: Path | None = None,
    image_topic: str = IMAGE_TOPIC,
    info_topic: str = INFO_TOPIC,
) -> FrameSource:
    """Open a film, a folder of pictures or a bag.

    - Films: presentation times as recorded, also where the rate varies; turned upright as their rotation flag says.
    - Folders: pictures in the natural order of their names (`2.png` before `10.png`), turned as their EXIF says, at
      `rate_hz` or at the times in a file.
    - Bags: as `open_video` reads them.

    Args:
        path: file or folder.
        rate_hz: of the pictures in a folder.
        times: text file with the time of each picture in a folder, seconds, one a line.
        image_topic: of a bag's images.
        info_topic: of a bag's CameraInfo.

    Raises:
        RecordingError: nothing of the three, not readable, or a folder's times are missing or do not fit.
    """
    path = Path(path)
    if not path.exists():
        raise RecordingError(f"{path}: no such file or folder")
    is_pictures = path.is_dir() and not _is_bag(path)
    if (rate_hz is not None or times is not None) and not is_pictures:
        raise RecordingError(f"{path}: has times of its own; a rate or a times file is for folders of pictures")
    if is_pictures:
        return _pictures(path, rate_hz, times)
    return _bag(path, image_topic, info_topic) if _is_bag(path) else _film(path)


def _is_bag(path: Path) -> bool:
    if path.is_dir():
        return (path / "metadata.yaml").exists() or any(each.suffix.lower() in BAGS for each in path.iterdir())
    return path.suffix.lower() in BAGS


def _film(path: Path) -> FrameSource:
    capture = _open_film(path)
    readable, image = capture.read()
    if not readable:
        raise RecordingError(f"{path}: no image can be read; is it cut? Copy it again, or convert it to H.264 MP4")
    height, width = image.shape[:2]
    return FrameSource(
        path=path,
        width=width,
        height=height,
        count=max(int(capture.get(cv2.CAP_PROP_FRAME_COUNT)), 1),
        rotation_deg=int(capture.get(cv2.CAP_PROP_ORIENTATION_META)) % 360,
        camera=None,
        read=lambda wanted: _film_frames(path, wanted),
    )


def _open_film(path: Path) -> cv2.VideoCapture:
    # What fails is said here, in words; the libraries' own lines on standard error are for their developers.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    level = cv2.setLogLevel(_ERRORS_ONLY)
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    cv2.setLogLevel(level)
    if not capture.isOpened():
        raise RecordingError(
            f"{path}: is no video that OpenCV reads ({', '.join(FILMS)}), nor a bag ({', '.join(BAGS)}); is it cut?"
        )
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)
    return capture


def _film_frames(path: Path, wanted: Wanted) -> Iterator[Frame]:
    capture = _open_film(path)
    rate = capture.get(cv2.CAP_PROP_FPS)
    step_ns = round(1e9 / rate) if 0.1 < rate < 2000 else round(1e9 / _USUAL_RATE)
    untimed, read, last_ns = 0, 0, FIRST_STAMP_NS - step_ns
    while capture.grab():
        read += 1
        # Milliseconds of the frame just grabbed, from the start of the film: its presentation time.
        stamp_ns = FIRST_STAMP_NS + round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
        if stamp_ns <= last_ns:
            untimed += 1
            stamp_ns = last_ns + step_ns
        last_ns = stamp_ns
        if not wanted(stamp_ns):
            continue
        readable, image = capture.retrieve()
        if readable:
            yield Frame(stamp_ns=stamp_ns, image=np.asarray(image))
    declared = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    if read < declared - 1:
        _warn(f"{path}: {read} of {declared} frames can be read; is it cut?")
    if untimed:
        _warn(f"{path}: {untimed} frames have no time of their own; they are taken {step_ns * 1e-6:.1f} ms apart")


def _pictures(folder: Path, rate_hz: float | None, times: Path | None) -> FrameSource:
    files = sorted((each for each in folder.iterdir() if each.suffix.lower() in PICTURES), key=_natural)
    if not files:
        raise RecordingError(f"{folder}: neither a bag nor a folder with pictures ({', '.join(PICTURES)})")
    if (rate_hz is None) == (times is None):
        raise RecordingError(
            f"{folder}: {len(files)} pictures have no times; give their rate (--rate HZ) or a file with the time of "
            "each in seconds (--times FILE), and not both"
        )
    if times is not None:
        seconds = _read_times(times, len(files))
    else:
        assert rate_hz is not None
        if not (np.isfinite(rate_hz) and 0.1 <= rate_hz <= 1000):
            raise RecordingError(f"{folder}: the rate must be 0.1 .. 1000 pictures a second, got {rate_hz:g}")
        seconds = np.arange(len(files)) / rate_hz
    stamps_ns = FIRST_STAMP_NS + np.rint(1e9 * (seconds - seconds[0])).astype(np.int64)
    height, width = _picture(files[0]).shape[:2]
    return FrameSource(
        path=folder,
        width=width,
        height=height,
        count=len(files),
        rotation_deg=None,
        camera=None,
        read=lambda wanted: _picture_frames(files, stamps_ns, wanted),
    )


def _picture_frames(files: Sequence[Path], stamps_ns: np.ndarray, wanted: Wanted) -> Iterator[Frame]:
    for file, stamp_ns in zip(files, stamps_ns.tolist(), strict=True):
        if wanted(stamp_ns):
            yield Frame(stamp_ns=stamp_ns, image=_picture(file))


def _picture(file: Path) -> np.ndarray:
    image = cv2.imread(str(file), cv2.IMREAD_COLOR)
    if image is None:
        raise RecordingError(f"{file}: is no picture that OpenCV reads; remove it, or copy it again")
    return np.asarray(image)


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sorts names by their numbers: `2.png` before `10.png`."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)]


def _read_times(file: Path, count: int) -> np.ndarray:
    try:
        seconds = np.array([float(line) for line in file.read_text().split()])
    except (OSError, ValueError) as error:
        raise RecordingError(f"{file}: is no list of times, one number (seconds) a line: {error}") from error
    if len(seconds) != count:
        raise RecordingError(f"{file}: has {len(seconds)} times for {count} pictures; one line each is needed")
    if not np.isfinite(seconds).all() or (np.diff(seconds) <= 0).any():
        raise RecordingError(f"{file}: the times must increase from line to line, in seconds")
    steps = np.diff(seconds)
    if len(steps) and (steps.min() < _SHORTEST_STEP_S or steps.max() > LONGEST_GAP_S):
        raise RecordingError(
            f"{file}: its {count} times span {seconds[-1] - seconds[0]:.2g} s, from one to the next "
            f"{steps.min():.2g} .. {steps.max():.2g} s, where {_SHORTEST_STEP_S:g} .. {LONGEST_GAP_S:g} s are read; "
            "give seconds, or leave out what is farther apart or nearer"
        )
    return seconds


def _bag(path: Path, image_topic: str, info_topic: str) -> FrameSource:
    camera = None
    try:
        video = open_video(path, image_topic, info_topic)
        camera = video.camera
    except (EpisodeError, RecordingError):
        # A bag for calibration has no intrinsics yet, or those of an uncalibrated driver; images are only compared
        # with the camera's size.
        width, height = _size_in_bag(path, image_topic)
        any_camera = Camera(width=width, height=height, matrix=np.eye(3), coefficients=np.zeros(5))
        video = open_video(path, image_topic, camera=any_camera)
    return FrameSource(
        path=path,
        width=video.camera.width,
        height=video.camera.height,
        count=len(video),
        rotation_deg=None,
        camera=camera,
        read=lambda wanted: (frame for frame in video.frames() if wanted(frame.stamp_ns)),
    )


def _size_in_bag(path: Path, image_topic: str) -> tuple[int, int]:
    """Width and height of the first image that decodes."""
    images = [each for each in list_topics(path) if each.type in (COMPRESSED_IMAGE, IMAGE) and each.messages > 0]
    chosen = [each for each in images if each.name == image_topic] or images[:1]
    for record in read_records(path, [each.name for each in chosen]):
        try:
            image = decode_image(record.type, record.cdr, source=f"{path}: {record.topic}")
        except RecordingError:
            continue
        return image.shape[1], image.shape[0]
    raise RecordingError(f"{path}: holds no images; record the camera's topic")


def _warn(message: str) -> None:
    warnings.warn(VideoWarning(message), stacklevel=3)
