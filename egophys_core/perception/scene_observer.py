"""Views -> observations, one by one: the part of perception that recorded and live video share."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.errors import EpisodeError
from egophys_core.geometry import farthest_points
from egophys_core.perception.camera.board import Board
from egophys_core.perception.hands.arms import SeenArm
from egophys_core.perception.hands.hand_contacts import HandContacts
from egophys_core.perception.hands.hand_points import ball
from egophys_core.perception.hands.hand_tracks import MOST_HANDS, HandTracks
from egophys_core.perception.hands.landmarked_arms import LandmarkedArms
from egophys_core.perception.masks.colour_model import is_black
from egophys_core.perception.masks.mask_tracker import MaskTracker
from egophys_core.perception.masks.object_finder import find_object
from egophys_core.perception.observation import HandSight, Observation
from egophys_core.perception.options import Completion, ObjectKind, PerceptionOptions
from egophys_core.perception.stages import HandLandmarker, Masks, View
from egophys_core.perception.surface.confidence import PointConfidence, confidence_of, growth_sigma
from egophys_core.perception.surface.rest_surface import RestObject, rest_object
from egophys_core.perception.surface.surface_render import project
from egophys_core.perception.surface.surface_tracker import SurfaceState, SurfaceTracker

FEWEST_STILL_VIEWS = 5
"""Views of the object at rest without which nothing begins."""


@dataclass(frozen=True, kw_only=True)
class _Seen:
    """A view with its masks and hands."""

    view: View
    masks: Masks
    arms: Mapping[int, SeenArm]


class SceneObserver:
    """Learns the object at rest from the first second, then follows object and hand."""

    def __init__(
        self,
        options: PerceptionOptions,
        board: Board | None,
        table_height: float = 0.0,
        landmarker: HandLandmarker | None = None,
    ) -> None:
        """Nothing is known yet.

        Args:
            options: of perception.
            board: what lies on the table and is not the object; None if there is no board.
            table_height: z of the table, metres.
            landmarker: tells where hands hold and how deep they are; by their shape if None.
        """
        self._options = options
        self._board_corners = None if board is None else board_outline(board)
        self._table_height = table_height
        self._waiting: list[View] = []
        self._masks: MaskTracker | None = None
        self._hands = HandTracks()
        self._landmarked = None if landmarker is None else LandmarkedArms(landmarker)
        self._forward: _Follower | None = None
        self.rest: RestObject | None = None
        """The object at rest, once it is known."""
        self.warning = ""
        """What the user should check about the choice of the object."""

    def add(self, view: View) -> list[Observation]:
        """Take the next view; black ones and ones without a pose are left out.

        Returns:
            Nothing during the first second, then the observations of that second, then one each.

        Raises:
            EpisodeError: after the first second: no object is found.
        """
        if not np.isfinite(view.world_from_camera).all() or is_black(view):
            return []
        if self._forward is not None and self._masks is not None:
            # Colours alone take a hand of the object's colours for the object; the surface knows how far it reaches.
            surface = self._forward.silhouette(view)
            return [self._forward.next(self._seen(view, self._masks.next(view, surface), surface))]
        self._waiting.append(view)
        if (view.stamp_ns - self._waiting[0].stamp_ns) * 1e-9 < self._options.still_s:
            return []
        return self.finish()

    def finish(self) -> list[Observation]:
        """Begin with the views there are, if it has not begun; for videos shorter than the still time.

        Raises:
            EpisodeError: too few views with a pose, or no object in them.
        """
        if self._forward is not None:
            return []
        if len(self._waiting) < FEWEST_STILL_VIEWS:
            raise EpisodeError(
                f"{len(self._waiting)} views with a known camera pose, needed are {FEWEST_STILL_VIEWS} of the object "
                "at rest; keep the tag board in view, in light, from the start"
            )
        views = self._waiting
        found = find_object(
            views,
            table_height=self._table_height,
            board_corners=self._board_corners,
            box=self._options.object_box if any(self._options.object_box) else None,
            point=self._options.object_point if any(self._options.object_point) else None,
        )
        self.warning = found.warning
        self._masks = MaskTracker(views[0], found.mask, table_height=self._table_height)
        seen = []
        for view in views:
            masks = self._masks.next(view)
            seen.append(self._seen(view, masks, masks.object))
        rest = rest_object(views, [each.masks.object for each in seen], self._table_height, self._options)
        self.rest = rest
        reference = seen[rest.reference]
        backward = _Follower(rest, reference, self._options)
        before = [backward.next(each) for each in reversed(seen[: rest.reference])]
        self._forward = _Follower(rest, reference, self._options)
        at_rest = self._forward.at_rest(reference)
        after = [self._forward.next(each) for each in seen[rest.reference + 1 :]]
        self._waiting = []
        return [*reversed(before), at_rest, *after]

    def _seen(self, view: View, masks: Masks, surface: np.ndarray) -> _Seen:
        """A view with its hands; what is inside their outlines is no object, whatever its colour."""
        arms = self._hands.next(view.image, masks.hand, surface)
        outlined = [arm.mask for arm in arms.values() if arm.outline is not None]
        if outlined and self._masks is not None:
            hand = np.logical_or.reduce([masks.hand, *outlined])
            masks = Masks(object=masks.object & ~hand, hand=hand)
            self._masks.go_on_from(masks)
        arms = arms if self._landmarked is None else self._landmarked.next(arms, view)
        return _Seen(view=view, masks=masks, arms=arms)


class _Follower:
    """Surface, confidence and hand in one view after the other."""

    def __init__(self, rest: RestObject, reference: _Seen, options: PerceptionOptions) -> None:
        self._rest = rest
        self._options = options
        self._corners = rest.model.mesh.triangles[rest.feature_triangles]
        self._surface = SurfaceTracker(rest, reference.view)
        self._contacts = HandContacts(
            rest.model.rest[: len(rest.model.mesh.pixels)], is_solid=rest.kind == ObjectKind.SOLID
        )
        self._confidence = PointConfidence(self._points(rest.model.rest))
        self._hidden = _hidden(rest, options)
        self._is_solid = rest.kind == ObjectKind.SOLID
        self._ball = ball(max(options.controllers // MOST_HANDS, 1))

    def at_rest(self, seen: _Seen) -> Observation:
        """The reference view itself."""
        everything = np.ones(len(self._corners), bool)
        model = self._rest.model
        state = SurfaceState(
            positions=model.rest,
            sigma=np.zeros(len(model.rest)),
            seen=everything,
        )
        return self._observation(seen, state, {})

    def silhouette(self, view: View) -> np.ndarray:
        """[S, S] bool: where the object is expected in the next view, also behind hands."""
        return self._surface.silhouette(view)

    def next(self, seen: _Seen) -> Observation:
        view = seen.view
        state = self._surface.next(view, seen.masks, self._contacts.held(view, seen.arms))
        visible = np.zeros(len(self._rest.model.mesh.pixels), bool)
        visible[self._corners[state.seen]] = True
        hands = self._contacts.next(view, seen.arms, state.positions, visible, lambda: self._surface.silhouette(view))
        return self._observation(seen, self._doubted(state, visible, seen), hands)

    def _doubted(self, state: SurfaceState, visible: np.ndarray, seen: _Seen) -> SurfaceState:
        """The surface, whose hidden vertices are doubted where hands contradict them."""
        sigma = state.sigma.copy()
        doubt = self._contacts.doubt(seen.view, seen.arms, state.positions)
        sigma[: len(visible)] = np.hypot(sigma[: len(visible)], np.where(visible, 0.0, doubt))
        return replace(state, sigma=sigma)

    def _points(self, positions: np.ndarray) -> np.ndarray:
        return np.einsum("nk,nkd->nd", self._rest.feature_weights, positions[self._corners])

    def _observation(self, seen: _Seen, state: SurfaceState, hands: Mapping[int, HandSight]) -> Observation:
        view, mesh = seen.view, self._rest.model.mesh
        points = self._points(state.positions)
        every_sigma = self._sigma(view, state, sum(hand.has_contact for hand in hands.values()))
        sigma = (self._rest.feature_weights * every_sigma[self._corners]).sum(axis=1)
        # A solid is whole: each of its points is as sure as the motion of the body, whether it is seen or not.
        known = np.ones(len(points), bool) if self._is_solid else state.seen
        confidence = self._confidence.next(points, sigma, known)
        projected = project(points, view.camera_matrix, view.world_from_camera)
        vertices = project(state.positions[: len(mesh.pixels)], view.camera_matrix, view.world_from_camera)
        depth = projected[:, 2]
        return Observation(
            view=view,
            masks=seen.masks,
            points=points,
            confidence=np.where(
                (depth >= self._options.nearest_m) & (depth <= self._options.farthest_m), confidence, 0.0
            ),
            pixels=projected[:, :2],
            visible=state.seen,
            mesh_pixels=np.where(vertices[:, 2:] > 0, vertices[:, :2], np.nan),
            mesh_edges=mesh.edges,
            hand_points=self._hand_points(hands),
            hands=hands,
            hidden_points=state.positions[self._hidden],
            hidden_confidence=confidence_of(every_sigma[self._hidden]),
        )

    def _sigma(self, view: View, state: SurfaceState, holding: int) -> np.ndarray:
        """[W] metres: deviation of each point of the model, which some hands hold or push."""
        heights = state.positions[:, 2] - self._rest.model.lowest
        if self._is_solid:
            heights = np.full(len(heights), heights.min())
        depths = project(state.positions, view.camera_matrix, view.world_from_camera)[:, 2]
        growth = growth_sigma(heights, depths, holding)
        return np.asarray(np.sqrt(state.sigma**2 + self._rest.sigma**2 + growth**2))

    def _hand_points(self, hands: Mapping[int, HandSight]) -> np.ndarray:
        """[C, 3] metres, frame world: as many of each hand; NaN before it has contact and while it is not seen."""
        points = np.full((MOST_HANDS, len(self._ball), 3), np.nan)
        for number, hand in hands.items():
            points[number] = hand.grip + self._ball
        return points.reshape(-1, 3)


def _hidden(rest: RestObject, options: PerceptionOptions) -> np.ndarray:
    """[H] int: points of the model for the side of a solid that is not seen at rest, if they are wanted."""
    first = len(rest.model.mesh.pixels)
    if options.completion == Completion.NONE or len(rest.model.rest) == first:
        return np.zeros(0, int)
    return first + farthest_points(rest.model.rest[first:], options.object_points // 2)


def board_outline(board: Board) -> np.ndarray:
    """[4, 3] metres, frame world: corners of the sheet, a gap wider than the tags on every side."""
    width, height = board.size
    margin = board.gap
    corners = np.array(
        [
            (-margin, -margin, 0.0, 1.0),
            (width + margin, -margin, 0.0, 1.0),
            (width + margin, height + margin, 0.0, 1.0),
            (-margin, height + margin, 0.0, 1.0),
        ]
    )
    return (corners @ board.world_from_board.T)[:, :3]
