"""The adapter of MediaPipe Hands: with tiny random networks from files, and with ones that know a drawn hand.

The published weights are not here. The drawn hand has a dot of its own colour for each landmark; the stand-in for the
network of landmarks finds them in the picture that it is given.
"""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from egophys_core.cli.main import main
from egophys_core.errors import EpisodeError, OptionsError
from egophys_core.perception import PerceptionOptions
from egophys_core.perception.hands.landmark_depth import landmark_grip
from egophys_core.perception.learned import LearnedModelError, MediapipeHands, load_landmarker
from egophys_core.perception.learned.mediapipe_hands import palm_anchors
from egophys_core.perception.perceive import perceive
from egophys_core.perception.stages import Masks, View
from tests.perception.hands.drawn_hand import MATRIX, flat_hand, in_camera, seen_hand, turned
from tests.perception.learned.tiny_onnx import write_network
from tests.perception.surface.surface_scene import START_NS, DrawnFrame, bag

PALM, POSE = "palm_detection_mediapipe_2023feb.onnx", "handpose_estimation_mediapipe_2023feb.onnx"
SIDE = 518
PALM_LANDMARKS = [0, 5, 9, 13, 17, 1, 2]
"""Which of the 21 landmarks the seven places of a palm are."""
RGB = np.array([[60 + 9 * index, 250 - 10 * index, 20 + 80 * (index % 3)] for index in range(21)])
UNSEEN = -20.0
"""Logit of no palm."""


def view_of(image: np.ndarray) -> View:
    return View(stamp_ns=0, image=image, camera_matrix=MATRIX, world_from_camera=np.full((4, 4), np.nan))


def drawn(*hands: np.ndarray) -> View:
    """Dots of 5 pixels at landmarks [21, 2]."""
    image = np.zeros((SIDE, SIDE, 3), np.uint8)
    y, x = np.mgrid[:SIDE, :SIDE]
    for pixels in hands:
        for place, colour in zip(pixels, RGB, strict=True):
            image[np.hypot(x - place[0], y - place[1]) < 5] = colour[::-1]
    return view_of(image)


