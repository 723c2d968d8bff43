"""Import of Aria recordings with the real lens model, calibration and resampling of projectaria_tools.

No VRS file of Aria is here and none can be written with public Python packages, so what reads the file
(`VrsDataProvider`) is a stand-in that hands out images drawn through the real lens model; only opening a file that is
no VRS file is the real thing.
"""

import sys

import cv2
import numpy as np
import pytest

from egophys_core.cli.main import main
from egophys_core.errors import RecordingError
from egophys_core.recording import jazzy_types, list_topics, read_records
from egophys_core.recording.vrs import IMAGE_TOPIC, INFO_TOPIC, import_provider, import_vrs

WIDTH = 352
SPOTS = np.array([[0.0, 0.0, 1.0], [0.35, 0.1, 1.0], [-0.2, 0.4, 1.0], [-0.45, -0.3, 1.0], [0.1, -0.5, 1.0]])
"""Directions in the frame of the camera as it is mounted."""


@pytest.fixture
def aria():
    return pytest.importorskip(
        "projectaria_tools.core.calibration", reason="projectaria_tools is not installed (pip install .[aria])"
    )


def lens_of(calibration):
    """A lens as those of Aria's colour camera: 15 parameters of FISHEYE624, here of a quarter of its width."""
    from projectaria_tools.core.sophus import SE3

    middle = (WIDTH - 1) / 2 + 1.5
    parameters = [152.0, middle, middle - 2, 0.4, -0.45, 0.12, 0.2, -0.2, 0.05, 1e-3, -2e-3, 1e-3, 1e-4, -1e-3, 1e-4]
    model = calibration.CameraModelType.FISHEYE624
    return calibration.CameraCalibration(
        "camera-rgb", model, np.array(parameters), SE3(), WIDTH, WIDTH, 180.0, 1.2, "serial"
    )


class Provider:
    """The calls of `VrsDataProvider` that the import makes."""

    def __init__(self, lens, images, stamps, *, has_calibration=True):
        self.lens, self.images, self.stamps, self.has_calibration = lens, images, stamps, has_calibration

    def get_stream_id_from_label(self, label):
        return "214-1" if label == "camera-rgb" else None

    def get_num_data(self, stream):
        return len(self.images)

    def get_device_calibration(self):
        return self if self.has_calibration else None

    def get_camera_calib(self, label):
        return self.lens

    def get_image_data_by_index(self, stream, index):
        return Image(self.images[index]), Stamp(self.stamps[index])


class Image:
    def __init__(self, pixels):
        self.pixels = pixels

    def is_valid(self):
        return self.pixels is not None

    def to_numpy_array(self):
        return self.pixels


class Stamp:
    def __init__(self, stamp_ns):
        self.capture_timestamp_ns = stamp_ns


def drawn(lens) -> np.ndarray:
    """[WIDTH, WIDTH, 3] RGB: an orange spot at the place of each direction, on grey."""
    rows, columns = np.mgrid[:WIDTH, :WIDTH]
    image = np.full((WIDTH, WIDTH, 3), 40.0)
    for direction in SPOTS:
        x, y = lens.project(direction)
        near = np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * 2.5**2))[..., None]
        image = image * (1 - near) + near * [255, 140, 0]
    return image.astype(np.uint8)


@pytest.fixture
def provider(aria):
    lens = lens_of(aria)
    return Provider(lens, [drawn(lens)] * 3, [5_000_000_000, 5_033_000_000, 5_066_000_001])


def messages(bag, topic):
    return [jazzy_types().deserialize_cdr(each.cdr, each.type) for each in read_records(bag, [topic])]


def spot_near(image: np.ndarray, place: np.ndarray) -> np.ndarray:
    """x, y of the middle of the orange near a place."""
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
    orange = np.clip(image[..., 2].astype(float) - image[..., 0] - 60, 0, None)
    orange *= np.hypot(columns - place[0], rows - place[1]) < 12
    return np.array([(columns * orange).sum(), (rows * orange).sum()]) / orange.sum()


@pytest.mark.parametrize("quarter_turns", [0, 1, 2, 3])
def test_pixels_are_where_the_pinhole_camera_of_camera_info_sees_them(provider, tmp_path, quarter_turns):
    video = import_provider(
        provider, tmp_path / "bag", source="x.vrs", size=300, focal_length=170.0, quarter_turns=quarter_turns
    )
    assert (video.frames, video.left_out, video.size, video.focal_length) == (3, 0, 300, 170.0)
    info = messages(tmp_path / "bag", INFO_TOPIC)[0]
    image = cv2.imdecode(messages(tmp_path / "bag", IMAGE_TOPIC)[0].data, cv2.IMREAD_COLOR)
    assert image.shape == (info.height, info.width, 3) == (300, 300, 3)
    assert info.distortion_model == "plumb_bob"
    assert not info.d.any()
    turn = np.linalg.matrix_power(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), quarter_turns)
    for direction in SPOTS:
        x, y, z = info.k.reshape(3, 3) @ turn @ direction
        expected = np.array([x, y]) / z
        assert np.linalg.norm(spot_near(image, expected) - expected) < 0.35


