"""Observations, one by one -> Episode."""

from dataclasses import dataclass, field

import numpy as np

from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError
from egophys_core.geometry import farthest_points
from egophys_core.perception.hands.grip import carried
from egophys_core.perception.hands.hand_points import at_depth
from egophys_core.perception.observation import Observation
from egophys_core.perception.options import Completion, ObjectKind, PerceptionOptions
from egophys_core.perception.stages import View
from egophys_core.perception.surface.rest_surface import RestObject
from egophys_core.perception.surface.surface_render import project
from egophys_core.perception.surface.track_filter import consistent_motion

INFERRED_CONFIDENCE = 0.5
"""Of points that were never seen but inferred from symmetry."""


@dataclass
class EpisodeAssembly:
    """Keeps of each observation what the episode needs: a few points, not the images."""

    options: PerceptionOptions
    rest: RestObject
    _chosen: np.ndarray | None = None
    _stamps_ns: list[int] = field(default_factory=list)
    _points: list[np.ndarray] = field(default_factory=list)
    _confidence: list[np.ndarray] = field(default_factory=list)
    _hands: list[np.ndarray] = field(default_factory=list)
    _motions: list[np.ndarray | None] = field(default_factory=list)
    _cameras: list[View] = field(default_factory=list)

    def add(self, observation: Observation) -> None:
        """Take the next observation."""
        if self._chosen is None:
            self._chosen = farthest_points(observation.points, self.options.object_points)
        view = observation.view
        self._stamps_ns.append(view.stamp_ns)
        self._points.append(observation.points[self._chosen].astype(np.float32))
        self._confidence.append(observation.confidence[self._chosen].astype(np.float32))
        self._hands.append(observation.hand_points)
        self._motions.append(observation.hand_motion)
        nothing = np.zeros((0, 0, 3), np.uint8)
        self._cameras.append(
            View(
                stamp_ns=view.stamp_ns,
                image=nothing,
                camera_matrix=view.camera_matrix,
                world_from_camera=view.world_from_camera,
            )
        )

    @property
    def start_ns(self) -> int:
        """Stamp of the first observation."""
        return self._stamps_ns[0]

    @property
    def grip_frame(self) -> int:
        """First observation in which the hand holds the object; -1 if none."""
        held = [frame for frame, hand in enumerate(self._hands) if np.isfinite(hand).all()]
        return held[0] if held else -1

    def episode(self, name: str, ground_height: float) -> Episode:
        """What was observed.

        Raises:
            EpisodeError: fewer than two observations, or no point that can be trusted in the first.
        """
        if len(self._stamps_ns) < 2:
            raise EpisodeError(f"{name}: {len(self._stamps_ns)} view(s) observed; motion needs at least 2")
        points, confidence = np.array(self._points), np.array(self._confidence)
        confidence[points[:, :, 2] < ground_height - self.options.ground_margin_m] = 0.0
        points[confidence < self.options.least_confidence] = np.nan
        points[~consistent_motion(points)] = np.nan
        kept = np.isfinite(points).any(axis=(0, 2))
        points, confidence = self._completed(points[:, kept], confidence[:, kept], ground_height)
        confidence[~np.isfinite(points).all(axis=2)] = 0.0
        hands = self._hand_paths()
        return Episode(
            name=name,
            times=(np.array(self._stamps_ns, np.int64) - self._stamps_ns[0]) * 1e-9,
            points=points,
            confidence=confidence,
            point_ids=np.arange(points.shape[1], dtype=np.uint32),
            controllers=hands.astype(np.float32),
            controller_ids=np.arange(hands.shape[1], dtype=np.uint32),
            ground_height=ground_height,
        )

    def _completed(
        self, points: np.ndarray, confidence: np.ndarray, ground_height: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """With the hidden side of a solid, in the views before it is touched: nothing is known of it later."""
        model = self.rest.model
        hidden = model.rest[len(model.mesh.pixels) :]
        if self.rest.kind != ObjectKind.SOLID or self.options.completion == Completion.NONE or not len(hidden):
            return points, confidence
        hidden = hidden[farthest_points(hidden, self.options.object_points // 2)]
        before = self.grip_frame if self.grip_frame > 0 else 1
        added = np.full((len(points), len(hidden), 3), np.nan, np.float32)
        added[:before] = hidden
        sure = np.zeros(added.shape[:2], np.float32)
        sure[:before] = INFERRED_CONFIDENCE
        return np.concatenate([points, added], axis=1), np.concatenate([confidence, sure], axis=1)

    def _hand_paths(self) -> np.ndarray:
        """[T, C, 3] metres: finite throughout; no columns if no hand ever holds the object.

        Before the grip the points go back along the hand's motion in the image, at the depth of the grip. Where the
        hand is not seen it stays where it was last, or is first.
        """
        first = self.grip_frame
        if first < 0:
            return np.zeros((len(self._hands), 0, 3))
        paths = np.array(self._hands)
        camera = self._cameras[first]
        projected = project(paths[first], camera.camera_matrix, camera.world_from_camera)
        pixels, depth = projected[:, :2], float(np.median(projected[:, 2]))
        for frame in range(first, 0, -1):
            motion = self._motions[frame]
            if motion is None:
                break
            pixels = carried(pixels, _inverse(motion))
            paths[frame - 1] = at_depth(pixels, depth, self._cameras[frame - 1])
        known = np.flatnonzero(np.isfinite(paths).all(axis=(1, 2)))
        latest = known[np.clip(np.searchsorted(known, np.arange(len(paths)), side="right") - 1, 0, None)]
        return paths[latest]


def _inverse(motion: np.ndarray) -> np.ndarray:
    """[2, 3] similarity that undoes another."""
    back = np.linalg.inv(motion[:, :2])
    return np.column_stack([back, -back @ motion[:, 2]])
