"""Follows a surface from view to view: predict, render, compare, solve."""

from dataclasses import dataclass

import cv2
import numpy as np

from egophys_core.constants import GRAVITY
from egophys_core.perception.hands.grip import FEWEST_PIXELS, HeldVertices, follow, hand_motion, hand_width, take_hold
from egophys_core.perception.masks import silhouette
from egophys_core.perception.options import ObjectKind
from egophys_core.perception.stages import Masks, View
from egophys_core.perception.surface import feature_search
from egophys_core.perception.surface.feature_search import Found, RenderedSurface
from egophys_core.perception.surface.patch_match import even_contrast
from egophys_core.perception.surface.rest_surface import RestObject
from egophys_core.perception.surface.surface_fit import Correspondences, Distances, FittedSurface, fitter_of
from egophys_core.perception.surface.surface_render import project

SHEET_WEIGHT = 0.3
"""Share of gravity in the prediction of sheets: what is not seen falls until its neighbours hold it. More of it sags
between the places that are seen."""

DAMPING = 0.9
"""Share of the velocity that is predicted to remain."""

MOTION_SIGMA_M = 0.020
"""Metres a view: error of the prediction."""

SMOOTHING = 0.7
"""Weight of the newest displacement in the velocity."""

LONGEST_STEP_S = 0.1
"""Over a longer gap between views the motion is not extrapolated."""

LEVELS = (2, 1)
"""Pyramid levels of the search in each round of render, compare, solve."""

ITERATIONS = 3
"""Of the solver in each round."""

HELD_SIGMA_PX, HELD_DOUBT_PX = 2.0, 15.0
"""Pixels: of where the hand has carried a vertex."""

HAND_DEPTH_SHARE = 0.015
"""Of the distance: error of a depth that is told by the width of the hand. Widths are good to 3 %, but the few vertices
that are held must move the many that hang on them."""

WIDTH_GAIN = 0.02
"""How fast the width of a hand at a distance is learnt while it holds; at the grip its outline is often half hidden."""

WIDTHS = 5
"""Views over which the median of the hand's width is taken."""

OUTSIDE_SIGMA_PX, UNCOVERED_SIGMA_PX, OUTLINE_DOUBT_PX = 2.0, 4.0, 20.0
"""Pixels: of vertices outside the outline, and of places inside it that nothing covers."""

MISSED_PX = 2.0
"""Pixels: a patch farther from its place in the solved surface was a wrong one."""

MOVED_M = 0.0015
"""Metres from rest from which on a vertex that is seen counts as moved."""

FEWEST_MOVED = 5
"""Vertices that must have moved before the hand is said to hold the object."""


@dataclass(frozen=True, kw_only=True)
class SurfaceState:
    """The surface in one view."""

    positions: np.ndarray
    """[W, 3] metres, frame world."""
    sigma: np.ndarray
    """[W] metres: standard deviation of the points, given the view before."""
    seen: np.ndarray
    """[N] bool: features found in this view."""
    grip: HeldVertices | None
    """What the hand holds."""
    hand_motion: np.ndarray | None
    """[2, 3] similarity of the hand in the image since the view before; None if it is not seen in both."""
    hand_depth: float
    """Metres: depth at which the hand touches the object; NaN before it does."""
    hand_width: float
    """Pixels: standard deviation across the hand; NaN if it is not seen whole."""


