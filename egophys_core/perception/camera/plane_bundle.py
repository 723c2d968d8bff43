"""Camera poses over a plane, from where its points are seen: the tilt of the first camera, then all poses together."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu
from scipy.spatial.transform import Rotation

from egophys_core.geometry import nearest_rotation
from egophys_core.perception.robust import cauchy_weights, robust_scale

_LEAST_SIGMA = 0.05
"""Pixels: no match is better."""
_CORRELATION = 100.0
"""By how much errors that are alike raise the variance: those of a keyframe's points are the same in all frames;
measured, docs/notes/background_motion.md."""
_TILT_FLOOR = 1e-3
"""Radians: no table is flatter and no lens calibrated better than this."""
_NORMALS = 8000
_LEAST_SLANT = 0.02
"""Sine of the angle between the plane and the directions in which it is seen."""
_DAMPING = 1e-3
"""Radians squared inverse: keeps the tilt where it is when nothing is seen of it."""
_SETTLED = 1e-7
TILT_FREE = (False, False, False, True, True, False)
"""Of place and turn of the first pose: how the plane lies to it."""


@dataclass(frozen=True, kw_only=True)
class Link:
    """Points of the plane seen in two frames."""

    source: int
    target: int
    """Indices of poses."""
    points: np.ndarray
    """[N] int: names of the points, for the caller."""
    rays: np.ndarray
    """[N, 3] directions in the source's camera, z = 1."""
    flat: np.ndarray
    """[N, 2] x / z and y / z in the target's camera."""


@dataclass(frozen=True, kw_only=True)
class Tie:
    """A camera located otherwise: by the print of a board."""

    source: int
    """Index of the pose of the board."""
    target: int
    """Index of the camera's pose."""
    pose: np.ndarray
    """[4, 4] board from camera."""
    covariance: np.ndarray
    """[6, 6] of the camera's place, metres, and of a small turn, radians, along the axes of the board."""


@dataclass(frozen=True, kw_only=True)
class Bundle:
    """Poses that fit the links best."""

    poses: np.ndarray
    """[T, 4, 4] world from camera."""
    residuals: list[np.ndarray]
    """Per link [N], pixels: distance of seen and projected."""
    cost: float
    """Robust mean square, pixels squared."""
    covariances: np.ndarray
    """[T, 6, 6] of place, metres, and turn, radians, along the world's axes; 0 where fixed or not asked for."""
    tilt_sigma: float
    """Radians: standard deviation of the direction of the plane's normal, in its worst direction."""


def camera_over_plane(up: np.ndarray, height: float) -> np.ndarray:
    """[4, 4] world from camera, above the world's origin, the world's x towards the camera's right.

    Args:
        up: [3] unit normal of the plane in the camera frame, towards the camera.
        height: of the camera over the plane, any length unit.
    """
    right = np.array([1.0, 0, 0]) - up[0] * up
    if np.linalg.norm(right) < 1e-3:
        right = np.array([0, -1.0, 0]) + up[1] * up
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(up, right), up])
    pose[2, 3] = height
    return pose


def plane_normals(moves: np.ndarray, rays: np.ndarray, count: int = 3) -> np.ndarray:
    """[K, 3] unit normals, towards the camera, that explain plane-induced homographies, likeliest first.

    A homography between calibrated views of a plane, M = R + t n' / d, maps directions in the plane by a similarity:
    |M x| = |M y| and M x . M y = 0 for any orthonormal x, y across n. One view leaves two answers (Faugeras and
    Lustman 1988); views from elsewhere leave one. Normals are compared on a grid of about 2
    degrees.

    Args:
        moves: [T, 3, 3] to each view from the first, calibrated, of any scale.
        rays: [N, 3] directions in the first view in which the plane is seen.
        count: K, how many at least 20 degrees apart.
    """
    grid = _sphere(_NORMALS)
    grid = grid[(grid @ (rays / np.linalg.norm(rays, axis=1)[:, None]).T < -_LEAST_SLANT).mean(axis=1) > 0.98]
    across = np.cross(grid, np.eye(3)[np.abs(grid).argmin(axis=1)])
    across /= np.linalg.norm(across, axis=1)[:, None]
    along = np.cross(grid, across)
    cost = np.zeros(len(grid))
    for move in moves:
        x, y = across @ move.T, along @ move.T
        xx, yy, xy = (x * x).sum(axis=1), (y * y).sum(axis=1), (x * y).sum(axis=1)
        cost += ((xx - yy) ** 2 + 4 * xy**2) / (xx + yy) ** 2
    found: list[np.ndarray] = []
    for index in np.argsort(cost):
        if all(grid[index] @ other < np.cos(np.radians(20)) for other in found):
            found.append(grid[index])
        if len(found) == count:
            break
    return np.array(found).reshape(-1, 3)


