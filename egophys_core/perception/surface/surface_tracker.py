"""Follows a surface from view to view: predict, render, compare, solve."""

from dataclasses import dataclass

import numpy as np

from egophys_core.constants import GRAVITY
from egophys_core.perception.hands.hand_contacts import NOTHING_HELD, HeldVertices
from egophys_core.perception.masks import silhouette
from egophys_core.perception.options import ObjectKind
from egophys_core.perception.stages import Masks, View
from egophys_core.perception.surface import feature_search
from egophys_core.perception.surface.body_fit import BodyFitter, body_fitter_of
from egophys_core.perception.surface.feature_search import Found, RenderedSurface
from egophys_core.perception.surface.patch_match import WINDOW, even_contrast
from egophys_core.perception.surface.relocation import (
    Landmarks,
    Recognised,
    agreeing,
    landmarks_of,
    recognised,
    relocated,
)
from egophys_core.perception.surface.rest_surface import RestObject
from egophys_core.perception.surface.revealed import revealed
from egophys_core.perception.surface.surface_fit import Correspondences, FittedSurface, SurfaceFitter, fitter_of
from egophys_core.perception.surface.surface_render import project

SHEET_WEIGHT = 0.3
"""Share of gravity in the prediction of sheets: what is not seen falls until its neighbours hold it. More of it sags
between the places that are seen."""

DAMPING = 0.9
"""Share of the velocity that is predicted to remain."""

MOTION_SIGMA_M = 0.020
"""Metres a view: error of the prediction."""

HELD_SIGMA_M = 0.010
"""Metres: error of the place of what a hand holds, by the hand."""

SMOOTHING = 0.7
"""Weight of the newest displacement in the velocity."""

LONGEST_STEP_S = 0.1
"""Over a longer gap between views the motion is not extrapolated."""

LEVELS = (2, 1)
"""Pyramid levels of the search in each round of render, compare, solve."""

ITERATIONS, BODY_ITERATIONS = 3, 8
"""Of the solver in each round: of sheets, and of bodies, which have few unknowns."""

ROBUST = 2.0
"""Scale of the robust weights over the standard deviation."""

REVEALED_SIGMA = 2.0
"""Error of features of later pictures over that of the first: the body was placed in them by what it showed."""

FEWEST_FOUND = 30
"""Features below which a body is lost."""

LOST_SHARE, EVERY = 0.6, 3
"""Share of a sheet's features below which some of it may be lost, and every how many views it is looked for then."""

MORE_FOUND = 1.2
"""Times as many features must be found where an object is recognised as where it was thought to be."""

LANDMARK_SIGMA_PX, LANDMARK_DOUBT_PX = 2.0, 30.0
"""Pixels: error of a landmark of a sheet, and from which on it is rather wrong; the sheet may be far from it."""

LOST_SIGMA_M, LANDMARK_ITERATIONS = 0.06, 10
"""Metres by which a lost sheet has moved, and iterations of the solver that draw it to its landmarks."""

SURE_M = 0.015
"""Metres of mean deviation of the points with which a view is good for another picture."""

OUTSIDE_SIGMA_PX, UNCOVERED_SIGMA_PX, OUTLINE_DOUBT_PX = 2.0, 4.0, 20.0
"""Pixels: of vertices outside the outline, and of places inside it that nothing covers."""

MISSED_PX = 2.0
"""Pixels: a patch farther from its place in the solved surface was a wrong one."""


@dataclass(frozen=True, kw_only=True)
class SurfaceState:
    """The surface in one view."""

    positions: np.ndarray
    """[W, 3] metres, frame world."""
    sigma: np.ndarray
    """[W] metres: standard deviation of the points; of a sheet, given the view before."""
    seen: np.ndarray
    """[N] bool: features found in this view."""


