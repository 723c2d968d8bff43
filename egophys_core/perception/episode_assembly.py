"""Observations, one by one -> Episode."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError
from egophys_core.geometry import farthest_points
from egophys_core.perception.hands.carried_paths import HandPath, carried_path, unturned
from egophys_core.perception.hands.hand_paths import contact_views, hand_paths
from egophys_core.perception.hands.hand_points import ball
from egophys_core.perception.hands.held_points import held_points
from egophys_core.perception.hands.level_paths import above_table, drawn_path
from egophys_core.perception.observation import HandSight, Observation
from egophys_core.perception.options import PerceptionOptions
from egophys_core.perception.stages import View
from egophys_core.perception.surface.track_filter import consistent_motion

HELD_CONFIDENCE = 0.4
"""Of points that a hand hides and holds: they are where the hand is, to a centimetre as it turns."""


@dataclass
class EpisodeAssembly:
    """Keeps of each observation what the episode needs: a few points, not the images."""

    options: PerceptionOptions
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
        points = np.vstack([observation.points[self._chosen], observation.hidden_points])
        confidence = np.append(observation.confidence[self._chosen], observation.hidden_confidence)
        self._points.append(points.astype(np.float32))
        self._confidence.append(confidence.astype(np.float32))
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
        points, confidence = self._tracked(ground_height)
        contacts = contact_views(self._hands)
        hands = self._hand_motions(contacts, points, confidence, ground_height)
        holds = {number: view for number, view in contacts.items() if self._hands[view][number].holds}
        places = {number: hand.places for number, hand in hands.items()}
        held = held_points(np.array(self._points), np.isfinite(points).all(axis=2), places, holds)
        is_held = np.isfinite(held).all(axis=2)
        points[is_held], confidence[is_held] = held[is_held], HELD_CONFIDENCE
        kept = np.isfinite(points).any(axis=(0, 2))
        points, confidence = points[:, kept], confidence[:, kept]
        confidence[~np.isfinite(points).all(axis=2)] = 0.0
        controllers = self._controllers(hands)
        return Episode(
            name=name,
            times=self._times,
            points=points,
            confidence=confidence,
            point_ids=np.arange(points.shape[1], dtype=np.uint32),
            controllers=controllers.astype(np.float32),
            controller_ids=np.arange(controllers.shape[1], dtype=np.uint32),
            ground_height=ground_height,
        )

    @property
    def _times(self) -> np.ndarray:
        """[T] seconds from the first observation on."""
        return (np.array(self._stamps_ns, np.int64) - self._stamps_ns[0]) * 1e-9

    def _tracked(self, ground_height: float) -> tuple[np.ndarray, np.ndarray]:
        """Points [T, N, 3], metres, NaN where they are not known, and their confidence [T, N]."""
        points, confidence = np.array(self._points), np.array(self._confidence)
        confidence[points[:, :, 2] < ground_height - self.options.ground_margin_m] = 0.0
        points[confidence < self.options.kept_confidence] = np.nan
        points[~consistent_motion(points)] = np.nan
        return points, confidence

    def _hand_motions(
        self, contacts: Mapping[int, int], points: np.ndarray, confidence: np.ndarray, ground_height: float
    ) -> dict[int, HandPath]:
        """By number, how hands move that have contact from a view on: by their outline, and by what they act on."""
        seen = np.isfinite(points).all(axis=2)
        sure = seen & (confidence >= self.options.least_confidence)
        eyes = np.array([view.world_from_camera[:3, 3] for view in self._cameras])
        motions = {}
        for number, seen_path in hand_paths(self._hands, self._cameras).items():
            path = above_table(seen_path, eyes, ground_height)
            first = contacts[number]
            touched = self._hands[first][number]
            if touched.is_led:
                motions[number] = carried_path(path, first, points, seen, self._times)
            elif touched.holds:
                motions[number] = unturned(drawn_path(path, eyes, first, points, sure, ground_height))
            else:
                motions[number] = unturned(path)
        return motions

    def _controllers(self, hands: Mapping[int, HandPath]) -> np.ndarray:
        """[T, C, 3] metres: points of the hands, as many of each."""
        around = ball(max(self.options.controllers // max(len(hands), 1), 1))
        groups = [hand.places[:, None] + np.einsum("tij,cj->tci", hand.turns, around) for hand in hands.values()]
        return np.concatenate([np.zeros((len(self._stamps_ns), 0, 3)), *groups], axis=1)
