"""The object at rest: when it lies still, where its surface is, what kind of object it is."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from egophys_core.errors import EpisodeError
from egophys_core.perception.camera.parallax import RestSurface, rays_of_pixels, surface_from_parallax
from egophys_core.perception.masks.silhouette import inside
from egophys_core.perception.options import ObjectKind, PerceptionOptions
from egophys_core.perception.stages import View
from egophys_core.perception.surface.completion import close_surface
from egophys_core.perception.surface.patch_match import LOST_PX, WINDOW, even_contrast, match
from egophys_core.perception.surface.rounding import rounded
from egophys_core.perception.surface.surface_fit import SurfaceModel
from egophys_core.perception.surface.surface_mesh import (
    SurfaceMesh,
    SurfaceTexture,
    boundary_edges,
    locate,
    mesh_of_mask,
    vertex_normals,
)

STILL_VIEWS = 10
"""Views over which rest is tested."""

STEP = 4
"""Views between the starts that are tried."""

STILL_PX = 0.3
"""Pixels: median residual of a point that does not move; good poses leave 0.1."""

MOVES_PX = 0.8
"""Pixels: from here on the object is said to move all the time."""

FLATTEST_M = 0.025
"""Metres: what lies lower everywhere is a sheet."""

RIM_PX = WINDOW / 2 + 1
"""Pixels from the outline of a solid within which a patch shows the background, too."""

LEAST_SURFACE = {ObjectKind.SHEET: 0.6, ObjectKind.SOLID: 0.95}
"""Share of a patch that must be surface: what lies behind the rim of a solid moves along it."""

FEWEST_SURE = 12
"""Vertices and features farther from it, without which nothing is said of how it rounds off."""

FEATURE_STEP = 3
"""Pixels between tracked places, at least."""

OPPOSITE_SIGMA_M = 0.004
"""Metres: of points of the hidden side, which symmetry tells."""

SHEET_STRAIN = 0.03
"""Standard deviation of the strain of an edge of a sheet."""

SHEET_BENDING_M = 0.0015
"""Metres: standard deviation of the gap of a hinge of a sheet."""


@dataclass(frozen=True, kw_only=True)
class RestObject:
    """An object at rest in a reference view."""

    reference: int
    """Index of the reference view among those given."""
    model: SurfaceModel
    """Its surface."""
    kind: ObjectKind
    """Sheet or solid."""
    feature_pixels: np.ndarray
    """[N, 2]: tracked places in the reference view."""
    feature_triangles: np.ndarray
    """[N] int."""
    feature_weights: np.ndarray
    """[N, 3]: barycentric coordinates."""
    texture: np.ndarray
    """[S, S] uint8: the reference view with even contrast."""
    residual_px: float
    """Pixels: median residual over the still views."""
    depth_sigma_m: float
    """Metres: median standard deviation of the vertices' depths."""
    sigma: np.ndarray
    """[W] metres: standard deviation of each point of the model."""
    note: str
    """What the user should know; empty if all is well."""

    @property
    def feature_step(self) -> float:
        """Pixels between neighbouring features in the reference view."""
        nearest = cKDTree(self.feature_pixels).query(self.feature_pixels, k=2)[0][:, 1]
        return float(np.median(nearest))

    @property
    def picture(self) -> SurfaceTexture:
        """The reference view as the texture of the surface."""
        mesh = self.model.mesh
        corners = np.full((len(self.model.triangles), 3, 2), np.nan)
        corners[: len(mesh.triangles)] = mesh.pixels[mesh.triangles]
        return SurfaceTexture(
            image=self.texture,
            corners=corners,
            least_surface=LEAST_SURFACE[self.kind],
            first=0,
            feature_pixels=self.feature_pixels,
            feature_triangles=self.feature_triangles,
            feature_weights=self.feature_weights,
        )


def rest_object(
    views: Sequence[View], masks: Sequence[np.ndarray], table_height: float, options: PerceptionOptions
) -> RestObject:
    """Find the longest start in which the object is still, and reconstruct it from the parallax of the camera.

    Args:
        views: the first second or so, poses known.
        masks: [S, S] bool each, of the object.
        table_height: z of the table, metres.
        options: of perception.

    Raises:
        EpisodeError: no object in the masks, or too few views.
    """
    if len(views) < 2:
        raise EpisodeError(f"{len(views)} view(s) of the object at rest; at least 2 are needed to see it in depth")
    evened = [even_contrast(view.image) for view in views]
    trials: list[tuple[float, _Trial]] = []
    for first in range(0, max(len(views) - STILL_VIEWS, 0) + 1, STEP):
        if masks[first].any():
            trial = _try(views, evened, masks[first], first, options)
            residual = _median_residual(trial.solve(STILL_VIEWS, table_height))
            trials.append((residual, trial))
            if residual < STILL_PX:
                break
    if not trials:
        raise EpisodeError("the object is not in the first views; start the video where it lies in view")
    residual, trial = min(trials, key=lambda each: each[0])
    # Go on as long as it stays still: a longer path of the camera sees more depth.
    moved = np.flatnonzero(~(trial.solve(len(trial.views), table_height).residual < max(STILL_PX, 1.5 * residual)))
    count = max(int(moved[moved >= STILL_VIEWS].min(initial=len(trial.views))), 2)
    note = ""
    if not np.isfinite(residual):
        note = (
            "the object has no texture that can be followed: its depth is a guess from the table and its outline; "
            "put marks on it or use learned models"
        )
    elif residual > MOVES_PX:
        note = (
            f"the object never lies still in the first {len(views)} views (median residual {residual:.1f} px): "
            "its rest shape is uncertain; film it for a second before it is touched"
        )
    return _object_of(trial, count, table_height, options, note)


