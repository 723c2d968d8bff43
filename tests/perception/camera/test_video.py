"""Video out of bags: in order, streamed, and everything missing or wrong is said."""

import tracemalloc
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.writer import Writer

from egophys_core.errors import EpisodeError, RecordingError
from egophys_core.perception.camera.image_message import decode_image
from egophys_core.perception.camera.lens import Camera
from egophys_core.perception.camera.video import REORDERED_FRAMES, Video, VideoWarning, open_video
from egophys_core.recording import jazzy_types, standard_definition

WIDTH, HEIGHT = 48, 32
IMAGE, INFO = "/ego/image_raw/compressed", "/ego/camera_info"
START_NS = 1_700_000_000_000_000_000
STEP_NS = 33_333_333


def header(stamp_ns: int) -> Any:
    types = jazzy_types().types
    stamp = types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id="ego_camera_optical")


def picture(index: int, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """Blue, green and red say which frame it is and which channel is which."""
    return np.full((height, width, 3), (10 + index, 100, 200), np.uint8)


def compressed(stamp_ns: int, image: np.ndarray, suffix: str = ".png", cut: int | None = None) -> tuple[str, Any]:
    data = cv2.imencode(suffix, image)[1].reshape(-1)[:cut]
    kind = "sensor_msgs/msg/CompressedImage"
    return kind, jazzy_types().types[kind](header=header(stamp_ns), format=suffix[1:], data=data)


def raw(stamp_ns: int, image: np.ndarray, encoding: str, padding: int = 0) -> tuple[str, Any]:
    rows = image.reshape(image.shape[0], -1)
    data = np.pad(rows, ((0, 0), (0, padding)), constant_values=77)
    kind = "sensor_msgs/msg/Image"
    return kind, jazzy_types().types[kind](
        header=header(stamp_ns),
        height=image.shape[0],
        width=image.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=data.shape[1],
        data=data.reshape(-1),
    )


def info(stamp_ns: int, width: int = WIDTH, height: int = HEIGHT, focal: float = 40.0) -> tuple[str, Any]:
    types, kind = jazzy_types().types, "sensor_msgs/msg/CameraInfo"
    roi = types["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    return kind, types[kind](
        header=header(stamp_ns),
        height=height,
        width=width,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.array([focal, 0, 23.5, 0, focal, 15.5, 0, 0, 1]),
        r=np.eye(3).reshape(-1),
        p=np.zeros(12),
        binning_x=0,
        binning_y=0,
        roi=roi,
    )


def write_bag(path: Path, messages: Sequence[tuple[str, tuple[str, Any]]]) -> Path:
    """A bag of (topic, (type, message)), logged one after the other."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="test")
        channels: dict[str, int] = {}
        for index, (topic, (kind, content)) in enumerate(messages):
            if topic not in channels:
                schema = writer.register_schema(kind, "ros2msg", standard_definition(kind).text.encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            cdr = bytes(jazzy_types().serialize_cdr(content, kind))
            time = START_NS + index * STEP_NS
            writer.add_message(channels[topic], time, cdr, time)
        writer.finish()
    return path


def bag_of(path: Path, stamps: Sequence[int]) -> Path:
    """A CameraInfo, then frames with these stamps in units of frames; picture i has stamp i."""
    frames = [(IMAGE, compressed(START_NS + stamp * STEP_NS, picture(stamp))) for stamp in stamps]
    return write_bag(path, [(INFO, info(START_NS)), *frames])


def indices(video: Video) -> list[int]:
    """Which pictures come, by their stamps, after checking that each has its stamp."""
    found = []
    for frame in video.frames():
        index = round((frame.stamp_ns - START_NS) / STEP_NS)
        assert (frame.image == picture(index)).all()
        found.append(index)
    return found


def open_quietly(path: Path, **arguments: Any) -> Video:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return open_video(path, **arguments)


def test_frames_come_in_order_and_again(tmp_path):
    video = open_quietly(bag_of(tmp_path / "a.mcap", range(12)))
    assert len(video) == 12
    assert video.stamps_ns[0] == START_NS
    assert video.camera.matrix[0, 0] == 40
    assert indices(video) == list(range(12))
    assert indices(video) == list(range(12))


@pytest.mark.parametrize("encoding", ["bgr8", "rgb8", "bgra8", "rgba8"])
def test_raw_images_with_padded_rows(tmp_path, encoding):
    image = picture(0)[:, :, ::-1] if encoding.startswith("rgb") else picture(0)
    if encoding.endswith("a8"):
        image = np.dstack([image, np.full(image.shape[:2], 255, np.uint8)])
    path = write_bag(tmp_path / "a.mcap", [(INFO, info(1)), ("/ego/image_raw", raw(START_NS, image, encoding, 5))])
    with pytest.warns(VideoWarning, match="taken from /ego/image_raw"):
        video = open_video(path)
    assert (next(video.frames()).image == picture(0)).all()


def test_mono_and_bayer_images(tmp_path):
    gray = np.full((HEIGHT, WIDTH), 90, np.uint8)
    mono = raw(1, gray, "mono8")
    assert (decode_image(mono[0], bytes(jazzy_types().serialize_cdr(mono[1], mono[0])), source="x") == 90).all()
    mosaic = np.zeros((HEIGHT, WIDTH), np.uint8)
    # REP 118 names the first two pixels of the first two rows: red and green, green and blue.
    mosaic[::2, ::2], mosaic[1::2, 1::2], mosaic[::2, 1::2], mosaic[1::2, ::2] = 200, 10, 100, 100
    bayer = raw(1, mosaic, "bayer_rggb8")
    image = decode_image(bayer[0], bytes(jazzy_types().serialize_cdr(bayer[1], bayer[0])), source="x")
    assert (image[4:-4, 4:-4] == (10, 100, 200)).all()


def test_raw_image_of_unknown_encoding_or_cut(tmp_path):
    path = write_bag(tmp_path / "a.mcap", [(INFO, info(1)), (IMAGE, raw(START_NS, picture(0), "yuv422"))])
    with pytest.raises(EpisodeError, match=r"yuv422.*bgr8"):
        list(open_video(path).frames())
    kind, message = raw(START_NS, picture(0), "bgr8")
    message.height = 4000
    with pytest.raises(RecordingError, match="4000 rows"):
        decode_image(kind, bytes(jazzy_types().serialize_cdr(message, kind)), source="x")


def test_late_frames_are_put_in_their_place(tmp_path):
    path = bag_of(tmp_path / "a.mcap", [0, 1, 4, 2, 3, 5, 7, 6, 8, 9, 10, 11, 12])
    with pytest.warns(VideoWarning, match="3 of 13 images are stamped before their predecessor"):
        video = open_video(path)
    assert indices(video) == list(range(13))


def test_frames_that_are_far_too_late_are_dropped(tmp_path):
    path = bag_of(tmp_path / "a.mcap", [*range(2, 14 + REORDERED_FRAMES), 0, 1])
    with pytest.warns(VideoWarning, match="2 of 22 images come over 8 messages late; dropped"):
        video = open_video(path)
    assert indices(video) == list(range(2, 14 + REORDERED_FRAMES))
    assert len(video) == 20


def test_stamps_that_jump_are_one_error_before_any_work(tmp_path):
    with pytest.raises(EpisodeError, match=r"/ego/image_raw/compressed: the stamps jump ahead by .* from frame 2 "):
        open_video(bag_of(tmp_path / "a.mcap", [0, 1, 2, 900, 901]))


def test_repeated_stamps_keep_the_first(tmp_path):
    path = bag_of(tmp_path / "a.mcap", [0, 1, 1, 2, 2, 2, 3])
    with pytest.warns(VideoWarning, match="3 of 7 images repeat a stamp"):
        video = open_video(path)
    assert indices(video) == [0, 1, 2, 3]


def test_headers_without_stamp_use_the_recorders_time(tmp_path):
    frames = [(IMAGE, compressed(0, picture(i))) for i in range(5)]
    path = write_bag(tmp_path / "a.mcap", [(INFO, info(0)), *frames])
    with pytest.warns(VideoWarning, match="all 5 header stamps are 0"):
        video = open_video(path)
    assert [frame.stamp_ns for frame in video.frames()] == [START_NS + (i + 1) * STEP_NS for i in range(5)]


def test_missing_frames_are_counted(tmp_path):
    path = bag_of(tmp_path / "a.mcap", [0, 1, 2, 3, 6, 7, 8, 10, 11])
    with pytest.warns(VideoWarning, match=r"about 3 frames are missing in 2 gaps .* 0\.10 s"):
        video = open_video(path)
    assert indices(video) == [0, 1, 2, 3, 6, 7, 8, 10, 11]


@pytest.mark.parametrize("cut", [0, 200, -30])
def test_frames_that_do_not_decode_are_skipped_and_counted(tmp_path, cut):
    noise = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    frames = [
        (IMAGE, compressed(START_NS + i * STEP_NS, noise, ".jpg", cut if i in (0, 2) else None)) for i in range(4)
    ]
    video = open_quietly(write_bag(tmp_path / "a.mcap", [(INFO, info(1)), *frames]))
    with pytest.warns(VideoWarning, match="2 of 4 images"):
        found = [frame.stamp_ns for frame in video.frames()]
    assert found == [START_NS + STEP_NS, START_NS + 3 * STEP_NS]


def test_frame_of_another_size_is_skipped(tmp_path):
    frames = [(IMAGE, compressed(START_NS + i * STEP_NS, picture(i, WIDTH + (i == 1)))) for i in range(3)]
    video = open_quietly(write_bag(tmp_path / "a.mcap", [(INFO, info(1)), *frames]))
    with pytest.warns(VideoWarning, match="49 x 32"):
        assert indices(video) == [0, 2]


def test_nothing_decodes(tmp_path):
    frames = [(IMAGE, compressed(START_NS + i * STEP_NS, picture(i), ".jpg", 40)) for i in range(3)]
    video = open_quietly(write_bag(tmp_path / "a.mcap", [(INFO, info(1)), *frames]))
    with pytest.raises(EpisodeError, match="none of 3 images"):
        list(video.frames())


def test_black_frames_pass(tmp_path):
    frames = [(IMAGE, compressed(START_NS + i * STEP_NS, 0 * picture(i), ".jpg")) for i in range(3)]
    assert len(list(open_quietly(write_bag(tmp_path / "a.mcap", [(INFO, info(1)), *frames])).frames())) == 3


def test_without_images_or_intrinsics(tmp_path):
    only_images = write_bag(tmp_path / "a.mcap", [(IMAGE, compressed(START_NS, picture(0)))])
    with pytest.raises(RecordingError, match="no camera intrinsics on /ego/camera_info"):
        open_video(only_images)
    given = Camera(
        width=WIDTH, height=HEIGHT, matrix=np.array([[40, 0, 24], [0, 40, 16], [0, 0, 1.0]]), coefficients=np.zeros(0)
    )
    assert indices(open_quietly(only_images, camera=given)) == [0]
    only_info = write_bag(tmp_path / "b.mcap", [(INFO, info(START_NS))])
    with pytest.raises(RecordingError, match="no images on /ego/image_raw/compressed"):
        open_video(only_info)


def test_two_cameras_must_be_told_apart(tmp_path):
    both = [(topic, compressed(START_NS, picture(0))) for topic in ("/left", "/right")]
    path = write_bag(tmp_path / "a.mcap", [(INFO, info(1)), *both])
    with pytest.raises(RecordingError, match=r"/left.*/right.*name the one"):
        open_video(path)
    assert indices(open_quietly(path, image_topic="/right")) == [0]


def test_other_info_topic_is_taken_if_it_is_the_only_one(tmp_path):
    path = write_bag(tmp_path / "a.mcap", [("/cam/info", info(1)), (IMAGE, compressed(START_NS, picture(0)))])
    with pytest.warns(VideoWarning, match="taken from /cam/info"):
        open_video(path)


def test_intrinsics_of_another_size_name_both(tmp_path):
    path = write_bag(tmp_path / "a.mcap", [(INFO, info(1, width=96, height=64)), (IMAGE, compressed(1, picture(0)))])
    with pytest.raises(EpisodeError, match=r"96 x 64.*48 x 32"):
        open_video(path)


def test_intrinsics_that_change(tmp_path):
    infos = [(INFO, info(1, focal=focal)) for focal in (40.0, 40.0, 44.0)]
    path = write_bag(tmp_path / "a.mcap", [*infos, (IMAGE, compressed(START_NS, picture(0)))])
    with pytest.warns(VideoWarning, match="1 messages differ"):
        video = open_video(path)
    assert video.camera.matrix[0, 0] == 40


def test_memory_does_not_grow_with_the_video(tmp_path):
    noise = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    messages = [(INFO, info(1, 320, 240))]
    messages += [(IMAGE, compressed(START_NS + i * STEP_NS, np.roll(noise, i, 0), ".jpg")) for i in range(120)]
    video = open_quietly(write_bag(tmp_path / "a.mcap", messages))
    tracemalloc.start()
    for _ in video.frames():
        pass
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40 * noise.nbytes
