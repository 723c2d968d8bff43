"""A recorded video through stages that can be replaced: what `perceive` does where learned stages are asked for."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from egophys_core.episode import Episode
from egophys_core.geometry import farthest_points
from egophys_core.perception.observation import Observation
from egophys_core.perception.options import ObjectKind, PerceptionOptions
from egophys_core.perception.staged import StageSet, episode_from_stages
from egophys_core.perception.stages import Completer, Masks, Segmenter, View
from egophys_core.perception.surface.rest_surface import FLATTEST_M
from egophys_core.perception.surface.surface_render import project

Views = Callable[[], Iterable[View]]

INFERRED_CONFIDENCE = 0.5
"""Of points that were never seen but generated."""


class KeptMasks:
    """A `Segmenter` that runs another one once and keeps its masks, a bit a pixel."""

    def __init__(self, segmenter: Segmenter) -> None:
        self._segmenter = segmenter
        self._packed: list[tuple[np.ndarray, np.ndarray]] = []
        self._shape: tuple[int, ...] = ()
        self._is_complete = False

    def masks(self, views: Iterable[View]) -> Iterator[Masks]:
        """Masks of each view; from the second time on the views are not looked at."""
        if self._is_complete:
            yield from (self.at(index) for index in range(len(self._packed)))
            return
        self._packed = []
        for masks in self._segmenter.masks(views):
            self._shape = masks.object.shape
            self._packed.append((np.packbits(masks.object), np.packbits(masks.hand)))
            yield masks
        self._is_complete = True

    def at(self, index: int) -> Masks:
        """Masks of one view."""
        seen, hand = (
            np.unpackbits(each, count=int(np.prod(self._shape))).astype(bool).reshape(self._shape)
            for each in self._packed[index]
        )
        return Masks(object=seen, hand=hand)


def observe_by_stages(
    views: Views,
    stages: StageSet,
    *,
    name: str,
    options: PerceptionOptions,
    on_observation: Callable[[Observation], None],
) -> tuple[Episode, ObjectKind]:
    """The episode, and what kind of object it shows.

    Args:
        views: gives the views anew at each call, all with a pose.
        stages: of the path.
        name: of the episode.
        options: of perception.
        on_observation: called with each observation in the order of the stamps.

    Raises:
        EpisodeError: object or hand is not found, or a generated shape does not fit.
    """
    kept = KeptMasks(stages.segmenter)
    episode = episode_from_stages(
        views, kept, stages.tracker, stages.point_mapper, name=name, options=options, ground_height=0.0
    )
    kind = options.kind
    if kind == ObjectKind.AUTO:
        top = np.nanpercentile(episode.points[0, :, 2], 95)
        kind = ObjectKind.SHEET if top < FLATTEST_M else ObjectKind.SOLID
    for frame, view in enumerate(views()):
        on_observation(_observation(episode, frame, view, kept.at(frame)))
    if kind == ObjectKind.SOLID and stages.completer is not None:
        episode = completed(episode, next(iter(views())), kept.at(0), stages.completer, options.object_points // 2)
    return episode, kind


def completed(episode: Episode, view: View, masks: Masks, completer: Completer, most: int) -> Episode:
    """With points of the hidden side in the first frame: nothing is known of them later.

    Args:
        episode: of the points that are seen.
        view: the first.
        masks: its masks.
        completer: makes the whole surface of the view.
        most: points that are added.

    Raises:
        EpisodeError: the shape does not fit the points that are seen.
    """
    from egophys_core.perception.learned.trellis import complete

    seen = episode.points[0][np.isfinite(episode.points[0]).all(axis=1)].astype(float)
    spacing = float(np.median(cKDTree(seen).query(seen, k=2)[0][:, 1]))
    shape = completer.surface(view.image, masks.object)
    hidden = complete(shape, seen, ground_height=episode.ground_height, spacing=2 * spacing)
    hidden = hidden[farthest_points(hidden, most)]
    points = np.full((episode.frames, len(hidden), 3), np.nan, np.float32)
    points[0] = hidden
    confidence = np.zeros(points.shape[:2], np.float32)
    confidence[0] = INFERRED_CONFIDENCE
    points = np.concatenate([episode.points, points], axis=1)
    return replace(
        episode,
        points=points,
        confidence=np.concatenate([episode.confidence, confidence], axis=1),
        point_ids=np.arange(points.shape[1], dtype=np.uint32),
    )


def _observation(episode: Episode, frame: int, view: View, masks: Masks) -> Observation:
    points = episode.points[frame].astype(float)
    visible = np.isfinite(points).all(axis=1)
    return Observation(
        view=view,
        masks=masks,
        points=points,
        confidence=episode.confidence[frame].astype(float),
        pixels=project(points, view.camera_matrix, view.world_from_camera)[:, :2],
        visible=visible,
        mesh_pixels=np.zeros((0, 2)),
        mesh_edges=np.zeros((0, 2), int),
        hand_points=episode.controllers[frame].astype(float),
        hands={},
    )
