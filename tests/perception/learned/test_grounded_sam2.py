"""Grounding DINO and SAM 2 as transformers has them, tiny and with random weights, read from folders."""

import json
import os
import shutil

import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.perception.learned import grounded_sam2
from egophys_core.perception.learned.grounded_sam2 import GroundedSam2, disjoint, overlap, sam2_pixels
from egophys_core.perception.learned.weights import LearnedModelError
from egophys_core.perception.stages import View
from tests.perception.learned.tiny_models import SIDE, save_grounding_dino, save_sam2

torch = pytest.importorskip("torch", reason="torch is not installed (pip install .[learned])")
transformers = pytest.importorskip("transformers", reason="transformers is not installed (pip install .[learned])")

HEIGHT, WIDTH = 70, 84


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    # The library asks the hub for nothing here; were it to, this makes it an error.
    os.environ["HF_HUB_OFFLINE"] = "1"
    torch.set_num_threads(1)
    base = tmp_path_factory.mktemp("models")
    return save_grounding_dino(base / "dino"), save_sam2(base / "sam2")


@pytest.fixture
def segmenter(folders):
    return GroundedSam2(*folders, object_prompt="a towel", threshold=0.2)


def views(count: int, seed: int = 0) -> list[View]:
    generator = np.random.default_rng(seed)
    images = generator.integers(0, 256, (count, HEIGHT, WIDTH, 3), dtype=np.uint8)
    return [
        View(stamp_ns=index, image=image, camera_matrix=np.eye(3), world_from_camera=np.eye(4))
        for index, image in enumerate(images)
    ]


def with_boxes(monkeypatch, segmenter, object_boxes, hand_boxes) -> list[tuple[int, str]]:
    """Let the detector find given boxes, hands only in some views; returns the log of what it was asked."""
    asked: list[tuple[int, str]] = []

    def boxes(image, prompt):
        asked.append((int(image[0, 0, 0]), prompt))
        found = object_boxes if prompt == "a towel" else hand_boxes.get(int(image[0, 0, 0]), [])
        return np.array(found or [[0, 0, 1, 1]], float), np.full(max(len(found), 1), 0.9 if found else 0.1)

    monkeypatch.setattr(segmenter, "boxes", boxes)
    return asked


def spy_on_hands(monkeypatch) -> list[int]:
    """How many hands are followed in each view; random weights may well see none of them."""
    followed: list[int] = []

    def spied(one, others):
        followed.append(len(others))
        return disjoint(one, others)

    monkeypatch.setattr(grounded_sam2, "disjoint", spied)
    return followed


def numbered(count: int) -> list[View]:
    for index, view in enumerate(found := views(count)):
        view.image[0, 0, 0] = index
    return found


def test_a_pair_of_masks_for_each_view_of_its_size_and_disjoint(segmenter):
    masks = list(segmenter.masks(iter(views(4))))
    assert len(masks) == 4
    for pair in masks:
        assert pair.object.shape == pair.hand.shape == (HEIGHT, WIDTH)
        assert pair.object.dtype == pair.hand.dtype == bool
        assert not (pair.object & pair.hand).any()
    assert masks[0].object.any()


def test_no_views_are_no_masks(segmenter):
    assert list(segmenter.masks([])) == []


def test_the_same_views_give_the_same_masks_again(segmenter):
    first, second = (list(segmenter.masks(views(3))) for _ in range(2))
    for one, other in zip(first, second, strict=True):
        assert (one.object == other.object).all()
        assert (one.hand == other.hand).all()


def test_views_are_taken_one_by_one(segmenter):
    taken = []

    def stream():
        for view in views(5):
            taken.append(view.stamp_ns)
            yield view

    masks = segmenter.masks(stream())
    next(masks)
    assert taken == [0]