class SurfaceTracker:
    """The surface in one view after the other, in either direction of time, from the reference view."""

    def __init__(self, rest: RestObject, reference: View) -> None:
        self._rest = rest
        self._fitter = fitter_of(rest.model)
        self._corners = rest.model.mesh.triangles[rest.feature_triangles]
        self._positions = rest.model.rest
        self._velocity = np.zeros_like(rest.model.rest)
        self._stamp_ns = reference.stamp_ns
        count = len(rest.feature_pixels)
        self._evened = rest.texture
        self._found = Found(
            features=np.arange(count), pixels=rest.feature_pixels, sigma=np.ones(count), side=np.ones(count)
        )
        self._flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
        self._grey = cv2.cvtColor(reference.image, cv2.COLOR_BGR2GRAY)
        self._hand = np.zeros(self._grey.shape, bool)
        self._grip: HeldVertices | None = None
        self._has_gripped = False
        self._widths: list[float] = []
        self._width_times_depth = np.nan

    def next(self, view: View, masks: Masks) -> SurfaceState:
        """Solve for the surface in the next view.

        Args:
            view: its pose is known.
            masks: of the view; empty ones leave the surface to the prediction.
        """
        evened = even_contrast(view.image)
        motion = self._follow_hand(view, masks)
        step_s = abs(view.stamp_ns - self._stamp_ns) * 1e-9
        predicted = self._predicted(self._step_s(view))
        carried = feature_search.follow(self._found, self._evened, evened, masks)
        distances = self._held_depth()
        fitted, found = self._solve(view, masks, evened, predicted, predicted, carried, distances, LEVELS[0])
        for levels in LEVELS[1:]:
            fitted, found = self._solve(view, masks, evened, predicted, fitted.positions, carried, distances, levels)

        right = fitted.residual[: len(found.features)] < MISSED_PX
        wrong = found.features[~right]
        self._found, self._evened = found.without(wrong), evened
        if step_s > 0:
            velocity = (fitted.positions - self._positions) / step_s
            self._velocity = SMOOTHING * velocity + (1 - SMOOTHING) * self._velocity
        self._positions, self._stamp_ns = fitted.positions, view.stamp_ns
        seen = np.zeros(len(self._corners), bool)
        seen[self._found.features] = True
        self._take_hold(view, masks, seen)
        self._learn_width(view)
        return SurfaceState(
            positions=fitted.positions,
            sigma=fitted.sigma,
            seen=seen,
            grip=self._grip,
            hand_motion=motion,
            hand_depth=self._hand_depth(view),
            hand_width=float(np.median(self._widths)) if self._widths else np.nan,
        )

    def silhouette(self, view: View) -> np.ndarray:
        """[S, S] bool: where the surface is expected in the next view, also behind hands."""
        return self._scene(self._predicted(self._step_s(view)), view).rendering.silhouette

    def _step_s(self, view: View) -> float:
        return min(abs(view.stamp_ns - self._stamp_ns) * 1e-9, LONGEST_STEP_S)

    def _scene(self, positions: np.ndarray, view: View) -> RenderedSurface:
        skins = (self._fitter.skin(positions, 1.0), self._fitter.skin(positions, -1.0))
        return feature_search.scene_of(self._rest, skins, view)

    def _predicted(self, step_s: float) -> np.ndarray:
        predicted = self._positions + step_s * DAMPING * self._velocity
        if self._rest.kind == ObjectKind.SHEET:
            predicted[:, 2] -= SHEET_WEIGHT * GRAVITY * step_s**2
        return predicted

    def _solve(
        self,
        view: View,
        masks: Masks,
        evened: np.ndarray,
        predicted: np.ndarray,
        start: np.ndarray,
        carried: Found,
        distances: Distances | None,
        levels: int,
    ) -> tuple[FittedSurface, Found]:
        """One round: render at the start, compare, solve. What is found stands first among the correspondences."""
        fitter = self._fitter
        scene = self._scene(start, view)
        rendered = feature_search.find_rendered(self._rest, scene, evened, masks, levels)
        others = carried.without(rendered.features)
        found = Found(
            features=np.append(rendered.features, others.features),
            pixels=np.vstack([rendered.pixels, others.pixels]),
            sigma=np.append(rendered.sigma, others.sigma),
            side=np.append(rendered.side, others.side),
        )
        seen = Correspondences(
            corners=self._corners[found.features],
            weights=self._rest.feature_weights[found.features],
            side=found.side,
            pixels=found.pixels,
            sigma=found.sigma,
            robust_scale=2 * found.sigma,
        )
        vertices = project(start[: len(self._rest.model.mesh.pixels)], view.camera_matrix, view.world_from_camera)[
            :, :2
        ]
        covered = scene.rendering.silhouette
        parts = [seen, _outline(*silhouette.outliers(vertices, masks), OUTSIDE_SIGMA_PX)]
        parts.append(_outline(*silhouette.uncovered(vertices, covered, masks), UNCOVERED_SIGMA_PX))
        if self._grip is not None:
            parts.append(_of_vertices(self._grip.vertices, self._grip.pixels, HELD_SIGMA_PX, HELD_DOUBT_PX))
        sigma = np.full(len(start), MOTION_SIGMA_M)
        return fitter.fit(view, _together(parts), predicted, sigma, ITERATIONS, start, distances), found

    def _follow_hand(self, view: View, masks: Masks) -> np.ndarray | None:
        """The hand's motion since the view before; what it holds goes along."""
        grey = cv2.cvtColor(view.image, cv2.COLOR_BGR2GRAY)
        motion = None
        if np.count_nonzero(masks.hand) >= FEWEST_PIXELS:
            motion = hand_motion(self._grey, grey, self._hand, self._flow)
        if self._grip is not None:
            self._grip = None if motion is None else follow(self._grip, motion, masks.hand)
        self._grey, self._hand = grey, masks.hand
        width = hand_width(masks.hand)
        if width is not None:
            self._widths = [*self._widths[1 - WIDTHS :], width]
        return motion

    def _held_depth(self) -> Distances | None:
        """Depth of what the hand holds, by the hand's width."""
        if self._grip is None or not self._widths or not np.isfinite(self._width_times_depth):
            return None
        depth = self._width_times_depth / float(np.median(self._widths))
        return Distances(vertices=self._grip.vertices, depth=depth, sigma=HAND_DEPTH_SHARE * depth)

    def _learn_width(self, view: View) -> None:
        if self._grip is None or not self._widths:
            return
        product = float(np.median(self._widths)) * self._hand_depth(view)
        known = np.isfinite(self._width_times_depth)
        self._width_times_depth = (
            (1 - WIDTH_GAIN) * self._width_times_depth + WIDTH_GAIN * product if known else product
        )

    def _hand_depth(self, view: View) -> float:
        if self._grip is not None:
            held = project(self._positions[self._grip.vertices], view.camera_matrix, view.world_from_camera)
            return float(np.median(held[:, 2]))
        return self._width_times_depth / float(np.median(self._widths)) if self._widths else np.nan

    def _take_hold(self, view: View, masks: Masks, seen: np.ndarray) -> None:
        """The hand holds what it hides once the object moves."""
        if self._has_gripped or not masks.hand.any():
            return
        model = self._rest.model
        vertices = np.unique(self._corners[seen])
        moved = np.linalg.norm(self._positions[vertices] - model.rest[vertices], axis=1) > MOVED_M
        if np.count_nonzero(moved) >= FEWEST_MOVED:
            places = project(self._positions[: len(model.mesh.pixels)], view.camera_matrix, view.world_from_camera)
            covered = self._scene(self._positions, view).rendering.silhouette
            self._grip = take_hold(places, masks, covered, view.camera_matrix[0, 0])
            self._has_gripped = self._grip is not None


def _of_vertices(vertices: np.ndarray, pixels: np.ndarray, sigma: float, robust_scale: float) -> Correspondences:
    """Correspondences of vertices themselves, on the middle surface."""
    count = len(vertices)
    weights = np.zeros((count, 3))
    weights[:, 0] = 1.0
    return Correspondences(
        corners=np.repeat(vertices[:, None], 3, axis=1),
        weights=weights,
        side=np.zeros(count),
        pixels=pixels,
        sigma=np.full(count, sigma),
        robust_scale=np.full(count, robust_scale),
    )


def _outline(vertices: np.ndarray, pixels: np.ndarray, sigma: float) -> Correspondences:
    return _of_vertices(vertices, pixels, sigma, OUTLINE_DOUBT_PX)


def _together(parts: list[Correspondences]) -> Correspondences:
    return Correspondences(
        corners=np.vstack([part.corners for part in parts]),
        weights=np.vstack([part.weights for part in parts]),
        side=np.concatenate([part.side for part in parts]),
        pixels=np.vstack([part.pixels for part in parts]),
        sigma=np.concatenate([part.sigma for part in parts]),
        robust_scale=np.concatenate([part.robust_scale for part in parts]),
    )