def palms_of(*hands: np.ndarray, logits: tuple[float, ...] = (3.0, 3.0, 3.0)):
    """A network that finds the palms of hands [21, 2], in pixels of the view, each by one anchor near it."""
    rows = np.repeat([0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5, 8.5, 9.5, 10.5, 11.5], 12) / 12
    coarse = np.column_stack([np.tile(rows[::12], 12), rows]).repeat(6, axis=0)

    def run(picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert picture.shape == (1, 192, 192, 3)
        assert picture.dtype == np.float32
        assert 0 <= picture.min() <= picture.max() <= 1
        numbers, found = np.zeros((1, 2016, 18), np.float32), np.full((1, 2016, 1), UNSEEN, np.float32)
        for pixels, logit in zip(hands, logits, strict=False):
            # The middle of the first pixel is half a pixel from the edge of the view.
            palm = (pixels[PALM_LANDMARKS] + 0.5) * 192 / SIDE
            middle, size = (palm.min(axis=0) + palm.max(axis=0)) / 2, np.ptp(palm, axis=0).max()
            free = np.where(found[0, 1152:, 0] == UNSEEN, np.linalg.norm(coarse * 192 - middle, axis=1), np.inf)
            index = int(free.argmin())
            anchor = coarse[index] * 192
            numbers[0, 1152 + index] = [*(middle - anchor), size, size, *(palm - anchor).ravel()]
            found[0, 1152 + index] = logit
        return numbers, found

    return run


class DotReader:
    """A network that finds the dots of the first hand in a picture of it."""

    def __init__(self, *, score: float = 0.9) -> None:
        self.score = score
        self.places = np.zeros((21, 2))

    def __call__(self, picture: np.ndarray) -> tuple[np.ndarray, ...]:
        assert picture.shape == (1, 224, 224, 3)
        assert picture.dtype == np.float32
        colours = 255 * picture[0]
        for index, colour in enumerate(RGB):
            rows, columns = np.nonzero(np.abs(colours - colour).max(axis=-1) < 3)
            self.places[index] = [columns.mean() + 0.5, rows.mean() + 0.5]
        metric = np.column_stack([(self.places - self.places[0]) / 1000, np.arange(21) / 500])
        landmarks = np.column_stack([self.places, np.zeros(21)])
        one = np.ones((1, 1), np.float32)
        return landmarks.reshape(1, 63), self.score * one, 0.2 * one, metric.reshape(1, 63).astype(np.float32)


@pytest.mark.parametrize("turn", [0.0, 0.7, 1.6, 3.1, -2.4])
@pytest.mark.parametrize("middle", [(250.0, 260.0), (180.0, 330.0)])
def test_landmarks_come_back_from_the_upright_picture_of_the_hand(turn, middle):
    truth = seen_hand(turned(flat_hand(), 0.0, 0.0, turn), middle, 0.45)
    reader = DotReader()
    (found,) = MediapipeHands(palms_of(truth.pixels), reader).hands(drawn(truth.pixels))
    assert np.isfinite(reader.places).all()
    # Fingers are up: the middle finger is straight above the wrist.
    across, down = reader.places[12] - reader.places[0]
    assert down < 0
    assert abs(across) < 0.2 * abs(down)
    # The palm's box is a square as wide as 1 / 2.6 of the picture, and its middle half of that below the picture's.
    palm = truth.pixels[PALM_LANDMARKS]
    view_to_picture = np.linalg.lstsq(np.column_stack([truth.pixels, np.ones(21)]), reader.places, rcond=None)[0]
    middle_of_palm = np.append((palm.min(axis=0) + palm.max(axis=0)) / 2, 1) @ view_to_picture
    np.testing.assert_allclose(middle_of_palm, [112, 112 + 224 / 2.6 / 2], atol=0.5)
    np.testing.assert_allclose(found.pixels, truth.pixels, atol=0.7)
    assert found.score == pytest.approx(0.9)
    # It is told for a mirrored picture.
    assert found.right == pytest.approx(0.8)
    # The metric landmarks are turned back with the pixels, and keep their third axis.
    apart = truth.pixels - truth.pixels[0]
    scale = np.linalg.norm(reader.places[12] - reader.places[0]) / np.linalg.norm(apart[12]) / 1000
    np.testing.assert_allclose(found.metric[:, :2], scale * apart, atol=2 * scale)
    np.testing.assert_allclose(found.metric[:, 2], np.arange(21) / 500, atol=1e-6)


def test_depth_of_a_drawn_hand_from_its_image():
    metric = turned(flat_hand(), 0.3, 0.0, 0.9)
    truth = seen_hand(metric, (250.0, 260.0), 0.45)
    read = DotReader()

    def find(picture: np.ndarray) -> tuple[np.ndarray, ...]:
        landmarks, score, right, _ = read(picture)
        up = truth.pixels[9] - truth.pixels[0]
        angle = np.arctan2(up[0], -up[1])
        return landmarks, score, right, turned(metric, 0.0, 0.0, -angle).reshape(1, 63)

    (found,) = MediapipeHands(palms_of(truth.pixels), find).hands(drawn(truth.pixels))
    grip = landmark_grip(found, MATRIX)
    assert grip is not None
    assert grip.depth == pytest.approx(in_camera(metric, (250.0, 260.0), 0.45)[12, 2], rel=0.01)
    np.testing.assert_allclose(grip.pixel, truth.pixels[12], atol=0.7)


def fixed_hand(score: float):
    def find(picture: np.ndarray) -> tuple[np.ndarray, ...]:
        one = np.ones((1, 1), np.float32)
        return np.full((1, 63), 112.0), score * one, one, np.zeros((1, 63))

    return find


def test_unlikely_palms_and_hands_are_left_out():
    hand = seen_hand(flat_hand(), (250, 260), 0.5).pixels
    view = view_of(np.zeros((SIDE, SIDE, 3), np.uint8))

    def count(logit: float, score: float) -> int:
        return len(MediapipeHands(palms_of(hand, logits=(logit,)), fixed_hand(score)).hands(view))

    assert count(0.2, 0.6) == 1
    assert [count(-0.2, 0.6), count(0.2, 0.4), count(0.2, np.nan), count(np.nan, 0.9)] == [0, 0, 0, 0]


def test_one_palm_is_found_once_and_of_three_the_best_two():
    left, middle, right = (seen_hand(flat_hand(), (x, 260), 0.6).pixels for x in (90, 250, 420))
    view = view_of(np.zeros((SIDE, SIDE, 3), np.uint8))
    twice = MediapipeHands(palms_of(middle, middle + 3), fixed_hand(0.9)).hands(view)
    assert len(twice) == 1
    found = MediapipeHands(palms_of(left, middle, right, logits=(1.0, 4.0, 2.0)), fixed_hand(0.9)).hands(view)
    assert [round(hand.pixels[0, 0], -1) for hand in found] == [250, 420]


def test_anchors_are_those_of_the_model():
    """Two in each of 24 by 24 cells, then six in each of 12 by 12, as published with the model."""
    anchors = palm_anchors()
    assert anchors.shape == (2016, 2)
    np.testing.assert_allclose(anchors[:3], [[0.02083333, 0.02083333]] * 2 + [[0.0625, 0.02083333]], atol=1e-7)
    np.testing.assert_allclose(anchors[48], [0.02083333, 0.0625], atol=1e-7)
    np.testing.assert_allclose(anchors[1152:1158], [[0.04166667, 0.04166667]] * 6, atol=1e-7)
    np.testing.assert_allclose(anchors[-1], [0.9583333, 0.9583333], atol=1e-7)


@pytest.mark.parametrize("seed", range(20))
def test_any_outputs_give_hands_or_none(seed):
    rng = np.random.default_rng(seed)

    def wild(*shape: int) -> np.ndarray:
        numbers = rng.normal(size=shape) * 10.0 ** rng.integers(-3, 38, shape)
        unknown = rng.choice([np.nan, np.inf, -np.inf], shape)
        return np.where(rng.random(shape) < 0.02, unknown, numbers).astype(np.float32)

    hands = MediapipeHands(
        lambda _: (wild(1, 2016, 18) if seed % 2 else 100 * rng.random((1, 2016, 18)), wild(1, 2016, 1)),
        lambda _: (wild(1, 63), np.ones((1, 1)), wild(1, 1), wild(1, 63)),
    ).hands(view_of(rng.integers(0, 255, (SIDE, SIDE, 3), np.uint8)))
    assert len(hands) <= 2
    for hand in hands:
        grip = landmark_grip(hand, MATRIX)
        assert grip is None or 0 < grip.depth < np.inf


def tiny_models(folder: Path, **pose: np.ndarray) -> Path:
    """Both files: a palm in the middle of the view, and a hand with random landmarks."""
    rng = np.random.default_rng(3)
    numbers, logits = np.zeros((1, 2016, 18)), np.full((1, 2016, 1), UNSEEN)
    index = 1152 + 6 * (6 * 12 + 6)
    places = [[0, 20], [-8, -6], [0, -8], [8, -6], [14, -2], [-10, 12], [-14, 6]]
    numbers[0, index], logits[0, index] = [0, 0, 40, 40, *np.ravel(places)], 2.0
    folder.mkdir(exist_ok=True)
    write_network(folder / PALM, side=192, biases={"Identity": numbers, "Identity_1": logits})
    outputs = {
        "Identity": rng.uniform(0, 224, (1, 63)),
        "Identity_1": np.full((1, 1), 0.8),
        "Identity_2": np.full((1, 1), 0.3),
        "Identity_3": rng.normal(0, 0.04, (1, 63)),
    }
    write_network(folder / POSE, side=224, biases={**outputs, **pose})
    return folder


def test_tiny_random_models_from_files(tmp_path):
    folder = tiny_models(tmp_path)
    image = np.random.default_rng(0).integers(0, 255, (SIDE, SIDE, 3), np.uint8)
    landmarker = load_landmarker(PerceptionOptions(hands="mediapipe", weights=str(folder)))
    assert landmarker is not None
    (hand,) = landmarker.hands(view_of(image))
    assert hand.pixels.shape == (21, 2)
    assert hand.metric.shape == (21, 3)
    # The picture is 2.6 palms of 40 / 192 of the view wide, and half a palm above it.
    half = 2.6 * 40 / 192 * SIDE / 2
    middle = np.array([0.5 + 0.5 / 12, 0.5 + 0.5 / 12 - 20 / 192]) * SIDE
    assert (np.abs(hand.pixels - middle) < half + 1).all()
    assert np.ptp(hand.pixels, axis=0).min() > half
    assert 0.75 < hand.score < 0.85
    assert 0.65 < hand.right < 0.75
    (same,) = landmarker.hands(view_of(image))
    np.testing.assert_array_equal(same.pixels, hand.pixels)
    (other,) = landmarker.hands(view_of(255 - image // 2))
    assert not np.array_equal(other.pixels, hand.pixels)


def test_no_landmarks_are_loaded_unless_asked_for():
    assert load_landmarker(PerceptionOptions(weights="/nowhere")) is None


def refusal(folder: Path) -> str:
    with pytest.raises(LearnedModelError) as caught:
        load_landmarker(PerceptionOptions(hands="mediapipe", weights=str(folder)))
    assert "docs/learned_models.md" in str(caught.value)
    return str(caught.value)


def test_missing_files_are_named(tmp_path):
    assert "no such folder" in refusal(tmp_path / "nowhere")
    assert PALM in refusal(tmp_path)
    assert POSE in refusal(tmp_path)
    tiny_models(tmp_path)
    (tmp_path / POSE).unlink()
    assert PALM not in refusal(tmp_path)
    with pytest.raises(LearnedModelError, match=rf"{POSE}: no such file"):
        MediapipeHands.load(tmp_path)


def test_what_is_not_the_model_is_told(tmp_path, capfd):
    tiny_models(tmp_path / "wide", Identity_3=np.zeros((1, 62)))
    said = refusal(tmp_path / "wide")
    assert f"{tmp_path / 'wide' / POSE}: gives [1, 63], [1, 1], [1, 1], [1, 62], needed are" in said
    swapped = tiny_models(tmp_path / "swapped")
    (swapped / PALM).write_bytes((swapped / POSE).read_bytes())
    assert "Were the files mixed up?" in refusal(swapped)
    pointer = tiny_models(tmp_path / "pointer")
    (pointer / PALM).write_text("version https://git-lfs.github.com/spec/v1\noid sha256:78ff51c3\nsize 3905734\n")
    assert "Git LFS" in refusal(pointer)
    assert f"{(pointer / PALM).stat().st_size} bytes" in refusal(pointer)
    cut = tiny_models(tmp_path / "cut")
    (cut / POSE).write_bytes((cut / POSE).read_bytes()[:900])
    assert str(cut / POSE) in refusal(cut)
    # OpenCV logs nothing beside.
    assert capfd.readouterr() == ("", "")


def test_the_command_refuses_in_one_line_before_the_work(tmp_path, capsys):
    arguments = ["perceive", str(tmp_path), "--out", str(tmp_path / "out"), "--hands", "mediapipe"]
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert len(said.strip().splitlines()) == 1
    assert "hands mediapipe needs weights" in said


def test_perception_reads_the_models_before_the_work_and_hands_them_over(tmp_path, monkeypatch):
    blank, nothing = np.zeros((320, 320, 3), np.uint8), np.zeros((320, 320), bool)
    frame = DrawnFrame(
        stamp_ns=START_NS,
        image=blank,
        world_from_camera=np.eye(4),
        masks=Masks(object=nothing, hand=nothing),
        points=np.zeros((0, 3)),
    )
    path = bag(tmp_path / "bag", [frame])
    with pytest.raises(LearnedModelError, match="lacks palm_detection"):
        perceive(path, options=PerceptionOptions(hands="mediapipe", weights=str(tmp_path)))

    def seen(*_: object, landmarker: object) -> None:
        assert isinstance(landmarker, MediapipeHands)
        raise EpisodeError("far enough")

    where = "egophys_core.perception.perceive"
    monkeypatch.setattr(f"{where}.find_camera_path", lambda *_, **__: SimpleNamespace(board=None))
    monkeypatch.setattr(f"{where}.SceneObserver", seen)
    with pytest.raises(EpisodeError, match="far enough"):
        perceive(path, options=PerceptionOptions(hands="mediapipe", weights=str(tiny_models(tmp_path / "models"))))


def test_options_that_cannot_be():
    with pytest.raises(OptionsError, match=r"hands mediapipe needs weights.*docs/learned_models.md"):
        PerceptionOptions(hands="mediapipe")
    with pytest.raises(OptionsError, match="goes with stages classical"):
        PerceptionOptions(hands="mediapipe", stages="learned", weights="models")
