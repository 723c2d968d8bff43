"""Point maps by VGGT (the paper, Sec. 3.1 and Appendix B.1), in metres and in the frame of the world.

Wang et al., "VGGT: Visual Geometry Grounded Transformer", CVPR 2025. It takes images [T, 3, H, W], RGB, 0 to 1, sides
multiples of 14 (518 in training), and returns among others `pose_enc` [1, T, 9] (translation, quaternion x y z w of
camera from world, fields of view), `depth` [1, T, H, W, 1] and `depth_conf` [1, T, H, W], in a frame and a unit of its
own.

Of it only depth and the rotation between views is used where poses are known: the point of a pixel lies on the ray of
the calibrated camera at the predicted depth times one scale for each window. (The paper reads `world_points`; the
authors of VGGT find points by depth and camera the more accurate.)
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from egophys_core.errors import EpisodeError, OptionsError
from egophys_core.perception.learned.anchoring import motion_scale, rays, table_scale, world_on_largest_plane
from egophys_core.perception.learned.similarity import mean_rotation
from egophys_core.perception.learned.weights import (
    INSTALL_TORCH,
    LearnedModelError,
    first_line,
    require_file,
    require_module,
    rgb,
    to_device,
)
from egophys_core.perception.stages import PointMap, View

INSTALL = "git clone https://github.com/facebookresearch/vggt && pip install ./vggt (it is not on PyPI)"
PATCH = 14
BELIEVED = 0.5
"""Lowest confidence of pixels that the scale is found from."""


@dataclass(frozen=True, kw_only=True)
class KnownLength:
    """Two pixels of the first view whose points are a known distance apart."""

    first: tuple[int, int]
    """x and y, pixels."""
    second: tuple[int, int]
    """x and y, pixels."""
    metres: float
    """Distance of the two points, above 0."""


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """What VGGT says of T views, in its own unit and frame."""

    depth: np.ndarray
    """[T, S, S] float64 along the axis of the camera."""
    confidence: np.ndarray
    """[T, S, S] float32 in 0..1."""
    rotation: np.ndarray
    """[T, 3, 3] camera from VGGT's frame."""
    centre: np.ndarray
    """[T, 3] camera centres in VGGT's frame."""


@dataclass(frozen=True, kw_only=True)
class Anchored:
    """One view in metres."""

    pose: np.ndarray
    """[4, 4] world from camera."""
    depth: np.ndarray
    """[S, S] metres."""


