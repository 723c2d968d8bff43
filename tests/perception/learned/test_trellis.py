"""Completion with shapes whose hidden side is known, and the adapter of TRELLIS with a stand-in for its pipeline.

TRELLIS is not on PyPI, needs a GPU, and its weights are not here: its pipeline itself is not run.
"""

import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.perception.learned.trellis import Trellis, complete, surface_of_voxels
from egophys_core.perception.learned.weights import LearnedModelError
from tests.perception.learned.test_shape_alignment import put, toy

BOX = np.argwhere(np.ones((10, 6, 4), bool)) + [20, 30, 40]


class TrellisStandIn:
    """Steps of `TrellisImageTo3DPipeline` that the adapter calls, with checks of what they are given."""

    def __init__(self, torch, voxels: np.ndarray) -> None:
        self.torch = torch
        self.voxels = voxels
        self.noise: list[float] = []

    def preprocess_image(self, image):
        assert image.mode == "RGBA"
        pixels = np.asarray(image)
        assert pixels[0, 0].tolist() == [30, 20, 10, 0]  # red first, not the object
        assert pixels[5, 5].tolist() == [30, 20, 10, 255]
        return image.convert("RGB")

    def get_cond(self, images):
        assert len(images) == 1
        return {"cond": 1, "neg_cond": 0}

    def sample_sparse_structure(self, cond, num_samples):
        assert num_samples == 1
        assert not self.torch.is_grad_enabled()
        self.noise.append(float(self.torch.rand(1)))
        sample = np.concatenate([np.zeros((len(self.voxels), 1), int), self.voxels], axis=1)
        return self.torch.tensor(sample, dtype=self.torch.int32)


def image_and_mask() -> tuple[np.ndarray, np.ndarray]:
    mask = np.zeros((8, 8), bool)
    mask[4:7, 4:7] = True
    return np.full((8, 8, 3), (10, 20, 30), np.uint8), mask


def test_the_surface_of_a_box_is_its_sides_and_no_inside():
    points = surface_of_voxels(BOX)
    assert len(points) == 10 * 6 * 4 - 8 * 4 * 2
    np.testing.assert_allclose(points.min(axis=0), (np.array([20, 30, 40]) + 0.5) / 64 - 0.5)
    np.testing.assert_allclose(points.max(axis=0), (np.array([29, 35, 43]) + 0.5) / 64 - 0.5)


def test_a_box_that_fills_the_grid_has_its_sides_as_well():
    assert len(surface_of_voxels(np.argwhere(np.ones((4, 4, 4), bool)), resolution=4)) == 4**3 - 2**3


def test_the_hidden_side_is_added_and_what_was_seen_is_left_as_it_was():
    true = put(60, 0.3)
    placed = true.apply(toy())
    visible = placed[placed[:, 2] > 0.09]
    hidden = complete(toy(), visible, ground_height=0.0, spacing=0.01)
    below = placed[(placed[:, 2] < 0.07) & (placed[:, 2] >= 0.0)]
    assert np.linalg.norm(below[:, None] - hidden[None, ::3], axis=2).min(axis=1).max() < 0.03
    assert np.linalg.norm(visible[:, None] - hidden[None], axis=2).min() > 0.01
    assert hidden[:, 2].min() >= 0.0


def test_a_shape_of_something_else_is_refused():
    generator = np.random.default_rng(0)
    stick = generator.uniform(-1, 1, (500, 3)) * [0.5, 0.01, 0.01]
    room = generator.uniform(-0.2, 0.2, (500, 3))
    with pytest.raises(EpisodeError, match="does not fit"):
        complete(stick, room, ground_height=-1.0, spacing=0.01)


def test_the_surface_comes_from_the_first_stage_and_the_seed_is_used():
    torch = pytest.importorskip("torch", reason="torch is not installed (pip install .[learned])")
    pipeline = TrellisStandIn(torch, BOX)
    model = Trellis(pipeline)
    image, mask = image_and_mask()
    points = model.surface(image, mask, seed=3)
    np.testing.assert_array_equal(points, surface_of_voxels(BOX))
    model.surface(image, mask, seed=3)
    model.surface(image, mask, seed=4)
    assert pipeline.noise[0] == pipeline.noise[1] != pipeline.noise[2]


def test_nothing_to_complete_and_nothing_made_are_told():
    torch = pytest.importorskip("torch", reason="torch is not installed (pip install .[learned])")
    image, mask = image_and_mask()
    with pytest.raises(EpisodeError, match="mask is empty"):
        Trellis(TrellisStandIn(torch, BOX)).surface(image, np.zeros_like(mask))
    with pytest.raises(EpisodeError, match="seed 0; try another"):
        Trellis(TrellisStandIn(torch, BOX[:0])).surface(image, mask)


def test_loading_says_what_is_missing_before_anything_is_read(tmp_path, monkeypatch):
    with pytest.raises(LearnedModelError, match=r"pipeline.json: no such file"):
        Trellis.load(tmp_path)
    (tmp_path / "pipeline.json").write_text("{}")
    pytest.importorskip("torch", reason="torch is not installed (pip install .[learned])")
    monkeypatch.setenv("TORCH_HOME", str(tmp_path))
    with pytest.raises(LearnedModelError, match="holds no DINOv2"):
        Trellis.load(tmp_path)
    (tmp_path / "hub" / "facebookresearch_dinov2_main").mkdir(parents=True)
    (tmp_path / "hub" / "checkpoints").mkdir()
    (tmp_path / "hub" / "checkpoints" / "dinov2_vitl14_reg4_pretrain.pth").write_bytes(b"")
    with pytest.raises(LearnedModelError, match=r"github.com/microsoft/TRELLIS"):
        Trellis.load(tmp_path)
