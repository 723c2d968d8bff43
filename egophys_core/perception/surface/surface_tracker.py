"""Follows a surface from view to view: predict, render, compare, solve."""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from egophys_core.constants import GRAVITY
from egophys_core.perception.hands.arms import SeenArm
from egophys_core.perception.hands.grip import HandGrip, follow, hand_motion, take_grip
from egophys_core.perception.hands.hand_tracks import HandWidth
from egophys_core.perception.masks import silhouette
from egophys_core.perception.options import ObjectKind
from egophys_core.perception.stages import Masks, View
from egophys_core.perception.surface import feature_search
from egophys_core.perception.surface.feature_search import Found, RenderedSurface
from egophys_core.perception.surface.patch_match import even_contrast
from egophys_core.perception.surface.rest_surface import RestObject
from egophys_core.perception.surface.surface_fit import Correspondences, FittedSurface, fitter_of
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

OUTSIDE_SIGMA_PX, UNCOVERED_SIGMA_PX, OUTLINE_DOUBT_PX = 2.0, 4.0, 20.0
"""Pixels: of vertices outside the outline, and of places inside it that nothing covers."""

MISSED_PX = 2.0
"""Pixels: a patch farther from its place in the solved surface was a wrong one."""

MOVED_M = 0.0015
"""Metres from rest from which on a vertex that is seen counts as moved."""

FEWEST_MOVED = 5
"""Vertices near a hand that must have moved before it is said to have contact."""

SURFACE_DEPTH_SIGMA_M = 0.008
"""Metres: of the depth of what a hand touches, where it is seen to be."""

WIDTH_DEPTH_SHARE = 0.05
"""Of the distance: error of a depth that is told by the width of a hand."""

TOUCHING_M = 0.04
"""Metres from the object, as seen from the camera, beyond which a hand does not touch it."""

NEAR_HAND_M = 0.12
"""Metres from where a hand holds or pushes: vertices that move there are moved by it."""


@dataclass(frozen=True, kw_only=True)
class HandState:
    """A hand in one view."""

    pixel: np.ndarray
    """[2] x, y: where it holds or pushes."""
    depth: float
    """Metres along the optical axis there: by the width of the hand, and by what it touches."""
    has_contact: bool
    """Whether the object has moved under it by now."""


@dataclass(frozen=True, kw_only=True)
class SurfaceState:
    """The surface in one view."""

    positions: np.ndarray
    """[W, 3] metres, frame world."""
    sigma: np.ndarray
    """[W] metres: standard deviation of the points, given the view before."""
    seen: np.ndarray
    """[N] bool: features found in this view."""
    hands: Mapping[int, HandState]
    """The hands that are seen, by number."""


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
        self._arms: Mapping[int, SeenArm] = {}
        self._grips: dict[int, HandGrip] = {}
        self._widths: dict[int, HandWidth] = {}

    def next(self, view: View, masks: Masks, arms: Mapping[int, SeenArm]) -> SurfaceState:
        """Solve for the surface in the next view.

        Args:
            view: its pose is known.
            masks: of the view; empty ones leave the surface to the prediction.
            arms: of the hands that are seen, by number.
        """
        evened = even_contrast(view.image)
        self._follow_hands(view, arms)
        step_s = abs(view.stamp_ns - self._stamp_ns) * 1e-9
        predicted = self._predicted(self._step_s(view))
        carried = feature_search.follow(self._found, self._evened, evened, masks)
        fitted, found = self._solve(view, masks, evened, predicted, predicted, carried, LEVELS[0])
        for levels in LEVELS[1:]:
            fitted, found = self._solve(view, masks, evened, predicted, fitted.positions, carried, levels)

        right = fitted.residual[: len(found.features)] < MISSED_PX
        wrong = found.features[~right]
        self._found, self._evened = found.without(wrong), evened
        if step_s > 0:
            velocity = (fitted.positions - self._positions) / step_s
            self._velocity = SMOOTHING * velocity + (1 - SMOOTHING) * self._velocity
        self._positions, self._stamp_ns = fitted.positions, view.stamp_ns
        seen = np.zeros(len(self._corners), bool)
        seen[self._found.features] = True
        self._find_contacts(view, seen)
        return SurfaceState(positions=fitted.positions, sigma=fitted.sigma, seen=seen, hands=self._hand_states(view))

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
        sigma = np.full(len(start), MOTION_SIGMA_M)
        return fitter.fit(view, _together(parts), predicted, sigma, ITERATIONS, start), found

    def _follow_hands(self, view: View, arms: Mapping[int, SeenArm]) -> None:
        """The hands' motion since the view before; what they hold goes along."""
        grey = cv2.cvtColor(view.image, cv2.COLOR_BGR2GRAY)
        for number, arm in arms.items():
            self._widths.setdefault(number, HandWidth()).see(arm)
        if self._grips and self._arms:
            flow = self._flow.calc(self._grey, grey, None)
            for number in self._grips.keys() & arms.keys():
                before = self._arms.get(number)
                motion = None if before is None else hand_motion(flow, before)
                self._grips[number] = follow(self._grips[number], motion, arms[number])
        self._grey, self._arms = grey, arms

    def _hand_states(self, view: View) -> dict[int, HandState]:
        states = {}
        for number, arm in self._arms.items():
            grip = self._grips.get(number)
            pixel, depth = arm.grip, self._widths[number].depth(view.camera_matrix[0, 0])
            if grip is not None:
                pixel, depth = grip.pixel, self._depth_of(grip, depth, view)
            states[number] = HandState(pixel=pixel, depth=depth, has_contact=grip is not None)
        return states

    def _depth_of(self, grip: HandGrip, by_width: float, view: View) -> float:
        """Metres: by the width of the hand, and by the surface as far as it is where the hand is seen."""
        if not len(grip.vertices):
            return by_width
        held = project(self._positions[grip.vertices], view.camera_matrix, view.world_from_camera)
        by_surface = float(np.median(held[:, 2]))
        apart = np.linalg.norm(held[:, :2].mean(axis=0) - grip.pixel) * by_surface / view.camera_matrix[0, 0]
        of_surface = 1 / (SURFACE_DEPTH_SIGMA_M**2 + apart**2)
        of_width = 1 / (WIDTH_DEPTH_SHARE * by_width) ** 2
        return float((of_surface * by_surface + of_width * by_width) / (of_surface + of_width))

    def _find_contacts(self, view: View, seen: np.ndarray) -> None:
        """A hand at the object, which begins to move near it, has contact; there its depth is that of the object."""
        untouched = [number for number in self._arms if number not in self._grips]
        if not untouched:
            return
        model, focal = self._rest.model, view.camera_matrix[0, 0]
        vertices = np.unique(self._corners[seen])
        moved = vertices[np.linalg.norm(self._positions[vertices] - model.rest[vertices], axis=1) > MOVED_M]
        places = project(self._positions[: len(model.mesh.pixels)], view.camera_matrix, view.world_from_camera)
        for number in untouched:
            arm = self._arms[number]
            away = np.linalg.norm(places[:, :2] - arm.grip, axis=1) * places[:, 2] / focal
            if away.min() > TOUCHING_M or np.count_nonzero(away[moved] < NEAR_HAND_M) < FEWEST_MOVED:
                continue
            surface = self._scene(self._positions, view).rendering.silhouette
            grip = take_grip(arm, surface, places, focal)
            nearest = np.linalg.norm(places[:, :2] - grip.pixel, axis=1).argmin()
            touched = grip.vertices if len(grip.vertices) else [nearest]
            self._grips[number] = grip
            self._widths[number].learn(float(np.median(places[touched, 2])), focal)


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