class SurfaceTracker:
    """The surface in one view after the other, in either direction of time, from the reference view."""

    def __init__(self, rest: RestObject, reference: View) -> None:
        self._rest = rest
        is_body = self._is_body = rest.kind == ObjectKind.SOLID
        self._fitter: SurfaceFitter | BodyFitter = body_fitter_of(rest.model) if is_body else fitter_of(rest.model)
        self._iterations = BODY_ITERATIONS if is_body else ITERATIONS
        # Patches that overlap miss by the same; the vertices of a sheet are as many as they, the modes of a body few.
        self._doubt = max(WINDOW / rest.feature_step, 1.0) if is_body else 1.0
        self._textures = [rest.picture]
        self._placed_m = np.zeros(1)
        self._landmarks: list[Landmarks] = []
        self._views = 0
        self._corners = rest.model.mesh.triangles[rest.feature_triangles]
        self._weights = rest.feature_weights
        self._positions = rest.model.rest
        self._velocity = np.zeros_like(rest.model.rest)
        self._stamp_ns = reference.stamp_ns
        count = len(rest.feature_pixels)
        self._evened = rest.texture
        self._found = Found(
            features=np.arange(count), pixels=rest.feature_pixels, sigma=np.ones(count), side=np.ones(count)
        )

    def next(self, view: View, masks: Masks, held: HeldVertices = NOTHING_HELD) -> SurfaceState:
        """Solve for the surface in the next view.

        Args:
            view: its pose is known.
            masks: of the view; empty ones leave the surface to the prediction.
            held: what goes along with hands.
        """
        evened = even_contrast(view.image)
        step_s = abs(view.stamp_ns - self._stamp_ns) * 1e-9
        predicted, doubt = self._predicted(self._step_s(view)), np.full(len(self._positions), MOTION_SIGMA_M)
        predicted[held.vertices], doubt[held.vertices] = held.places, HELD_SIGMA_M
        carried = feature_search.follow(self._found, self._evened, evened, masks)
        fitted, found = self._searched(view, masks, evened, predicted, doubt, carried)
        self._views += 1
        if self._may_be_lost(found):
            again = self._found_again(view, masks, evened, carried)
            if again is not None and len(again[1].features) > MORE_FOUND * len(found.features):
                (fitted, found), step_s = again, 0.0
        self._found, self._evened = found, evened
        if step_s > 0:
            velocity = (fitted.positions - self._positions) / step_s
            self._velocity = SMOOTHING * velocity + (1 - SMOOTHING) * self._velocity
        self._positions, self._stamp_ns = fitted.positions, view.stamp_ns
        seen = np.zeros(len(self._rest.feature_pixels), bool)
        seen[self._found.features[self._found.features < len(seen)]] = True
        sigma = np.hypot(fitted.sigma, self._placed())
        self._learn(view, masks, fitted.positions, sigma)
        return SurfaceState(positions=fitted.positions, sigma=sigma, seen=seen)

    def _searched(
        self, view: View, masks: Masks, evened: np.ndarray, predicted: np.ndarray, doubt: np.ndarray, carried: Found
    ) -> tuple[FittedSurface, Found]:
        """The surface in the view, and the features that lie where it has them."""
        start = predicted
        for levels in LEVELS:
            fitted, found = self._solve(view, masks, evened, predicted, doubt, start, carried, levels)
            start = fitted.positions
        missed = fitted.residual[: len(found.features)] >= MISSED_PX
        return fitted, found.without(found.features[missed])

    def _may_be_lost(self, found: Found) -> bool:
        """Whether so little is found that the object is looked for anew: a body, or now and then a part of a sheet."""
        if self._is_body:
            return len(found.features) < FEWEST_FOUND
        return self._views % EVERY == 0 and len(found.features) < LOST_SHARE * len(self._rest.feature_pixels)

    def _found_again(
        self, view: View, masks: Masks, evened: np.ndarray, carried: Found
    ) -> tuple[FittedSurface, Found] | None:
        """A lost object where its landmarks are recognised, if its features are found there, too."""
        for texture in self._textures[len(self._landmarks) :]:
            self._landmarks.append(landmarks_of(texture))
        marks = recognised(self._landmarks, evened, masks)
        there = self._moved_body(view, marks) if self._is_body else self._moved_sheet(view, marks)
        if there is None:
            return None
        doubt = np.full(len(there), MOTION_SIGMA_M)
        fitted, found = self._searched(view, masks, evened, there, doubt, carried)
        return (fitted, found) if len(found.features) >= FEWEST_FOUND else None

    def _moved_body(self, view: View, marks: Recognised) -> np.ndarray | None:
        """[W, 3] metres: a body where its landmarks are."""
        rest = self._rest.model.rest
        move = relocated(marks, np.einsum("nk,nkd->nd", self._weights, rest[self._corners]), view)
        return None if move is None else rest @ move[:3, :3].T + move[:3, 3]

    def _moved_sheet(self, view: View, marks: Recognised) -> np.ndarray | None:
        """[W, 3] metres: a sheet, drawn from where it was to where its landmarks are."""
        right = agreeing(marks, self._rest.feature_pixels)
        count = len(right.features)
        if not count:
            return None
        drawn = Correspondences(
            corners=self._corners[right.features],
            weights=self._weights[right.features],
            side=np.ones(count),
            pixels=right.pixels,
            sigma=np.full(count, LANDMARK_SIGMA_PX),
            robust_scale=np.full(count, LANDMARK_DOUBT_PX),
        )
        doubt = np.full(len(self._positions), LOST_SIGMA_M)
        return self._fitter.fit(view, drawn, self._positions, doubt, LANDMARK_ITERATIONS, self._positions).positions

    def silhouette(self, view: View) -> np.ndarray:
        """[S, S] bool: where the surface is expected in the next view, also behind hands."""
        return self._scene(self._predicted(self._step_s(view)), view).rendering.silhouette

    def _step_s(self, view: View) -> float:
        return min(abs(view.stamp_ns - self._stamp_ns) * 1e-9, LONGEST_STEP_S)

    def _scene(self, positions: np.ndarray, view: View) -> RenderedSurface:
        skins = (self._fitter.skin(positions, 1.0), self._fitter.skin(positions, -1.0))
        return feature_search.scene_of(self._rest.model.triangles, skins, view)

    def _placed(self) -> float:
        """Metres: how well the body was placed in the pictures whose features are found now."""
        if not len(self._found.features):
            return 0.0
        picture = np.searchsorted([each.end for each in self._textures], self._found.features, side="right")
        return float(np.sqrt((self._placed_m[picture] ** 2).mean()))

    def _learn(self, view: View, masks: Masks, positions: np.ndarray, sigma: np.ndarray) -> None:
        """Keep what a solid shows for the first time, if it is known where it is."""
        if not self._is_body or len(self._found.features) < FEWEST_FOUND or sigma.mean() > SURE_M:
            return
        texture = revealed(self._textures, self._scene(positions, view), self._evened, masks)
        if texture is not None:
            self._textures.append(texture)
            self._placed_m = np.append(self._placed_m, sigma.mean())
            corners = self._rest.model.triangles[texture.feature_triangles]
            self._corners = np.vstack([self._corners, corners])
            self._weights = np.vstack([self._weights, texture.feature_weights])

    def _predicted(self, step_s: float) -> np.ndarray:
        predicted = self._positions + step_s * DAMPING * self._velocity
        if not self._is_body:
            predicted[:, 2] -= SHEET_WEIGHT * GRAVITY * step_s**2
        return predicted

    def _solve(
        self,
        view: View,
        masks: Masks,
        evened: np.ndarray,
        predicted: np.ndarray,
        doubt: np.ndarray,
        start: np.ndarray,
        carried: Found,
        levels: int,
    ) -> tuple[FittedSurface, Found]:
        """One round: render at the start, compare, solve. What is found stands first among the correspondences."""
        fitter = self._fitter
        scene = self._scene(start, view)
        found = carried
        for texture in self._textures:
            rendered = feature_search.find_rendered(texture, scene, evened, masks, levels)
            found = rendered.with_others(found)
        is_first = found.features < self._textures[0].end
        sigma = self._doubt * np.where(is_first, 1.0, REVEALED_SIGMA) * found.sigma
        seen = Correspondences(
            corners=self._corners[found.features],
            weights=self._weights[found.features],
            side=found.side,
            pixels=found.pixels,
            sigma=sigma,
            robust_scale=ROBUST * sigma,
        )
        vertices = project(start, view.camera_matrix, view.world_from_camera)[:, :2]
        covered = scene.rendering.silhouette
        parts = [seen, _outline(*silhouette.outliers(vertices, masks), self._doubt * OUTSIDE_SIGMA_PX)]
        parts.append(_outline(*silhouette.uncovered(vertices, covered, masks), self._doubt * UNCOVERED_SIGMA_PX))
        return fitter.fit(view, _together(parts), predicted, doubt, self._iterations, start), found


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