def pose_from_move(move: np.ndarray, first: np.ndarray) -> np.ndarray:
    """[4, 4] world from camera of a view, from its calibrated homography [3, 3] and the first view's pose [4, 4]."""
    from_world = np.linalg.inv(first)
    columns = move @ from_world[:3, [0, 1, 3]]
    columns /= np.sqrt(np.linalg.norm(columns[:, 0]) * np.linalg.norm(columns[:, 1]))
    rotation = nearest_rotation(np.column_stack([columns[:, :2], np.cross(columns[:, 0], columns[:, 1])]))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.T, -rotation.T @ columns[:, 2]
    return pose


def adjust(
    poses: np.ndarray,
    first: int,
    links: list[Link],
    focal: float,
    *,
    first_free: Sequence[bool] = TILT_FREE,
    ties: Sequence[Tie] = (),
    all_covariances: bool = False,
    iterations: int = 20,
) -> Bundle:
    """Least squares over all poses, robust (Cauchy), with points on z = 0 given by the link's source.

    Of the first pose only the tilt is free, unless told otherwise: place, scale and heading of the world are its own.

    Args:
        poses: [T, 4, 4] world from camera, nearly right; those without links stay.
        first: index of the first pose.
        links: between poses.
        focal: pixels, to weigh and to report.
        first_free: which of the first pose's place (x, y, z) and turn (about x, y, z) are free.
        ties: between poses; the first pose may be that of the board.
        all_covariances: of all poses, which takes a while, or of the first only.
        iterations: at most.
    """
    poses = poses.copy()
    free = np.zeros((len(poses), 6), bool)
    free[[link.source for link in links] + [link.target for link in links]] = True
    free[first] = first_free
    unknowns = np.flatnonzero(free)
    scale = np.where(free, 1.0, 0.0).reshape(-1)
    height = float(np.median(np.abs(poses[:, 2, 3])))
    step = np.inf
    for _ in range(iterations):
        terms = [_linearise(link, poses, focal) for link in links]
        sigma = _spread(terms)
        system = _System(len(poses))
        _add_links(system, links, terms, sigma)
        _add_ties(system, ties, poses)
        kept = system.information()[unknowns][:, unknowns] + sparse.diags(_damping(free, height)[unknowns])
        change = np.zeros(free.size)
        solver = splu(kept.tocsc())
        change[unknowns] = -solver.solve(system.gradient.reshape(-1)[unknowns])
        step = float(np.abs(change * scale).max())
        change = change.reshape(-1, 6) * min(1.0, 0.3 / max(step, 1e-12))
        for index in np.flatnonzero(free.any(axis=1)):
            poses[index, :3, 3] += change[index, :3]
            turn = Rotation.from_rotvec(change[index, 3:]).as_matrix()
            poses[index, :3, :3] = turn @ poses[index, :3, :3]
        if step < _SETTLED:
            break
    terms = [_linearise(link, poses, focal) for link in links]
    covariances = np.zeros((len(poses), 6, 6))
    for index in range(len(poses)) if all_covariances else [first]:
        covariances[index] = _covariance(solver, unknowns, index)
    tilt = max(float(np.linalg.eigvalsh(covariances[first, 3:5, 3:5]).max()), 0.0)
    square = np.concatenate([(residual**2).sum(axis=1) for residual, _, _ in terms])
    return Bundle(
        poses=poses,
        residuals=[np.linalg.norm(residual, axis=1) for residual, _, _ in terms],
        cost=float(np.log1p(square).mean()),
        covariances=covariances,
        tilt_sigma=float(np.hypot(np.sqrt(tilt), _TILT_FLOOR)),
    )


