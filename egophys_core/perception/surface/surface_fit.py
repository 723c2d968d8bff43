"""Shape of a deforming surface in one view: shape from template by sparse Gauss-Newton.

What is minimised over the points X [W, 3], each term over its standard deviation:

- reprojection: tracked places of the surface against where they were found, robust (Cauchy);
- lengths: links (edges of the mesh; for solids also struts through the body) keep the length that they have at rest,
  more strictly against stretch than against shortening, since a fold finer than the mesh shortens an edge;
- bending: the gap of each hinge (see `hinge_gaps`) stays what it is at rest along the current normal, robust, since
  cloth creases;
- motion: vertices lie where they were predicted;
- table: vertices lie above it, one-sided; those that lay on it at rest lie on it, robust, since they may be lifted.

The places that are seen lie on the skin, half a thickness off the middle surface that the vertices stand for.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.sparse.csgraph import reverse_cuthill_mckee

from egophys_core.perception.robust import cauchy_weights
from egophys_core.perception.stages import View
from egophys_core.perception.surface.surface_mesh import SurfaceMesh, hinge_gaps, vertex_normals

TABLE_SIGMA_M = 0.0003
"""Metres: how deep a point may lie in the table."""

RESTING_SIGMA_M = 0.003
"""Metres: how far above the table a point lies that lay on it at rest."""

LIFTED_M = 0.003
"""Metres above the table from which on a point counts as lifted."""

ON_TABLE_M = 0.004
"""Metres above the lowest place at which a point at rest still lies on the table."""


CREASE = 3.0
"""Standard deviations of bending from which on a hinge is rather a crease."""

SAMPLES = 12
"""Of the posterior; they give standard deviations to within 12 %."""


@dataclass(frozen=True, kw_only=True)
class SurfaceModel:
    """A surface at rest, and how freely it deforms."""

    mesh: SurfaceMesh
    """V vertices."""
    rest: np.ndarray
    """[W, 3] metres, frame world: the vertices (of sheets on the middle surface, of solids on the skin), then W - V
    points of the hidden side of a solid."""
    triangles: np.ndarray
    """[F, 3] int: those of the mesh; for a solid, then those of its hidden side."""
    thickness: float
    """Metres between the two skins of a sheet; 0 for the skin of a solid."""
    stretch_sigma: float
    """Standard deviation of the strain of an edge that is longer than at rest."""
    shortening_sigma: float
    """Of one that is shorter."""
    bending_sigma: float
    """Metres: of the gap of a hinge."""
    lowest: float
    """Metres: z of points that lie on the table."""


@dataclass(frozen=True, kw_only=True)
class Correspondences:
    """Places of the surface found in a view."""

    corners: np.ndarray
    """[M, 3] int: vertices around each place."""
    weights: np.ndarray
    """[M, 3]: barycentric coordinates."""
    side: np.ndarray
    """[M]: +1 where the skin seen is the one that the reference view shows, -1 the other."""
    pixels: np.ndarray
    """[M, 2]: where they were found."""
    sigma: np.ndarray
    """[M] pixels."""
    robust_scale: np.ndarray
    """[M] pixels: the residual from which on one is rather taken for wrong (scale of the Cauchy weight)."""


@dataclass(frozen=True, kw_only=True)
class FittedSurface:
    """Vertices in one view."""

    positions: np.ndarray
    """[W, 3] metres, frame world."""
    sigma: np.ndarray
    """[W] metres: square root of the trace of each point's posterior covariance."""
    residual: np.ndarray
    """[M] pixels: distance of each correspondence from its place."""


