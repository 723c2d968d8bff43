"""Finds the features of a surface in a view: where a rendering shows them, and where they were in the view before.

Comparing with a rendering that has the texture of an earlier view keeps tracks from drifting and finds again what
was hidden. What the rendering does not explain is followed from the view before.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from egophys_core.perception.masks.silhouette import inside
from egophys_core.perception.stages import Masks, View
from egophys_core.perception.surface.patch_match import LOST_PX, WINDOW, likeness, match
from egophys_core.perception.surface.surface_mesh import SurfaceTexture
from egophys_core.perception.surface.surface_render import Rendering, facing, project, render, textured

PATCH_SIGMA_PX = 0.6
"""Pixels: error of a patch that is found and looks alike."""

FOLLOWED_SIGMA_PX = 1.0
"""Pixels: of one followed from the view before, which drifts."""

LEAST_LIKENESS = 0.75
"""Correlation below which a patch is not the one searched."""

SAME_PLACE_PX = 3.0
"""Reference pixels: a feature is in front where the rendering shows its own place."""

HAND_MARGIN_PX = 4
OBJECT_MARGIN_PX = 2
"""Pixels: how far from the hand, and how far outside the object's mask, a feature may be found."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """Features found in a view."""

    features: np.ndarray
    """[K] int."""
    pixels: np.ndarray
    """[K, 2]: x and y."""
    sigma: np.ndarray
    """[K] pixels."""
    side: np.ndarray
    """[K]: +1 for the skin that the reference view shows, -1 for the other."""

    def without(self, features: np.ndarray) -> "Found":
        """Those that are not among the given ones."""
        kept = ~np.isin(self.features, features)
        return Found(
            features=self.features[kept], pixels=self.pixels[kept], sigma=self.sigma[kept], side=self.side[kept]
        )

    def with_others(self, others: "Found") -> "Found":
        """These first, then those of the others that are not among them."""
        rest = others.without(self.features)
        return Found(
            features=np.append(self.features, rest.features),
            pixels=np.vstack([self.pixels, rest.pixels]),
            sigma=np.append(self.sigma, rest.sigma),
            side=np.append(self.side, rest.side),
        )


@dataclass(frozen=True, kw_only=True)
class RenderedSurface:
    """A predicted surface as a view would show it."""

    corners: np.ndarray
    """[F, 3, 3]: pixels and depth of the corners of each triangle, on the skin that faces the camera."""
    side: np.ndarray
    """[F]: +1 or -1, which skin that is."""
    rendering: Rendering
    """What is in front where."""


def scene_of(triangles: np.ndarray, skins: tuple[np.ndarray, np.ndarray], view: View) -> RenderedSurface:
    """Project and render a surface.

    Args:
        triangles: [F, 3] int.
        skins: [W, 3] metres each: the skin that the reference view shows, and the other.
        view: its pose is known.
    """
    shown, other = (project(skin, view.camera_matrix, view.world_from_camera)[triangles] for skin in skins)
    front = facing(shown)
    corners = np.where(front[:, None, None], shown, other)
    return RenderedSurface(
        corners=corners, side=np.where(front, 1.0, -1.0), rendering=render(corners, view.image.shape[:2])
    )


def find_rendered(
    texture: SurfaceTexture, scene: RenderedSurface, evened: np.ndarray, masks: Masks, levels: int
) -> Found:
    """Features that the rendering shows in front, searched around where it shows them.

    Args:
        texture: a picture of the surface, and its features.
        scene: as predicted.
        evened: [S, S] uint8: the view with even contrast.
        masks: of the view.
        levels: of the pyramid.
    """
    corners = scene.corners[texture.feature_triangles]
    places = np.einsum("nk,nkd->nd", texture.feature_weights, corners[:, :, :2])
    x, y = inside(places, evened.shape).T
    in_view = ((places > WINDOW / 2) & (places < np.array(evened.shape[::-1]) - WINDOW / 2)).all(axis=1)
    source = scene.rendering.source(texture.corners)
    own = np.linalg.norm(source[y, x] - texture.feature_pixels, axis=1) < SAME_PLACE_PX
    drawn_there = np.isfinite(source[..., 0]).astype(np.float32)
    surface = cv2.blur(drawn_there, (WINDOW, WINDOW))[y, x] > texture.least_surface
    shown = np.flatnonzero(in_view & own & surface & may_show(masks)[y, x])
    drawn = textured(source, texture.image, np.full(evened.shape, 128, np.uint8))
    found = match(drawn, evened, places[shown], levels=levels)
    alike = likeness(drawn, places[shown], evened, found.pixels)
    good = _is_good(found.returned, alike, found.pixels, masks)
    return Found(
        features=texture.first + shown[good],
        pixels=found.pixels[good].astype(float),
        sigma=PATCH_SIGMA_PX / alike[good],
        side=scene.side[texture.feature_triangles[shown[good]]],
    )


def follow(before: Found, evened_before: np.ndarray, evened: np.ndarray, masks: Masks) -> Found:
    """Features found in the view before, searched from there."""
    found = match(evened_before, evened, before.pixels)
    alike = likeness(evened_before, before.pixels, evened, found.pixels)
    good = _is_good(found.returned, alike, found.pixels, masks)
    return Found(
        features=before.features[good],
        pixels=found.pixels[good].astype(float),
        sigma=np.full(np.count_nonzero(good), FOLLOWED_SIGMA_PX),
        side=before.side[good],
    )


def _is_good(returned: np.ndarray, alike: np.ndarray, pixels: np.ndarray, masks: Masks) -> np.ndarray:
    x, y = inside(pixels, masks.object.shape).T
    return (returned < LOST_PX) & (alike > LEAST_LIKENESS) & may_show(masks)[y, x] & _widened_object(masks)[y, x]


def may_show(masks: Masks) -> np.ndarray:
    """[S, S] bool: where no patch touches the hand."""
    size = 2 * HAND_MARGIN_PX + 1
    return cv2.dilate(masks.hand.astype(np.uint8), np.ones((size, size), np.uint8)) == 0


def _widened_object(masks: Masks) -> np.ndarray:
    size = 2 * OBJECT_MARGIN_PX + 1
    return cv2.dilate(masks.object.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