def test_boxes_are_in_the_image_best_first_and_depend_on_the_prompt(segmenter):
    image = views(1)[0].image
    boxes, scores = segmenter.boxes(image, "a towel")
    assert boxes.shape == (12, 4)
    assert (np.diff(scores) <= 0).all()
    assert ((scores >= 0) & (scores <= 1)).all()
    assert (boxes >= 0).all()
    assert (boxes[:, 2] <= WIDTH).all()
    assert (boxes[:, 3] <= HEIGHT).all()
    assert (boxes[:, 2:] > boxes[:, :2]).all()
    assert not np.array_equal(scores, segmenter.boxes(image, "hand")[1])
    np.testing.assert_array_equal(scores, segmenter.boxes(image, " A Towel. ")[1])


def test_boxes_are_those_that_transformers_itself_finds(segmenter):
    image = views(1)[0].image
    inputs = segmenter._processor(images=np.ascontiguousarray(image[..., ::-1]), text="hand.", return_tensors="pt")
    with torch.no_grad():
        outputs = segmenter._detector(**inputs)
    found = segmenter._processor.post_process_grounded_object_detection(
        outputs, inputs["input_ids"], threshold=0.0, target_sizes=[(HEIGHT, WIDTH)]
    )[0]
    boxes, scores = segmenter.boxes(image, "hand")
    np.testing.assert_allclose(np.sort(scores), np.sort(found["scores"].numpy()), atol=1e-6)
    expected = found["boxes"].numpy()[np.argsort(-found["scores"].numpy(), kind="stable")]
    np.testing.assert_allclose(boxes, np.clip(expected, 0, [WIDTH, HEIGHT, WIDTH, HEIGHT]), atol=1e-3)


def test_an_object_that_is_not_found_is_told_with_the_best_score(folders):
    segmenter = GroundedSam2(*folders, object_prompt="a towel", threshold=1.0)
    with pytest.raises(EpisodeError, match=r"prompt 'a towel'.*best score 0\.\d\d|1\.00, threshold 1\.00"):
        next(segmenter.masks(views(1)))


def test_a_hand_is_looked_for_until_it_comes_in(segmenter, monkeypatch):
    asked = with_boxes(monkeypatch, segmenter, [[10, 10, 40, 40]], {20: [[50, 5, 80, 30]]})
    followed = spy_on_hands(monkeypatch)
    masks = list(segmenter.masks(numbered(25)))
    assert asked == [(0, "a towel"), (0, "hand"), (10, "hand"), (20, "hand")]
    assert not any(pair.hand.any() for pair in masks[:20])
    assert followed == [0] * 20 + [1] * 5


def test_two_hands_are_followed_and_a_box_found_twice_is_one(segmenter, monkeypatch):
    hands = [[50, 5, 80, 30], [51, 5, 80, 31], [5, 40, 30, 66], [40, 40, 60, 60]]
    with_boxes(monkeypatch, segmenter, [[10, 10, 40, 40]], {0: hands})
    assert [list(box) for box in segmenter._hand_boxes(numbered(1)[0])] == [hands[0], hands[2]]
    followed = spy_on_hands(monkeypatch)
    list(segmenter.masks(numbered(2)))
    assert followed == [2, 2]


def test_what_is_forgotten_is_not_missed_and_memory_does_not_grow(segmenter, monkeypatch):
    sessions = []
    new_session = segmenter._new_session

    def logits(forget):
        monkeypatch.setattr(grounded_sam2, "forget", forget)
        monkeypatch.setattr(
            segmenter, "_new_session", lambda **each: sessions.append(new_session(**each)) or sessions[-1]
        )
        found = []
        monkeypatch.setattr(grounded_sam2, "disjoint", lambda one, others: found.append([one, *others]))
        list(segmenter.masks(views(30)))
        return np.array(found)

    with_boxes(monkeypatch, segmenter, [[10, 10, 40, 40]], {0: [[50, 5, 80, 30]]})
    everything_kept = logits(lambda *_: None)
    forgetful = logits(grounded_sam2_forget)
    np.testing.assert_array_equal(forgetful, everything_kept)
    assert len(sessions[0].processed_frames) == 30
    assert len(sessions[1].processed_frames) == 0
    assert max(len(each["non_cond_frame_outputs"]) for each in sessions[1].output_dict_per_obj.values()) <= 16


grounded_sam2_forget = grounded_sam2.forget