@dataclass(frozen=True)
class SurfaceFitter:
    """What is made once for a model and used in every view."""

    model: SurfaceModel
    gaps: sparse.csr_matrix
    """[3 H, 3 V]: the gap vectors of the hinges."""
    rest_gap: np.ndarray
    """[H] metres: the gap at rest along the normal."""
    rest_length: np.ndarray
    """[E] metres."""
    is_resting: np.ndarray
    """[W] bool: what lay on the table at rest."""
    place: np.ndarray
    """[3 W] int: where each coordinate stands in the order that keeps neighbours near each other."""
    bandwidth: int
    """Farthest that two coupled coordinates stand apart in it."""

    def fit(
        self,
        view: View,
        correspondences: Correspondences,
        predicted: np.ndarray,
        motion_sigma: np.ndarray,
        iterations: int,
        start: np.ndarray,
    ) -> FittedSurface:
        """Minimise, and estimate how sure the result is.

        The posterior covariance is that of the samples A^-1 J^T n with white noise n, where J holds the derivatives of
        all terms over their standard deviations and A = J^T J (Papandreou and Yuille 2010, perturb and MAP).

        Args:
            view: its pose is known.
            correspondences: M of them, possibly none.
            predicted: [W, 3] metres.
            motion_sigma: [W] metres, of the prediction.
            iterations: of Gauss-Newton.
            start: [W, 3] metres: where the search begins.
        """
        positions = start
        for _ in range(iterations):
            jacobian, residuals, diagonal, gradient = self._system(
                view, correspondences, positions, predicted, motion_sigma
            )
            solve = self._factorised(jacobian.T @ jacobian + sparse.diags(diagonal.ravel()))
            positions = positions - solve(jacobian.T @ residuals + gradient.ravel()).reshape(-1, 3)
        random = np.random.default_rng(0)
        noise = jacobian.T @ random.standard_normal((len(residuals), SAMPLES))
        noise += np.sqrt(diagonal).reshape(-1, 1) * random.standard_normal((diagonal.size, SAMPLES))
        spread = solve(noise).reshape(-1, 3, SAMPLES)
        return FittedSurface(
            positions=positions,
            sigma=np.sqrt((spread**2).mean(axis=2).sum(axis=1)),
            residual=np.linalg.norm(self._reprojection(view, correspondences, positions)[0], axis=1),
        )

    def _system(
        self,
        view: View,
        correspondences: Correspondences,
        positions: np.ndarray,
        predicted: np.ndarray,
        motion_sigma: np.ndarray,
    ) -> tuple[sparse.csr_matrix, np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives and residuals over deviations; information [W, 3] and gradient [W, 3] of motion and table."""
        rows = [
            self._correspondence_rows(view, correspondences, positions),
            self._length_rows(positions),
            self._bending_rows(positions),
        ]
        blocks, residuals = zip(*rows, strict=True)
        diagonal = np.repeat(1 / motion_sigma[:, None] ** 2, 3, axis=1)
        gradient = diagonal * (positions - predicted)
        height = positions[:, 2] - self.model.lowest
        table = np.where(height < 0, 1 / TABLE_SIGMA_M**2, 0.0)
        on_it = self.is_resting
        table[on_it] += 1 / (RESTING_SIGMA_M * (1 + (height[on_it] / LIFTED_M) ** 2)) ** 2
        diagonal[:, 2] += table
        gradient[:, 2] += table * height
        return sparse.vstack(blocks, format="csr"), np.concatenate(residuals), diagonal, gradient

    def _factorised(self, matrix: sparse.spmatrix) -> Callable[[np.ndarray], np.ndarray]:
        """Solver for right-hand sides [3 W] or [3 W, K]: Cholesky within the band that the order of points leaves."""
        entries = matrix.tocoo()
        row, column = self.place[entries.row], self.place[entries.col]
        lower = row >= column
        band = np.zeros((self.bandwidth + 1, matrix.shape[0]))
        band[(row - column)[lower], column[lower]] = entries.data[lower]
        factor = cholesky_banded(band, lower=True, overwrite_ab=True, check_finite=False)

        def solve(right: np.ndarray) -> np.ndarray:
            ordered = np.empty_like(right)
            ordered[self.place] = right
            return np.asarray(cho_solve_banded((factor, True), ordered, check_finite=False)[self.place])

        return solve

    def _correspondence_rows(
        self, view: View, correspondences: Correspondences, positions: np.ndarray
    ) -> tuple[sparse.csr_matrix, np.ndarray]:
        residual, jacobian = self._reprojection(view, correspondences, positions)
        weight = cauchy_weights((residual**2).sum(axis=1), correspondences.robust_scale)
        scale = np.repeat(np.sqrt(weight) / correspondences.sigma, 2)
        return sparse.diags(scale) @ jacobian, scale * residual.ravel()

    def _length_rows(self, positions: np.ndarray) -> tuple[sparse.csr_matrix, np.ndarray]:
        one, other = self.model.mesh.edges.T
        along = positions[other] - positions[one]
        length = np.maximum(np.linalg.norm(along, axis=1), 1e-9)
        strain = np.where(length > self.rest_length, self.model.stretch_sigma, self.model.shortening_sigma)
        sigma = strain * self.rest_length
        direction = along / (length * sigma)[:, None]
        rows = np.repeat(np.arange(len(one)), 6)
        columns = (3 * np.column_stack([one, one, one, other, other, other]) + np.array([0, 1, 2, 0, 1, 2])).ravel()
        values = np.column_stack([-direction, direction]).ravel()
        shape = (len(one), positions.size)
        return sparse.csr_matrix((values, (rows, columns)), shape=shape), (length - self.rest_length) / sigma

    def _bending_rows(self, positions: np.ndarray) -> tuple[sparse.csr_matrix, np.ndarray]:
        sigma = self.model.bending_sigma
        wanted = self.rest_gap[:, None] * _hinge_normals(self.model.mesh.hinges, positions)
        gap = (self.gaps @ positions.ravel()).reshape(-1, 3) - wanted
        weight = cauchy_weights((gap**2).sum(axis=1), CREASE * sigma)
        scale = np.repeat(np.sqrt(weight) / sigma, 3)
        return sparse.diags(scale) @ self.gaps, scale * gap.ravel()

    def _reprojection(
        self, view: View, correspondences: Correspondences, positions: np.ndarray
    ) -> tuple[np.ndarray, sparse.csr_matrix]:
        """Projected less found [M, 2], and its derivative [2 M, 3 V] (normals held)."""
        skin = self.skin(positions, 1.0)[correspondences.corners]
        if self.model.thickness > 0:
            middle = positions[correspondences.corners]
            skin = middle + correspondences.side[:, None, None] * (skin - middle)
        places = np.einsum("mk,mkd->md", correspondences.weights, skin)
        rotation = view.world_from_camera[:3, :3]
        in_camera = (places - view.world_from_camera[:3, 3]) @ rotation
        depth = np.maximum(in_camera[:, 2:], 1e-3)
        flat = in_camera[:, :2] / depth
        focal = view.camera_matrix.diagonal()[:2]
        residual = focal * flat + view.camera_matrix[:2, 2] - correspondences.pixels
        # d(focal x / z) = focal (R_x - flat R_z) / z
        slope = (focal / depth)[:, :, None] * (rotation.T[:2] - flat[:, :, None] * rotation.T[2])
        values = slope[:, :, None, :] * correspondences.weights[:, None, :, None]
        columns = 3 * correspondences.corners[:, None, :, None] + np.arange(3)
        shape = (len(places), 2, 3, 3)
        rows = np.arange(2 * len(places)).reshape(-1, 2, 1, 1)
        jacobian = sparse.csr_matrix(
            (
                values.ravel(),
                (np.broadcast_to(rows, shape).ravel(), np.broadcast_to(columns, shape).ravel()),
            ),
            shape=(2 * len(places), positions.size),
        )
        return residual, jacobian

    def skin(self, positions: np.ndarray, side: float) -> np.ndarray:
        """[V, 3] metres: the skin on one side, +1 the one that the reference view shows."""
        if self.model.thickness == 0:
            return positions
        # Triangles turn clockwise as the reference view sees them, so their normals point away from it.
        normals = vertex_normals(self.model.mesh.triangles, positions)
        return positions - side * self.model.thickness / 2 * normals


def fitter_of(model: SurfaceModel) -> SurfaceFitter:
    """Prepare what stays the same over all views."""
    mesh = model.mesh
    gaps = hinge_gaps(mesh.hinges, model.rest)
    normals = _hinge_normals(mesh.hinges, model.rest)
    one, other = model.mesh.edges.T
    place, bandwidth = _order(model)
    return SurfaceFitter(
        model=model,
        gaps=sparse.kron(gaps, sparse.identity(3), format="csr"),
        rest_gap=((gaps @ model.rest) * normals).sum(axis=1),
        rest_length=np.linalg.norm(model.rest[other] - model.rest[one], axis=1),
        is_resting=model.rest[:, 2] < model.lowest + ON_TABLE_M,
        place=place,
        bandwidth=bandwidth,
    )


def _order(model: SurfaceModel) -> tuple[np.ndarray, int]:
    """Place of each coordinate when points are ordered by reverse Cuthill-McKee, and the bandwidth that leaves."""
    hinges = model.mesh.hinges
    pairs = np.vstack([model.mesh.edges, *(hinges[:, [i, j]] for i in range(4) for j in range(i))])
    size = len(model.rest)
    coupled = sparse.csr_matrix((np.ones(len(pairs)), pairs.T), shape=(size, size))
    order = reverse_cuthill_mckee((coupled + coupled.T).tocsr(), symmetric_mode=True)
    rank = np.empty(size, int)
    rank[order] = np.arange(size)
    farthest = int(np.abs(rank[pairs[:, 0]] - rank[pairs[:, 1]]).max(initial=0))
    return (3 * rank[:, None] + np.arange(3)).ravel(), 3 * farthest + 2


def _hinge_normals(hinges: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """[H, 3] unit vectors across the two diagonals of each hinge; zero where these are parallel."""
    a, b, c, d = (positions[hinges[:, corner]] for corner in range(4))
    normals = np.cross(b - a, d - c)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, length, out=np.zeros_like(normals), where=length > 1e-12)