def _linearise(link: Link, poses: np.ndarray, focal: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals [N, 2] in pixels, and their derivatives [N, 2, 6] by the pose of the source and of the target.

    A pose changes by a shift of the camera and a turn about it, both in the world.
    """
    source, target = poses[link.source], poses[link.target]
    rays = link.rays @ source[:3, :3].T
    falls = np.minimum(rays[:, 2], -1e-3)
    lengths = -source[2, 3] / falls
    places = source[:3, 3] + rays * lengths[:, None]
    # A ray's foot on the plane moves with the camera along the plane, and along the ray so as to stay on it.
    slide = np.eye(3) - rays[:, :, None] * np.array([0, 0, 1.0]) / falls[:, None, None]
    by_source = np.concatenate([slide, -lengths[:, None, None] * slide @ _cross(rays)], axis=2)
    apart = places - target[:3, 3]
    seen = apart @ target[:3, :3]
    by_target = np.concatenate([np.broadcast_to(-np.eye(3), (len(rays), 3, 3)), _cross(apart)], axis=2)
    depth = np.maximum(seen[:, 2], 1e-3)
    flat = seen[:, :2] / depth[:, None]
    project = np.zeros((len(rays), 2, 3))
    project[:, [0, 1], [0, 1]] = 1
    project[:, :, 2] = -flat
    project = focal / depth[:, None, None] * project @ target[:3, :3].T
    return focal * (flat - link.flat), project @ by_source, project @ by_target


def _spread(terms: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> float:
    """Robust standard deviation of the residuals, pixels."""
    return max(_LEAST_SIGMA, float(robust_scale(np.concatenate([residual for residual, _, _ in terms]))))


class _System:
    """Information [6T, 6T] and gradient [T, 6] of least squares over pairs of poses."""

    def __init__(self, count: int) -> None:
        self.gradient = np.zeros((count, 6))
        self._blocks: list[np.ndarray] = []
        self._rows: list[np.ndarray] = []
        self._columns: list[np.ndarray] = []

    def add(self, source: int, target: int, block: np.ndarray, slope: np.ndarray) -> None:
        """Add information [12, 12] and gradient [12] in two poses."""
        self.gradient[source] += slope[:6]
        self.gradient[target] += slope[6:]
        unknowns = np.concatenate([6 * source + np.arange(6), 6 * target + np.arange(6)])
        self._blocks.append(block.ravel())
        self._rows.append(np.repeat(unknowns, 12))
        self._columns.append(np.tile(unknowns, 12))

    def information(self) -> sparse.csr_matrix:
        data = (np.concatenate(self._blocks), (np.concatenate(self._rows), np.concatenate(self._columns)))
        return sparse.csr_matrix(sparse.coo_matrix(data, shape=(self.gradient.size, self.gradient.size)))


def _add_links(
    system: _System, links: list[Link], terms: list[tuple[np.ndarray, np.ndarray, np.ndarray]], sigma: float
) -> None:
    """Add what links say, of Cauchy's loss."""
    for link, (residual, by_source, by_target) in zip(links, terms, strict=True):
        weight = cauchy_weights((residual**2).sum(axis=1), 2 * sigma) / sigma**2
        both = np.concatenate([by_source, by_target], axis=2).reshape(-1, 12)
        weighted = both * np.repeat(weight, 2)[:, None]
        system.add(link.source, link.target, weighted.T @ both, weighted.T @ residual.reshape(-1))


def _add_ties(system: _System, ties: Sequence[Tie], poses: np.ndarray) -> None:
    """Add what ties say, weighed against links by how much the errors of these are alike."""
    for tie in ties:
        source, target = poses[tie.source], poses[tie.target]
        expected = source @ tie.pose
        turn = Rotation.from_matrix(target[:3, :3] @ expected[:3, :3].T).as_rotvec()
        residual = np.concatenate([target[:3, 3] - expected[:3, 3], turn])
        arm = expected[:3, 3] - source[:3, 3]
        by_source = -np.eye(6)
        by_source[:3, 3:] = _cross(arm[None])[0]
        both = np.concatenate([by_source, np.eye(6)], axis=1)
        to_world = np.kron(np.eye(2), source[:3, :3])
        weighted = both.T @ (_CORRELATION * np.linalg.inv(to_world @ tie.covariance @ to_world.T))
        system.add(tie.source, tie.target, weighted @ both, weighted @ residual)


def _covariance(solver: SuperLU, unknowns: np.ndarray, pose: int) -> np.ndarray:
    """[6, 6] covariance of a pose; 0 where it is not free."""
    begin, end = np.searchsorted(unknowns, [6 * pose, 6 * pose + 6])
    unit = np.zeros((len(unknowns), end - begin))
    unit[np.arange(begin, end), np.arange(end - begin)] = 1
    own = unknowns[begin:end] - 6 * pose
    covariance = np.zeros((6, 6))
    if len(own):
        covariance[np.ix_(own, own)] = _CORRELATION * solver.solve(unit)[begin:end]
    return covariance


def _damping(free: np.ndarray, height: float) -> np.ndarray:
    return np.tile(_DAMPING * np.array([1 / height**2] * 3 + [1.0] * 3), len(free))


def _cross(vectors: np.ndarray) -> np.ndarray:
    """[N, 3, 3] with C v = vector x v."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)


def _sphere(count: int) -> np.ndarray:
    """[N, 3] unit vectors spread evenly (Fibonacci's spiral)."""
    index = np.arange(count) + 0.5
    z = 1 - 2 * index / count
    angle = np.pi * (1 + np.sqrt(5)) * index
    return np.column_stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z])
