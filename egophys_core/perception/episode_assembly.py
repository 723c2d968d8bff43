"""Observations, one by one -> Episode."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError
from egophys_core.geometry import farthest_points
from egophys_core.perception.hands.hand_paths import contact_views, hand_paths
from egophys_core.perception.hands.hand_points import ball
from egophys_core.perception.observation import HandSight, Observation
from egophys_core.perception.options import Completion, ObjectKind, PerceptionOptions
from egophys_core.perception.stages import View
from egophys_core.perception.surface.rest_surface import RestObject
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
    _hands: list[Mapping[int, HandSight]] = field(default_factory=list)
    _cameras: list[View] = field(default_factory=list)

    def add(self, observation: Observation) -> None:
        """Take the next observation."""
        if self._chosen is None:
            self._chosen = farthest_points(observation.points, self.options.object_points)
        view = observation.view
        self._stamps_ns.append(view.stamp_ns)
        self._points.append(observation.points[self._chosen].astype(np.float32))
        self._confidence.append(observation.confidence[self._chosen].astype(np.float32))
        self._hands.append(observation.hands)
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
        """First observation in which a hand has contact with the object; -1 if none."""
        return min(contact_views(self._hands).values(), default=-1)

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
        paths = hand_paths(self._hands, self._cameras)
        around = ball(max(self.options.controllers // max(len(paths), 1), 1))
        hands = np.concatenate(
            [np.zeros((len(points), 0, 3)), *(path[:, None] + around for path in paths.values())], axis=1
        )
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