def test_pixels_and_boxes_are_those_of_the_processor_of_transformers(segmenter):
    try:
        import torchvision  # noqa: F401
    except (ImportError, RuntimeError) as error:
        pytest.skip(f"the processor of SAM 2 in transformers needs torchvision: {error}")
    video = transformers.Sam2VideoVideoProcessor(size={"height": SIDE, "width": SIDE})
    image = views(1)[0].image
    theirs = video(videos=[np.ascontiguousarray(image[None, ..., ::-1])], return_tensors="pt").pixel_values_videos[0]
    # Theirs is resized in whole grey values: at most one of them apart.
    torch.testing.assert_close(sam2_pixels(image, SIDE), theirs, atol=1.01 / 255 / 0.224, rtol=0)


def test_a_pixel_that_both_claim_is_of_the_higher_logit():
    towel = np.array([[2.0, 2.0, -1.0, 1.0, -1.0]])
    hands = [np.array([[1.0, 3.0, -2.0, 1.0, -9.0]]), np.array([[-1.0, -1.0, -2.0, -1.0, 0.5]])]
    masks = disjoint(towel, hands)
    assert masks.object.tolist() == [[True, False, False, True, False]]
    assert masks.hand.tolist() == [[False, True, False, False, True]]
    assert disjoint(towel, []).object.tolist() == [[True, True, False, True, False]]
    assert not disjoint(towel, []).hand.any()


@pytest.mark.parametrize(
    ("other", "expected"), [([0, 0, 2, 2], 1.0), ([1, 0, 3, 2], 1 / 3), ([2, 0, 4, 2], 0.0), ([5, 5, 6, 6], 0.0)]
)
def test_overlap_of_boxes(other, expected):
    assert overlap(np.array([0.0, 0, 2, 2]), np.array(other, float)) == pytest.approx(expected)
    assert overlap(np.zeros(4), np.zeros(4)) == 0.0


def broken(folders, tmp_path, change):
    """Copies of both folders, one of them changed."""
    dino, sam2 = (shutil.copytree(each, tmp_path / each.name) for each in folders)
    change(dino, sam2)
    return dino, sam2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda dino, sam2: shutil.rmtree(dino), "dino: no such folder; needed is that of a Grounding DINO"),
        (lambda dino, sam2: (sam2 / "config.json").unlink(), "sam2: holds no config.json"),
        (lambda dino, sam2: (sam2 / "model.safetensors").unlink(), "sam2: holds no weights"),
        (lambda dino, sam2: (dino / "config.json").write_text("{"), "config.json: not readable"),
        (lambda dino, sam2: (dino / "config.json").write_text("[]"), "config.json: not readable"),
        (lambda dino, sam2: (dino / "model.safetensors").write_bytes(b"\0" * 40), "dino: .*cannot be loaded"),
        (lambda dino, sam2: (dino / "processor_config.json").unlink(), "dino: AutoProcessor cannot be loaded"),
        (lambda dino, sam2: dino.rename(dino.parent / "x") and sam2.rename(dino), "type 'sam2_video'.*mixed up"),
    ],
)
def test_folders_that_lack_something_are_told(folders, tmp_path, change, message):
    dino, sam2 = broken(folders, tmp_path, change)
    with pytest.raises(LearnedModelError, match=message):
        GroundedSam2(dino, sam2, object_prompt="a towel")


def test_weights_of_another_model_are_told_and_not_filled_up_at_random(folders, tmp_path):
    from safetensors.torch import load_file, save_file

    def drop_one(dino, sam2):
        weights = load_file(sam2 / "model.safetensors")
        del weights["no_memory_embedding"]
        save_file(weights, sam2 / "model.safetensors", metadata={"format": "pt"})

    with pytest.raises(LearnedModelError, match="lack 1 of the arrays of Sam2VideoModel, as no_memory_embedding"):
        GroundedSam2(*broken(folders, tmp_path, drop_one), object_prompt="a towel")


def test_the_type_of_a_model_in_config_is_what_the_library_writes(folders):
    assert [json.loads((each / "config.json").read_text())["model_type"] for each in folders] == [
        "grounding-dino",
        "sam2_video",
    ]
