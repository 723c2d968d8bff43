"""Completion of the hidden side of a solid by TRELLIS (the paper, Appendix B.1).

Xiang et al., "Structured 3D Latents for Scalable and Versatile 3D Generation", CVPR 2025. Only its first stage is run:
the occupancy of a grid of 64 x 64 x 64 from one image, z up.
"""

import os
from pathlib import Path
from typing import Any, Self

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.errors import EpisodeError
from egophys_core.perception.learned.shape_alignment import align_shape
from egophys_core.perception.learned.weights import (
    INSTALL_TORCH,
    LearnedModelError,
    first_line,
    require_file,
    require_module,
    rgb,
    to_device,
)

INSTALL = (
    "git clone --recurse-submodules https://github.com/microsoft/TRELLIS, run its setup.sh, and put the clone on "
    "PYTHONPATH (it is not on PyPI)"
)
RESOLUTION = 64
FURTHEST_SHARE = 0.1
"""A generated shape is refused if the visible points are farther from it, on average, than this share of its width."""


class Trellis:
    """Generates the whole shape of an object from one view of it."""

    def __init__(self, pipeline: Any) -> None:
        """Use a pipeline already made, a `TrellisImageTo3DPipeline`."""
        self._pipeline = pipeline

    @classmethod
    def load(cls, folder: Path | str, *, device: str = "cuda") -> Self:
        """Read weights from the folder of `microsoft/TRELLIS-image-large`; its code needs a GPU.

        TRELLIS reads DINOv2 through `torch.hub`, which must be in its cache already: it is not downloaded here.

        Raises:
            LearnedModelError: the package, the folder, or DINOv2 is missing.
        """
        require_file(Path(folder) / "pipeline.json", "the files of TRELLIS-image-large")
        hub = Path(require_module("torch.hub", INSTALL_TORCH).get_dir())
        if not any(hub.glob("facebookresearch_dinov2_*")) or not any(hub.glob("checkpoints/dinov2*")):
            raise LearnedModelError(
                f"{hub}: holds no DINOv2, which TRELLIS reads through torch.hub; put its repository and weights there "
                "or point TORCH_HOME to them. See docs/learned_models.md"
            )
        # The default attention of TRELLIS is a package of its own; what torch has gives the same.
        os.environ.setdefault("ATTN_BACKEND", "sdpa")
        pipelines = require_module("trellis.pipelines", INSTALL)
        try:
            pipeline = pipelines.TrellisImageTo3DPipeline.from_pretrained(str(folder))
        except Exception as error:  # safetensors, json and torch each raise their own kinds
            raise LearnedModelError(f"{folder}: TRELLIS cannot read it: {first_line(error)}") from error
        to_device(pipeline, device)
        return cls(pipeline)

    def surface(self, image: np.ndarray, mask: np.ndarray, *, seed: int = 0) -> np.ndarray:
        """Points [P, 3] on the surface of the object, in a box of -0.5 to 0.5, z up, heading and size arbitrary.

        Args:
            image: [H, W, 3] uint8 BGR.
            mask: [H, W] bool, the object.
            seed: of the noise that the shape is made of.

        Raises:
            EpisodeError: the mask is empty, or TRELLIS makes nothing.
        """
        torch = require_module("torch", INSTALL_TORCH)
        images = require_module("PIL.Image", INSTALL_TORCH)
        if not mask.any():
            raise EpisodeError("the object's mask is empty in the view that is to be completed; take another view")
        alpha = np.where(mask, 255, 0).astype(np.uint8)
        prepared = self._pipeline.preprocess_image(images.fromarray(np.dstack([rgb(image), alpha])))
        torch.manual_seed(seed)
        with torch.no_grad():
            occupied = self._pipeline.sample_sparse_structure(self._pipeline.get_cond([prepared]), 1)
        voxels = occupied[:, 1:].cpu().numpy()  # the first column is the number of the sample
        if len(voxels) == 0:
            raise EpisodeError(f"TRELLIS makes no shape of this view with seed {seed}; try another seed or view")
        return surface_of_voxels(voxels)


def surface_of_voxels(voxels: np.ndarray, resolution: int = RESOLUTION) -> np.ndarray:
    """Middles [P, 3], in a box of -0.5 to 0.5, of occupied voxels [M, 3] int that have a side free."""
    filled = np.zeros((resolution + 2,) * 3, bool)
    filled[tuple(voxels.T + 1)] = True
    inner = slice(1, -1)
    enclosed = filled[inner, inner, inner].copy()
    for axis in range(3):
        for shift in (-1, 1):
            enclosed &= np.roll(filled, shift, axis)[inner, inner, inner]
    surface = np.argwhere(filled[inner, inner, inner] & ~enclosed)
    points: np.ndarray = (surface + 0.5) / resolution - 0.5
    return points


def complete(shape: np.ndarray, visible: np.ndarray, *, ground_height: float, spacing: float) -> np.ndarray:
    """Points [H, 3] in metres on the side of an object that was not seen; those that were seen stay as they are.

    Args:
        shape: [P, 3] points on the whole surface, z up, of unknown place, heading and size.
        visible: [V, 3] metres, points seen.
        ground_height: z of the table, metres; nothing lies below it.
        spacing: metres that points of the shape keep from those seen.

    Raises:
        EpisodeError: too few points, or the shape does not fit those seen.
    """
    world_from_shape, distance = align_shape(shape, visible)
    completed = world_from_shape.apply(shape)
    extent = float(np.ptp(visible, axis=0).max())
    if distance > FURTHEST_SHARE * extent:
        raise EpisodeError(
            f"the generated shape does not fit: visible points are {1000 * distance:.0f} mm from it on average, the "
            f"object is {1000 * extent:.0f} mm wide; try another seed or go on without completion"
        )
    hidden = cKDTree(visible).query(completed)[0] > spacing
    result: np.ndarray = completed[hidden & (completed[:, 2] >= ground_height)]
    return result