def test_by_default_the_resolution_in_the_middle_is_kept(provider, tmp_path):
    video = import_provider(provider, tmp_path / "bag", source="x.vrs")
    assert video.size == WIDTH
    assert video.focal_length == pytest.approx(152.0)
    half = import_provider(provider, tmp_path / "half", source="x.vrs", size=WIDTH // 2)
    assert half.focal_length == pytest.approx(76.0)


def test_image_and_camera_info_come_in_pairs_with_the_capture_time(provider, tmp_path):
    shares = []
    video = import_provider(provider, tmp_path / "bag", source="x.vrs", progress=shares.append)
    assert [(each.name, each.messages) for each in list_topics(tmp_path / "bag")] == [(IMAGE_TOPIC, 3), (INFO_TOPIC, 3)]
    for topic in (IMAGE_TOPIC, INFO_TOPIC):
        records = list(read_records(tmp_path / "bag", [topic]))
        assert [each.log_time_ns for each in records] == provider.stamps
        headers = [jazzy_types().deserialize_cdr(each.cdr, each.type).header for each in records]
        assert [each.stamp.sec * 10**9 + each.stamp.nanosec for each in headers] == provider.stamps
        assert {each.frame_id for each in headers} == {"ego_camera_optical"}
    assert video.seconds == pytest.approx(0.066000001)
    assert shares == [0, pytest.approx(1 / 3), pytest.approx(2 / 3), 1]


def test_images_that_cannot_be_decoded_are_left_out_and_counted(provider, tmp_path):
    provider.images[1] = None
    video = import_provider(provider, tmp_path / "bag", source="x.vrs")
    assert (video.frames, video.left_out) == (2, 1)
    provider.images = [None] * 3
    with pytest.raises(RecordingError, match="none of 3 images"):
        import_provider(provider, tmp_path / "empty", source="x.vrs")


def test_what_cannot_be_imported_is_told_before_anything_is_written(provider, tmp_path):
    bag = tmp_path / "bag"
    with pytest.raises(RecordingError, match="no images of 'camera-slam-left'"):
        import_provider(provider, bag, source="x.vrs", camera="camera-slam-left")
    provider.has_calibration = False
    with pytest.raises(RecordingError, match=r"x.vrs: holds no calibration of 'camera-rgb'"):
        import_provider(provider, bag, source="x.vrs")
    provider.has_calibration = True
    for size, focal_length in ((0, 100.0), (100, 0.0), (100, np.nan)):
        with pytest.raises(RecordingError, match="must be above 0"):
            import_provider(provider, bag, source="x.vrs", size=size, focal_length=focal_length)
    with pytest.raises(RecordingError, match="quarter turns"):
        import_provider(provider, bag, source="x.vrs", quarter_turns=4)
    provider.images = []
    with pytest.raises(RecordingError, match="no images"):
        import_provider(provider, bag, source="x.vrs")
    assert not bag.exists()


def test_images_that_do_not_fit_are_told(provider, tmp_path):
    provider.images = [np.zeros((WIDTH, WIDTH), np.uint8)]
    with pytest.raises(RecordingError, match="needed are uint8 RGB"):
        import_provider(provider, tmp_path / "grey", source="x.vrs")
    provider.images = [np.zeros((WIDTH // 2, WIDTH, 3), np.uint8)]
    with pytest.raises(RecordingError, match=r"image 0 is 352 x 176, the calibration is of \[352, 352\]"):
        import_provider(provider, tmp_path / "cut", source="x.vrs")


def test_a_bag_that_is_there_is_not_overwritten(provider, tmp_path):
    import_provider(provider, tmp_path / "bag", source="x.vrs")
    with pytest.raises(RecordingError, match="exists already"):
        import_provider(provider, tmp_path / "bag", source="x.vrs")


def test_files_that_are_no_vrs_are_told(aria, tmp_path):
    with pytest.raises(RecordingError, match="no such file"):
        import_vrs(tmp_path / "x.vrs", tmp_path / "bag")
    (tmp_path / "x.vrs").write_bytes(b"x" * 1000)
    with pytest.raises(RecordingError, match="is no VRS file"):
        import_vrs(tmp_path / "x.vrs", tmp_path / "bag")
    assert not (tmp_path / "bag").exists()


def test_without_projectaria_tools_it_is_said_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "projectaria_tools.core.data_provider", None)
    (tmp_path / "x.vrs").write_bytes(b"x")
    with pytest.raises(RecordingError, match=r"pip install -e '.\[aria\]'"):
        import_vrs(tmp_path / "x.vrs", tmp_path / "bag")


def test_the_command_prints_what_it_wrote(provider, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("egophys_core.recording.vrs.open_vrs", lambda _: provider)
    assert main(["import", "x.vrs", "--out", str(tmp_path / "bag"), "--size", "100"]) == 0
    assert "3 images of 100 x 100, 0.1 s, in" in capsys.readouterr().out
    assert main(["import", "x.vrs", "--out", str(tmp_path / "bag"), "--json"]) == 2
    assert "exists already" in capsys.readouterr().err