class Vggt:
    """A `PointMapper`. Views are taken in windows; the scale of each window is found in this order:

    1. the table, where a view has a pose (`anchoring.table_scale`);
    2. the motion of the camera between views with poses, where it is large enough;
    3. the views shared with the window before;
    4. a known length, in the first view.

    A view without a pose gets one from those with a pose in its window, else from the window before; the first view of
    a recording without any pose stands over the largest plane it sees. A view that cannot be anchored has an unknown
    map.
    """

    def __init__(
        self,
        model: Any,
        *,
        window: int = 1,
        overlap: int = 0,
        table_height: float = 0.0,
        table_area: tuple[float, float, float, float] | None = None,
        known_length: KnownLength | None = None,
        device: str = "cpu",
    ) -> None:
        """Use a model already made, a `vggt.models.vggt.VGGT`.

        Args:
            model: called with images, returns the dictionary described above.
            window: views seen at once; 1 as in the paper, as VGGT supposes that nothing moves but the camera.
            overlap: views that a window shares with the one before, below `window`.
            table_height: z of the table, metres.
            table_area: least x, most x, least y, most y in metres of where only the table or the board is.
            known_length: for recordings without a board.
            device: `cpu` or `cuda`.

        Raises:
            OptionsError: window or overlap do not fit.
        """
        if not 0 <= overlap < window:
            raise OptionsError(f"overlap must be in 0 .. window - 1, got overlap {overlap}, window {window}")
        self._model = to_device(model, device)
        self._window = window
        self._overlap = overlap
        self._table_height = table_height
        self._table_area = table_area
        self._known_length = known_length
        self._device = device
        self.poses: list[np.ndarray] = []
        """[4, 4] pose of each view mapped so far, world from camera: its own, or the one found; NaN if none."""

    @classmethod
    def load(cls, weights: Path | str, *, device: str = "cpu", **options: Any) -> Self:
        """Read weights (`model.pt` of `facebook/VGGT-1B` or of the commercial variant).

        Args:
            weights: file of PyTorch (`.pt`).
            device: `cpu` or `cuda`.
            options: as of the constructor.

        Raises:
            LearnedModelError: the package or the file is missing or the file is of another model.
        """
        package = require_module("vggt.models.vggt", INSTALL)
        torch = require_module("torch", INSTALL_TORCH)
        path = require_file(weights, "weights of VGGT (model.pt)")
        model = package.VGGT()
        try:
            model.load_state_dict(torch.load(path, map_location="cpu", weights_only=True))
        except Exception as error:  # torch and pickle raise many kinds
            raise LearnedModelError(f"{path}: not weights of VGGT: {first_line(error)}") from error
        return cls(model.eval(), device=device, **options)

    def point_maps(self, views: Iterable[View]) -> Iterator[PointMap]:
        """Point map of each view, in order; at most a window of views is held.

        Raises:
            EpisodeError: a side of an image is no multiple of 14, or no view at all could be anchored.
        """
        self.poses = []
        held: list[View] = []
        before: list[Anchored | None] = []
        for view in views:
            held.append(view)
            if len(held) == self._window:
                anchored, confidence = self._anchor(held, before)
                yield from self._maps(held, anchored, confidence, len(before))
                shared = self._window - self._overlap
                held, before = held[shared:], anchored[shared:]
        if len(held) > len(before):
            anchored, confidence = self._anchor(held, before)
            yield from self._maps(held, anchored, confidence, len(before))
        if self.poses and not any(np.isfinite(pose).all() for pose in self.poses):
            raise EpisodeError(
                f"none of {len(self.poses)} views could be given metres: VGGT's scale is arbitrary. Put a board on "
                "the table, or name a known length in the first view"
            )

    def _maps(
        self, views: list[View], anchored: list[Anchored | None], confidence: np.ndarray, done: int
    ) -> Iterator[PointMap]:
        for view, place, certain in list(zip(views, anchored, confidence, strict=True))[done:]:
            if place is None:
                self.poses.append(np.full((4, 4), np.nan))
                yield PointMap(
                    points=np.full((*certain.shape, 3), np.nan, np.float32), confidence=np.zeros_like(certain)
                )
                continue
            self.poses.append(place.pose)
            in_camera = rays(view.camera_matrix, certain.shape) * place.depth[..., None]
            points = in_camera @ place.pose[:3, :3].T + place.pose[:3, 3]
            known = np.isfinite(place.depth) & (place.depth > 0)
            yield PointMap(
                points=np.where(known[..., None], points, np.nan).astype(np.float32),
                confidence=np.where(known, certain, 0).astype(np.float32),
            )

    def _anchor(self, views: list[View], before: list[Anchored | None]) -> tuple[list[Anchored | None], np.ndarray]:
        """Views of a window in metres, None for those that cannot be, and the confidence [T, S, S]."""
        seen = self._predict(views)
        own = [view.world_from_camera for view in views]
        known = {index: pose for index, pose in enumerate(own) if np.isfinite(pose).all()}
        for index, place in enumerate(before):
            if place is not None:
                known.setdefault(index, place.pose)
        believed = seen.confidence >= BELIEVED
        rotation = mean_rotation(np.stack([known[i][:3, :3] @ seen.rotation[i] for i in known])) if known else None
        scale = self._scale(views, before, seen, known, rotation, believed)
        if scale is None:
            return [None] * len(views), seen.confidence
        if rotation is None:
            # Nothing is known but the scale: the first view of all makes the world.
            points = (rays(views[0].camera_matrix, seen.depth[0].shape) * scale * seen.depth[0][..., None])[believed[0]]
            known[0] = world_on_largest_plane(points[:: max(len(points) // 5000, 1)])
            rotation = known[0][:3, :3] @ seen.rotation[0]
        shift = np.mean([known[i][:3, 3] - scale * rotation @ seen.centre[i] for i in known], axis=0)
        anchored: list[Anchored | None] = []
        for index in range(len(views)):
            pose = np.eye(4)
            pose[:3, :3] = rotation @ seen.rotation[index].T
            pose[:3, 3] = scale * rotation @ seen.centre[index] + shift
            anchored.append(Anchored(pose=known.get(index, pose), depth=scale * seen.depth[index]))
        return anchored, seen.confidence

    def _scale(
        self,
        views: list[View],
        before: list[Anchored | None],
        seen: Prediction,
        known: dict[int, np.ndarray],
        rotation: np.ndarray | None,
        believed: np.ndarray,
    ) -> float | None:
        """Metres per unit of VGGT, None if nothing says it."""
        scale = table_scale(views, seen.depth, believed, table_height=self._table_height, table_area=self._table_area)
        if scale is None and rotation is not None and believed.any():
            world_centres = np.stack([pose[:3, 3] for pose in known.values()])
            scale = motion_scale(
                world_centres, seen.centre[list(known)], rotation, float(np.median(seen.depth[believed]))
            )
        if scale is None:
            ratios = [
                (place.depth / seen.depth[index])[believed[index]]
                for index, place in enumerate(before)
                if place is not None and believed[index].any()
            ]
            scale = float(np.median(np.concatenate(ratios))) if ratios else None
        if scale is None and self._known_length is not None and not self.poses:
            scale = length_scale(self._known_length, views[0], seen.depth[0])
        return scale

    def _predict(self, views: list[View]) -> Prediction:
        torch = require_module("torch", INSTALL_TORCH)
        for view in views:
            if view.image.shape[0] % PATCH or view.image.shape[1] % PATCH:
                raise EpisodeError(
                    f"VGGT takes images whose sides are multiples of {PATCH}, got {view.image.shape[:2]}; use 518"
                )
        images = torch.from_numpy(np.stack([rgb(view.image) for view in views])).permute(0, 3, 1, 2).float() / 255
        with torch.no_grad():
            found = self._model(images.to(self._device))
        numbers = {name: found[name][0].double().cpu().numpy() for name in ("pose_enc", "depth", "depth_conf")}
        rotation, centre = cameras(numbers["pose_enc"])
        return Prediction(
            depth=numbers["depth"][..., 0],
            confidence=confidence(numbers["depth_conf"]),
            rotation=rotation,
            centre=centre,
        )


def length_scale(length: KnownLength, view: View, depth: np.ndarray) -> float:
    """Metres per unit of a depth map [S, S] by a length in its view.

    Raises:
        EpisodeError: the length is not in the view, or is nothing.
    """
    directions = rays(view.camera_matrix, depth.shape)
    ends = []
    for x, y in (length.first, length.second):
        if not (0 <= x < depth.shape[1] and 0 <= y < depth.shape[0]):
            raise EpisodeError(f"the known length ends at pixel ({x}, {y}), which is not in the first view")
        ends.append(directions[y, x] * depth[y, x])
    apart = float(np.linalg.norm(ends[1] - ends[0]))
    if not (apart > 0 and length.metres > 0):
        raise EpisodeError(f"the known length of {length.metres} m must be above 0 and its ends two pixels")
    return length.metres / apart


def confidence(certainty: np.ndarray) -> np.ndarray:
    """[...] float32 in 0..1 of VGGT's confidence c, which is 1 + exp(x): at least 1 and unbounded, no probability.

    The rule is 1 - 1 / c. VGGT is trained with c * error - a * log(c), least where c = a / error: 1 / c is
    proportional to the error it expects, so the rule gives the share of the largest such error that is not expected
    here. 0.5, the threshold of the paper, means half of the largest expected error or less.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        share = 1.0 - 1.0 / np.maximum(certainty, 1.0)
    return np.where(np.isnan(share), 0.0, share).astype(np.float32)


def cameras(pose_encoding: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations [T, 3, 3], camera from VGGT's frame, and centres [T, 3] of encodings [T, 9].

    An encoding is translation, quaternion x y z w, and two fields of view, of camera from VGGT's frame.
    """
    translation, quaternion = pose_encoding[:, :3], pose_encoding[:, 3:7]
    x, y, z, w = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    rotation = np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], axis=1),
            np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], axis=1),
            np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=1),
        ],
        axis=1,
    )
    return rotation, -np.einsum("tji,tj->ti", rotation, translation)
