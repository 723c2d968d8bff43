"""Tracks by CoTracker3 (the paper, Appendix B.1).

Karaev et al., "CoTracker3: Simpler and Better Point Tracking by Pseudo-Labelling Real Videos", 2024. Its predictors
take video [1, T, 3, H, W], float, RGB, 0 to 255, and queries [1, N, 3]: view, x, y in pixels; they return tracks
[1, T, N, 2] in pixels and visibility [1, T, N] bool.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Self

import numpy as np

from egophys_core.errors import EpisodeError
from egophys_core.perception.learned.weights import (
    INSTALL_TORCH,
    LearnedModelError,
    first_line,
    require_file,
    require_module,
    rgb,
    to_device,
)
from egophys_core.perception.stages import Tracks, View

INSTALL = "git clone https://github.com/facebookresearch/co-tracker && pip install ./co-tracker (it is not on PyPI)"


class CoTracker3Offline:
    """A `Tracker` that looks at the whole video at once: better through long occlusions, memory grows with length."""

    def __init__(self, model: Any, *, device: str = "cpu") -> None:
        """Use a predictor already made, a `cotracker.predictor.CoTrackerPredictor`, on a device."""
        self._model = to_device(model, device)
        self._device = device

    @classmethod
    def load(cls, checkpoint: Path | str, *, device: str = "cpu") -> Self:
        """Read weights (`scaled_offline.pth`).

        Raises:
            LearnedModelError: the package or the file is missing or the file is of another model.
        """
        return cls(_load("CoTrackerPredictor", checkpoint), device=device)

    def tracks(self, views: Iterable[View], queries: np.ndarray) -> Tracks:
        """Tracks of queries [N, 2], x and y in pixels of the first view.

        Where a track is not visible its pixels are the model's guess.

        Raises:
            EpisodeError: no views, or queries that are not in the first one.
        """
        images = [view.image for view in views]
        check(queries, images[0].shape if images else None)
        if len(queries) == 0:
            return no_tracks(len(images))
        pixels, visible = self._model(video(images, self._device), queries=timed(queries, self._device))
        return from_model(pixels, visible, queries, images[0].shape)


class CoTracker3Online:
    """A `Tracker` that looks at windows of the video, half overlapping: memory does not grow with length."""

    def __init__(self, model: Any, *, device: str = "cpu") -> None:
        """Use a predictor already made, a `cotracker.predictor.CoTrackerOnlinePredictor`, on a device."""
        self._model = to_device(model, device)
        self._device = device

    @classmethod
    def load(cls, checkpoint: Path | str, *, device: str = "cpu") -> Self:
        """Read weights (`scaled_online.pth`).

        Raises:
            LearnedModelError: the package or the file is missing or the file is of another model.
        """
        return cls(_load("CoTrackerOnlinePredictor", checkpoint), device=device)

    def tracks(self, views: Iterable[View], queries: np.ndarray) -> Tracks:
        """Tracks of queries [N, 2], x and y in pixels of the first view.

        Where a track is not visible its pixels are the model's guess.

        Raises:
            EpisodeError: no views, or queries that are not in the first one.
        """
        step = self._model.step
        window: list[np.ndarray] = []
        shape: tuple[int, ...] | None = None
        result, fresh, count = None, 0, 0
        for view in views:
            if shape is None:
                shape = view.image.shape
                check(queries, shape)
            count += 1
            if len(queries) == 0:
                continue
            window.append(view.image)
            fresh += 1
            if len(window) == 2 * step:
                result, fresh = self._advance(window, queries, is_first=result is None), 0
                window = window[step:]
        if shape is None or len(queries) == 0:
            check(queries, shape)
            return no_tracks(count)
        # The last window is shorter; it starts, as all do, a step after the one before.
        if fresh or result is None:
            result = self._advance(window, queries, is_first=result is None)
        return from_model(*result, queries, shape)

    def _advance(self, window: list[np.ndarray], queries: np.ndarray, *, is_first: bool) -> tuple[Any, Any]:
        """Tracks and visibility of all views up to the end of this window."""
        chunk = video(window, self._device)
        if is_first:  # this call only starts a video, it does not look at it
            self._model(chunk, is_first_step=True, queries=timed(queries, self._device))
        pixels, visible = self._model(chunk)
        return pixels, visible


def video(images: list[np.ndarray], device: str) -> Any:
    """[1, T, 3, H, W] float tensor, RGB, 0 to 255, of images [H, W, 3] uint8 BGR."""
    torch = require_module("torch", INSTALL_TORCH)
    return torch.from_numpy(np.stack([rgb(image) for image in images])).to(device).permute(0, 3, 1, 2)[None].float()


def timed(queries: np.ndarray, device: str) -> Any:
    """[1, N, 3] float tensor: view 0, x, y of queries [N, 2]."""
    torch = require_module("torch", INSTALL_TORCH)
    pixels = torch.from_numpy(np.ascontiguousarray(queries, np.float32))
    return torch.cat([torch.zeros(len(queries), 1), pixels], dim=1)[None].to(device)


def from_model(pixels: Any, visible: Any, queries: np.ndarray, shape: tuple[int, ...]) -> Tracks:
    """Tracks of what a predictor returns: exact in the first view, not visible outside the image [H, W, 3]."""
    places = pixels[0].float().cpu().numpy().copy()
    seen = visible[0].cpu().numpy().astype(bool)
    places[0], seen[0] = queries, True
    inside = (places >= -0.5).all(axis=2) & (places[..., 0] <= shape[1] - 0.5) & (places[..., 1] <= shape[0] - 0.5)
    return Tracks(pixels=places.astype(np.float32), visible=seen & inside)  # NaN is not inside


def no_tracks(views: int) -> Tracks:
    """Tracks of no queries."""
    return Tracks(pixels=np.zeros((views, 0, 2), np.float32), visible=np.zeros((views, 0), bool))


def check(queries: np.ndarray, shape: tuple[int, ...] | None) -> None:
    """Check queries against the shape [H, W, 3] of the first image, None if there is none.

    Raises:
        EpisodeError: no views, or queries that are not [N, 2] or not in the image.
    """
    if shape is None:
        raise EpisodeError("there are no views to track in; does the bag hold images on the topic named?")
    if queries.ndim != 2 or queries.shape[1] != 2:
        raise EpisodeError(f"queries must be [N, 2], x and y in pixels, got {queries.shape}")
    inside = (queries >= -0.5).all(axis=1) & (queries[:, 0] <= shape[1] - 0.5) & (queries[:, 1] <= shape[0] - 0.5)
    if not inside.all():
        worst = int(np.argmin(inside))
        raise EpisodeError(
            f"query {worst} at {queries[worst].tolist()} is not in the first view of {shape[1]} x {shape[0]} pixels; "
            "queries are x, y"
        )


def _load(name: str, checkpoint: Path | str) -> Any:
    predictors = require_module("cotracker.predictor", INSTALL)
    path = require_file(checkpoint, "weights of CoTracker3 (scaled_offline.pth or scaled_online.pth)")
    try:
        return getattr(predictors, name)(checkpoint=str(path))
    except Exception as error:  # torch and pickle raise many kinds
        raise LearnedModelError(
            f"{path}: {name} cannot read it ({first_line(error)}); the offline predictor wants "
            "scaled_offline.pth, the online one scaled_online.pth"
        ) from error