@dataclass(frozen=True, kw_only=True)
class _Trial:
    """Tracks from one reference view through all the later ones."""

    first: int
    views: Sequence[View]
    mask: np.ndarray
    mesh: SurfaceMesh
    pixels: np.ndarray
    triangles: np.ndarray
    weights: np.ndarray
    tracks: np.ndarray
    texture: np.ndarray

    def solve(self, count: int, table_height: float) -> RestSurface:
        """Surface from the first views of the tracks."""
        views, tracks = list(self.views[:count]), self.tracks[:count]
        return surface_from_parallax(self.mesh, views, self.triangles, self.weights, tracks, table_height)

    def solve_solid(self, flat: RestSurface, count: int, table_height: float) -> RestSurface:
        """The surface of a solid, which rounds off towards its outline.

        Args:
            flat: what `solve` makes of the same views.
            count: of the views.
            table_height: z of the table, metres.
        """
        away = cv2.distanceTransform(np.pad(self.mask, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
        columns, rows = inside(self.mesh.pixels, self.mask.shape).T
        sure = away[rows, columns] > RIM_PX
        columns, rows = inside(self.pixels, self.mask.shape).T
        clear = away[rows, columns] > RIM_PX
        if np.count_nonzero(sure) < FEWEST_SURE or np.count_nonzero(clear) < FEWEST_SURE:
            return flat
        return surface_from_parallax(
            self.mesh,
            list(self.views[:count]),
            self.triangles[clear],
            self.weights[clear],
            self.tracks[:count, clear],
            table_height,
            rounded(self.mask, self.mesh.pixels, flat.inverse, sure),
        )


def _try(
    views: Sequence[View], evened: list[np.ndarray], mask: np.ndarray, first: int, options: PerceptionOptions
) -> _Trial:
    mesh = mesh_of_mask(mask, options.spacing)
    pixels, triangles, weights = _features(mesh, mask, options.queries)
    tracks, guess = [pixels], None
    for target in evened[first + 1 :]:
        found = match(evened[first], target, pixels, guess)
        guess = found.pixels
        tracks.append(np.where(found.returned[:, None] < LOST_PX, found.pixels.astype(float), np.nan))
    return _Trial(
        first=first,
        views=views[first:],
        mask=mask,
        mesh=mesh,
        pixels=pixels,
        triangles=triangles,
        weights=weights,
        tracks=np.array(tracks),
        texture=evened[first],
    )


def _features(mesh: SurfaceMesh, mask: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places on a square grid in the mask, with their triangles and barycentric coordinates."""
    step = max(FEATURE_STEP, int(np.ceil(np.sqrt(np.count_nonzero(mask) / most))))
    rows, columns = np.nonzero(mask)
    on_grid = (rows % step == 0) & (columns % step == 0)
    pixels = np.column_stack([columns[on_grid], rows[on_grid]]).astype(float)
    triangles, weights = locate(mesh, pixels)
    covered = triangles >= 0
    return pixels[covered], triangles[covered], weights[covered]


def _object_of(trial: _Trial, count: int, table_height: float, options: PerceptionOptions, note: str) -> RestObject:
    """Model of a sheet or a solid from the skin that is seen in the first views of a trial."""
    rest = trial.solve(count, table_height)
    skin = rest.positions
    height = skin[:, 2] - table_height
    kind = options.kind
    if kind == ObjectKind.AUTO:
        kind = ObjectKind.SHEET if np.percentile(height, 95) < FLATTEST_M else ObjectKind.SOLID
    thickness, triangles = 0.0, trial.mesh.triangles
    if kind == ObjectKind.SHEET:
        # Its skin lies one thickness over the table where it lies flat; twins are of the middle surface.
        thickness = max(float(np.median(height[np.unique(boundary_edges(trial.mesh.triangles))])), 0.0)
        if np.percentile(height, 95) < FLATTEST_M:
            thickness = max(float(np.median(height)), 0.0)
            skin = _at_height(trial, table_height + thickness)
        # Triangles turn so that their normals point away from the reference view.
        positions = skin + thickness / 2 * vertex_normals(trial.mesh.triangles, skin)
    else:
        rest = trial.solve_solid(rest, count, table_height)
        skin = rest.positions
        closed = close_surface(trial.mesh, skin, table_height, trial.views[0])
        positions, triangles = closed.positions, closed.triangles
    return RestObject(
        reference=trial.first,
        model=SurfaceModel(
            mesh=trial.mesh,
            rest=positions,
            triangles=triangles,
            thickness=thickness,
            stretch_sigma=SHEET_STRAIN,
            shortening_sigma=SHEET_STRAIN,
            bending_sigma=SHEET_BENDING_M,
            lowest=table_height + thickness / 2,
        ),
        kind=kind,
        feature_pixels=trial.pixels,
        feature_triangles=trial.triangles,
        feature_weights=trial.weights,
        texture=trial.texture,
        residual_px=_median_residual(rest),
        depth_sigma_m=float(np.median(rest.depth_sigma)),
        sigma=np.concatenate([rest.depth_sigma, np.full(len(positions) - len(skin), OPPOSITE_SIGMA_M)]),
        note=note,
    )


def _median_residual(rest: RestSurface) -> float:
    """Pixels: over the views after the first; infinite if nothing was tracked in any."""
    known = rest.residual[1:][np.isfinite(rest.residual[1:])]
    return float(np.median(known)) if len(known) else float("inf")


def _at_height(trial: _Trial, height: float) -> np.ndarray:
    """[V, 3]: where the rays of the vertices meet a level plane."""
    view = trial.views[0]
    centre = view.world_from_camera[:3, 3]
    rays = rays_of_pixels(trial.mesh.pixels, view)
    return centre + rays * ((height - centre[2]) / rays[:, 2])[:, None]
