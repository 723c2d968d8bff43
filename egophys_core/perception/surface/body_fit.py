"""Shape of a solid in one view: a rigid motion of its shape at rest, and few smooth modes of deformation about it.

A place x of the body at rest, from its middle and over its size L, is at X = R (x + u(x)) + t with
u(x) = E x + L sum_k m_k(x / L) d_k, where E is a symmetric strain and m_k are the six monomials of second degree, less
their linear part: bends and uneven stretch. All of it is found anew in every view from the shape at rest, so that
nothing drifts.

One camera does not tell a body that grows from one that comes nearer. Hands pull a soft body longer along one line
rather than make it thinner across it (foam and stuffing have a Poisson ratio of 0 to 0.3), so stretch along a principal
direction is freer than shortening.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.perception.robust import cauchy_weights
from egophys_core.perception.stages import View
from egophys_core.perception.surface.surface_fit import Correspondences, FittedSurface, SurfaceModel

STIFF, SOFT = 0.002, 0.02
"""Strain of a body that shows none, and the largest that is believed before it is seen: a body is taken for as soft as
it shows by what one camera sees, its strain less its growth."""

STRETCH, SHORTENING = 1.5, 0.5
"""Standard deviations of principal strains, over that strain."""

BENDING = 0.003
"""Least standard deviation of the strain that the modes of second degree make at the rim."""

TURN_SIGMA_RAD = 0.2
"""A view: error of the predicted turn."""

DEFORMATION_SIGMA = 0.01
"""Strain a view: how fast the deformation changes."""

TABLE_SIGMA_M = 0.020
"""Metres: how deep a point may lie in the table; the hidden side is only known by symmetry."""

WIDEST = 1.5
"""The robust scale begins at so many median residuals, so that a wrong start does not make all of them wrong."""

_SYMMETRIC = np.zeros((6, 3, 3))
for _index, (_one, _other) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))):
    _SYMMETRIC[_index, _one, _other] = _SYMMETRIC[_index, _other, _one] = 1.0
_UPPER = np.triu_indices(3)
STRAINS, BENDS = 6, 18
"""Numbers of modes."""


@dataclass(frozen=True)
class _Pose:
    """Where a body is, and how it is deformed."""

    rotation: np.ndarray
    """[3, 3]: world from body."""
    translation: np.ndarray
    """[3] metres: its middle in the world."""
    modes: np.ndarray
    """[24]: six strains (xx, yy, zz, xy, xz, yz), then three components of each of six bends."""


@dataclass(frozen=True)
class _Expected:
    """Where a body is expected."""

    pose: _Pose
    shift_sigma: float
    """Metres."""


@dataclass(frozen=True)
class BodyFitter:
    """What is made once for a body and used in every view."""

    model: SurfaceModel
    monomials: np.ndarray
    """[W, 9]: first and second degree, of the points at rest from their middle, over the size; the second less what
    of it is linear over the points."""
    size: float
    """Metres: root mean square distance from the middle."""

    def fit(
        self,
        view: View,
        correspondences: Correspondences,
        predicted: np.ndarray,
        motion_sigma: np.ndarray,
        iterations: int,
        start: np.ndarray,
    ) -> FittedSurface:
        """Least squares over rigid motion and modes, robust, from wide to narrow.

        Args:
            view: its pose is known.
            correspondences: M of them, possibly none.
            predicted: [W, 3] metres.
            motion_sigma: [W] metres, of the prediction; the body moves by their mean.
            iterations: of Gauss-Newton.
            start: [W, 3] metres: where the search begins.
        """
        expected = _Expected(pose=self._pose(predicted), shift_sigma=float(motion_sigma.mean()))
        pose = self._pose(start)
        for _ in range(iterations):
            information, gradient = self._system(view, correspondences, expected, pose)
            pose = _moved(pose, -np.linalg.solve(information, gradient))
        covariance = np.linalg.inv(self._system(view, correspondences, expected, pose)[0])
        slopes = self._slopes(pose, self.monomials)
        variance = np.einsum("wip,pq,wiq->w", slopes, covariance, slopes)
        positions = self._places(pose, self.monomials)
        residual = np.linalg.norm(self._reprojection(view, correspondences, pose)[0], axis=1)
        # What the modes leave over where the body is seen, they leave over everywhere.
        depth = (positions - view.world_from_camera[:3, 3]) @ view.world_from_camera[:3, 2]
        left = (np.median(residual) if len(residual) else 0.0) * depth / view.camera_matrix[0, 0]
        return FittedSurface(positions=positions, sigma=np.sqrt(np.maximum(variance, 0.0) + left**2), residual=residual)

    def skin(self, positions: np.ndarray, side: float) -> np.ndarray:
        """[W, 3] metres: the points of a solid lie on its skin."""
        return positions

    def _system(
        self, view: View, correspondences: Correspondences, expected: _Expected, pose: _Pose
    ) -> tuple[np.ndarray, np.ndarray]:
        """Information [30, 30] and gradient [30]."""
        residual, jacobian = self._reprojection(view, correspondences, pose)
        squared = (residual**2).sum(axis=1)
        scale = correspondences.robust_scale
        if len(squared):
            scale = np.maximum(scale, WIDEST * np.sqrt(np.median(squared)))
        weight = cauchy_weights(squared, scale) / correspondences.sigma**2
        weighted = jacobian * weight[:, None, None]
        information = np.einsum("mip,miq->pq", weighted, jacobian, optimize=True)
        gradient = np.einsum("mip,mi->p", weighted, residual)
        for rows, values in (_prior_rows(expected, pose), self._table_rows(pose)):
            information += rows.T @ rows
            gradient += rows.T @ values
        return information, gradient

    def _reprojection(self, view: View, correspondences: Correspondences, pose: _Pose) -> tuple[np.ndarray, np.ndarray]:
        """Projected less found [M, 2] pixels, and its derivative [M, 2, 30]."""
        monomials = np.einsum("mk,mkp->mp", correspondences.weights, self.monomials[correspondences.corners])
        rotation = view.world_from_camera[:3, :3]
        in_camera = (self._places(pose, monomials) - view.world_from_camera[:3, 3]) @ rotation
        depth = np.maximum(in_camera[:, 2:], 1e-3)
        flat = in_camera[:, :2] / depth
        focal = view.camera_matrix.diagonal()[:2]
        slope = (focal / depth)[:, :, None] * (rotation.T[:2] - flat[:, :, None] * rotation.T[2])
        residual = focal * flat + view.camera_matrix[:2, 2] - correspondences.pixels
        return residual, slope @ self._slopes(pose, monomials)

    def _places(self, pose: _Pose, monomials: np.ndarray) -> np.ndarray:
        """[M, 3] metres, frame world."""
        return self._in_body(pose, monomials) @ pose.rotation.T + pose.translation

    def _in_body(self, pose: _Pose, monomials: np.ndarray) -> np.ndarray:
        strain = np.einsum("a,aij->ij", pose.modes[:STRAINS], _SYMMETRIC)
        linear = monomials[:, :3] @ (np.eye(3) + strain)
        return self.size * (linear + monomials[:, 3:] @ pose.modes[STRAINS:].reshape(6, 3))

    def _slopes(self, pose: _Pose, monomials: np.ndarray) -> np.ndarray:
        """[M, 3, 30]: derivatives of places by a turn and a shift in the world and by the modes."""
        slopes = np.zeros((len(monomials), 3, 6 + STRAINS + BENDS))
        x, y, z = (self._in_body(pose, monomials) @ pose.rotation.T).T
        slopes[:, 0, 1], slopes[:, 0, 2] = z, -y
        slopes[:, 1, 0], slopes[:, 1, 2] = -z, x
        slopes[:, 2, 0], slopes[:, 2, 1] = y, -x
        slopes[:, :, 3:6] = np.eye(3)
        strained = np.einsum("aij,mj->mia", _SYMMETRIC, monomials[:, :3])
        slopes[:, :, 6:12] = self.size * (pose.rotation @ strained)
        bent = monomials[:, None, 3:, None] * pose.rotation[:, None, :]
        slopes[:, :, 12:] = self.size * bent.reshape(len(monomials), 3, BENDS)
        return slopes

    def _table_rows(self, pose: _Pose) -> tuple[np.ndarray, np.ndarray]:
        """Of points in the table."""
        depth = self._places(pose, self.monomials)[:, 2] - self.model.lowest
        below = depth < 0
        return self._slopes(pose, self.monomials[below])[:, 2] / TABLE_SIGMA_M, depth[below] / TABLE_SIGMA_M

    def _pose(self, positions: np.ndarray) -> _Pose:
        """The nearest one, by least squares over all points."""
        columns = np.column_stack([np.ones(len(positions)), self.monomials])
        solved = np.linalg.lstsq(columns, positions, rcond=None)[0]
        left, stretch, right = np.linalg.svd(solved[1:4].T / self.size)
        rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
        strain = right.T @ np.diag(stretch) @ right - np.eye(3)
        bends = solved[4:] @ rotation / self.size
        return _Pose(
            rotation=rotation,
            translation=solved[0],
            modes=np.concatenate([strain.diagonal(), strain[[0, 0, 1], [1, 2, 2]], bends.ravel()]),
        )


def body_fitter_of(model: SurfaceModel) -> BodyFitter:
    """Prepare what stays the same over all views."""
    apart = model.rest - model.rest.mean(axis=0)
    size = float(np.sqrt((apart**2).sum(axis=1).mean()))
    x, y, z = (apart / size).T
    linear = np.column_stack([np.ones(len(apart)), x, y, z])
    bends = np.column_stack([x * x, y * y, z * z, x * y, x * z, y * z])
    # Less what a shift, turn and strain do: on an ellipsoid the squares add up to a constant.
    bends -= linear @ np.linalg.lstsq(linear, bends, rcond=None)[0]
    return BodyFitter(model=model, monomials=np.hstack([linear[:, 1:], bends]), size=size)


def _prior_rows(expected: _Expected, pose: _Pose) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives and residuals, over their deviations, of motion, change of deformation and deformation."""
    turn = _vector_of(pose.rotation @ expected.pose.rotation.T) / TURN_SIGMA_RAD
    shift = (pose.translation - expected.pose.translation) / expected.shift_sigma
    change = (pose.modes - expected.pose.modes) / DEFORMATION_SIGMA
    sigma_of = ((3, TURN_SIGMA_RAD), (3, expected.shift_sigma), (STRAINS + BENDS, DEFORMATION_SIGMA))
    motion = np.concatenate([np.full(count, 1 / sigma) for count, sigma in sigma_of])
    strain = np.einsum("a,aij->ij", pose.modes[:STRAINS], _SYMMETRIC)
    principal, axes = np.linalg.eigh(strain)
    softness = min(np.hypot(STIFF, np.std(principal)), SOFT)
    sigma = softness * np.where(principal > 0, STRETCH, SHORTENING)
    shear = np.sqrt(sigma[:, None] * sigma)[_UPPER]
    elastic = np.zeros((STRAINS + BENDS, 6 + STRAINS + BENDS))
    turned = axes.T @ _SYMMETRIC @ axes
    elastic[:STRAINS, 6:12] = turned[:, *_UPPER].T / shear[:, None]
    bends = pose.modes[STRAINS:]
    elastic[STRAINS:, 12:] = np.eye(BENDS) / np.hypot(BENDING, np.sqrt((bends**2).mean()))
    rows = np.vstack([np.diag(motion), elastic])
    return rows, np.concatenate([turn, shift, change, elastic[:, 6:] @ pose.modes])


def _moved(pose: _Pose, step: np.ndarray) -> _Pose:
    return _Pose(
        rotation=_rotation_of(step[:3]) @ pose.rotation,
        translation=pose.translation + step[3:6],
        modes=pose.modes + step[6:],
    )


def _rotation_of(vector: np.ndarray) -> np.ndarray:
    return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def _vector_of(rotation: np.ndarray) -> np.ndarray:
    return np.asarray(Rotation.from_matrix(rotation).as_rotvec())
