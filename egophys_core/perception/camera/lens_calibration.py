"""A camera's lens from views of the tag board: OpenCV's calibration, tried on views that it has not seen."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from egophys_core.errors import EpisodeError
from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.lens import Camera, DistortionModel
from egophys_core.perception.camera.tag_edges import SeenTags, edge_shares, meeting_corners

FEWEST_VIEWS = 6
FEWEST_TAGS = 6
"""Tags that a view needs to be used."""
MOST_VIEWS = 30
"""Views that are fitted: more of them tell little and take long."""
FOLDS = 6
BETTER = 0.97
"""A lens with more parameters is preferred if its error on views left out is smaller than this share."""

_ROUGH = 2.0
"""Views whose edges are rougher than this many times the median are blurred and left out."""
_OUTLIER = 3.0
"""Views whose error is more than this many times the median are left out, as where the board was bent or moved."""
_SQUARE = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
"""Corners of a tag, clockwise from the upper left."""
_ITERATIONS = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-7)


@dataclass(frozen=True, kw_only=True)
class LensCalibration:
    """A camera, and how well it is known."""

    camera: Camera
    """What was found."""
    views: tuple[SeenTags, ...]
    """Those it was fitted to."""
    camera_from_board: np.ndarray
    """[V, 4, 4] metres: where the board was in each of them."""
    held_out_px: float
    """Pixels, root mean square: where tags of views that were left out of a fit lie beside where it has them."""
    focal_deviation: float
    """Standard deviation of the focal length, share of it: by how much fits without one view or another differ."""
    tried: dict[str, float]
    """`held_out_px` of each lens model that was tried."""


def choose_views(
    seen: Sequence[SeenTags], size: tuple[int, int], board: Board, most: int = MOST_VIEWS
) -> list[SeenTags]:
    """Sharp views that differ the most in where the board is in the image, how large and how tilted.

    Args:
        seen: of a video; those with too few tags are left out.
        size: width and height of the images, pixels.
        board: what is seen.
        most: views to choose.

    Returns:
        In order of time.
    """
    enough = [each for each in seen if len(each.tags) >= FEWEST_TAGS and _is_spread(each, board)]
    if not enough:
        return []
    usual = float(np.median([each.roughness for each in enough]))
    sharp = [each for each in enough if each.roughness <= max(_ROUGH * usual, 0.1)]
    outlines = np.array([_outline(each, board).ravel() for each in sharp]) / np.hypot(*size)
    chosen = [int(np.argmax([len(each.tags) for each in sharp]))]
    apart = np.linalg.norm(outlines - outlines[chosen[0]], axis=1)
    while len(chosen) < min(most, len(sharp)):
        chosen.append(int(np.argmax(apart)))
        apart = np.minimum(apart, np.linalg.norm(outlines - outlines[chosen[-1]], axis=1))
    return [sharp[index] for index in sorted(chosen)]


def calibrate(
    views: Sequence[SeenTags], size: tuple[int, int], board: Board, model: DistortionModel | None = None
) -> LensCalibration:
    """Fit a lens to views.

    Args:
        views: chosen ones (`choose_views`).
        size: width and height of the images, pixels.
        board: what is seen.
        model: the lens's; None for the simplest that predicts views left out of the fit about as well as any.

    Raises:
        EpisodeError: too few views, or no lens fits them.
    """
    if len(views) < FEWEST_VIEWS:
        raise EpisodeError(
            f"the board is seen sharply in {len(views)} different views, needed are {FEWEST_VIEWS}, better 20; film it "
            f"larger, in good light, and move slowly (a view counts with {FEWEST_TAGS} tags)"
        )
    lenses = [each for each in _LENSES if (model is None and each.is_tried) or each.model == model]
    tried: dict[str, tuple[_Lens, _FitTrial]] = {}
    best: tuple[_Lens, _FitTrial] | None = None
    for lens in lenses:
        try:
            trial = _try(lens, views, size, board)
        except cv2.error:
            continue  # OpenCV's fisheye gives up on views of an ordinary lens
        if not np.isfinite(trial.held_out_px):
            continue
        tried[lens.name] = (lens, trial)
        if best is None or trial.held_out_px < BETTER * best[1].held_out_px:
            best = (lens, trial)
    if best is None:
        raise EpisodeError(
            f"no lens fits the {len(views)} views of the board; check its layout (--board-columns and so on), lay it "
            "flat, and film it again from other directions"
        )
    lens, trial = best
    bent, camera, poses = _fit(lens, trial.views, size, board)
    return LensCalibration(
        camera=camera,
        views=tuple(bent),
        camera_from_board=poses,
        held_out_px=trial.held_out_px,
        focal_deviation=trial.focal_deviation,
        tried={name: each.held_out_px for name, (_, each) in tried.items()},
    )


@dataclass(frozen=True, kw_only=True)
class _Lens:
    name: str
    model: DistortionModel
    is_tried: bool
    """Where the user has not chosen."""
    flags: int = 0
    coefficients: int = 5


_LENSES = (
    _Lens(
        name="plumb_bob without k3",
        model=DistortionModel.PLUMB_BOB,
        is_tried=True,
        flags=cv2.CALIB_FIX_K3,
    ),
    _Lens(name="plumb_bob", model=DistortionModel.PLUMB_BOB, is_tried=True),
    _Lens(name="equidistant", model=DistortionModel.EQUIDISTANT, is_tried=True, coefficients=4),
    _Lens(
        name="rational_polynomial",
        model=DistortionModel.RATIONAL_POLYNOMIAL,
        is_tried=False,
        flags=cv2.CALIB_RATIONAL_MODEL,
        coefficients=8,
    ),
)
"""From the simplest on."""


@dataclass(frozen=True, kw_only=True)
class _FitTrial:
    views: list[SeenTags]
    held_out_px: float
    focal_deviation: float


def _try(lens: _Lens, views: Sequence[SeenTags], size: tuple[int, int], board: Board) -> _FitTrial:
    """Fit without one sixth of the views after the other, and predict those."""
    bent, camera, poses = _fit(lens, views, size, board)
    errors = np.array([_error(camera, view, pose, board) for view, pose in zip(bent, poses, strict=True)])
    near = errors <= max(_OUTLIER * float(np.median(errors)), 0.2)
    if np.count_nonzero(near) >= FEWEST_VIEWS:
        views = [view for view, is_near in zip(views, near, strict=True) if is_near]
    folds = min(FOLDS, len(views))
    focals, squares = [], []
    for fold in range(folds):
        fitted = _fit(lens, [view for index, view in enumerate(views) if index % folds != fold], size, board, camera)[1]
        focals.append(np.sqrt(fitted.matrix[0, 0] * fitted.matrix[1, 1]))
        squares += [_error_of_unseen(fitted, view, board) ** 2 for view in views[fold::folds]]
    # Delete-a-group jackknife.
    deviation = float(np.sqrt((folds - 1) / folds * np.sum((np.array(focals) - np.mean(focals)) ** 2)))
    return _FitTrial(
        views=list(views),
        held_out_px=float(np.sqrt(np.mean(squares))),
        focal_deviation=deviation / float(np.mean(focals)),
    )


def _fit(
    lens: _Lens, views: Sequence[SeenTags], size: tuple[int, int], board: Board, start: Camera | None = None
) -> tuple[list[SeenTags], Camera, np.ndarray]:
    """Views whose corners are right for the lens, the camera, and the boards' places [V, 4, 4] in its frame."""
    camera, poses = _fit_once(lens, views, size, board, start)
    bent = [_with_bent_edges(view, camera, pose, board) for view, pose in zip(views, poses, strict=True)]
    return bent, *_fit_once(lens, bent, size, board, camera)


def _with_bent_edges(view: SeenTags, camera: Camera, camera_from_board: np.ndarray, board: Board) -> SeenTags:
    """The view with corners as they are where edges, which a lens bends, were not taken for straight."""
    corners = board.tag_corners[view.tags][:, None] + _SQUARE * board.tag_side
    shares = edge_shares()[:, None]
    edges = [corners[:, [side]] * (1 - shares) + corners[:, [(side + 1) % 4]] * shares for side in range(4)]
    flat = np.concatenate([np.stack(edges, axis=1).reshape(-1, 2), corners.reshape(-1, 2)])
    places = np.column_stack([flat, np.zeros(len(flat))]) @ camera_from_board[:3, :3].T + camera_from_board[:3, 3]
    pixels = camera.project(places)
    count = len(view.tags)
    of_edges, of_corners = pixels[: -4 * count].reshape(count, 4, -1, 2), pixels[-4 * count :].reshape(count, 4, 2)
    met = np.array([meeting_corners(each) for each in of_edges])
    return replace(view, corners=view.corners + of_corners - met)


def _fit_once(
    lens: _Lens, views: Sequence[SeenTags], size: tuple[int, int], board: Board, start: Camera | None
) -> tuple[Camera, np.ndarray]:
    objects = [_on_board(view, board).astype(np.float32) for view in views]
    images = [view.corners.reshape(-1, 2).astype(np.float32) for view in views]
    first = cv2.initCameraMatrix2D(objects, images, size) if start is None else start.matrix
    bends = np.zeros(lens.coefficients) if start is None else start.coefficients
    if lens.model == DistortionModel.EQUIDISTANT:
        matrix, coefficients, rotations, places = _fisheye(objects, images, size, first, bends)
    else:
        _, matrix, found, rotations, places = cv2.calibrateCamera(
            objects,
            images,
            size,
            first.copy(),
            bends.copy(),
            flags=lens.flags | cv2.CALIB_USE_INTRINSIC_GUESS,
            criteria=_ITERATIONS,
        )
        coefficients = np.asarray(found).ravel()[: lens.coefficients]
    poses = np.tile(np.eye(4), (len(views), 1, 1))
    for pose, rotation, place in zip(poses, rotations, places, strict=True):
        pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(rotation)[0], np.ravel(place)
    if not (np.isfinite(matrix).all() and np.isfinite(coefficients).all() and matrix[0, 0] > 0 and matrix[1, 1] > 0):
        raise cv2.error("the fit diverged")
    camera = Camera(width=size[0], height=size[1], matrix=matrix, model=lens.model, coefficients=coefficients)
    return camera, poses


def _fisheye(
    objects: list[np.ndarray], images: list[np.ndarray], size: tuple[int, int], first: np.ndarray, bends: np.ndarray
) -> tuple[np.ndarray, np.ndarray, Sequence[np.ndarray], Sequence[np.ndarray]]:
    flags = cv2.fisheye.CALIB_RECOMPUTE_EXTRINSIC | cv2.fisheye.CALIB_FIX_SKEW | cv2.fisheye.CALIB_USE_INTRINSIC_GUESS
    _, matrix, coefficients, rotations, places = cv2.fisheye.calibrate(
        [each[None].astype(np.float64) for each in objects],
        [each[None].astype(np.float64) for each in images],
        size,
        first.astype(np.float64).copy(),
        bends.reshape(4, 1).copy(),
        flags=flags,
        criteria=_ITERATIONS,
    )
    return matrix, np.ravel(coefficients), rotations, places


def _pose(camera: Camera, view: SeenTags, board: Board) -> np.ndarray | None:
    """[4, 4] camera from board, by the tags of a view."""
    pixels = view.corners.reshape(-1, 1, 2)
    if camera.model == DistortionModel.EQUIDISTANT:
        rays = cv2.fisheye.undistortPoints(pixels, camera.matrix, camera.coefficients)
    else:
        rays = cv2.undistortPoints(pixels, camera.matrix, camera.coefficients)
    places = _on_board(view, board)
    found, rotation, place = cv2.solvePnP(places, rays, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    if not found or not np.isfinite(rays).all():
        return None
    rotation, place = cv2.solvePnPRefineLM(places, rays, np.eye(3), None, rotation, place)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(rotation)[0], place[:, 0]
    return pose


def _error_of_unseen(camera: Camera, view: SeenTags, board: Board) -> float:
    """`_error` of a view that the camera was not fitted to: only the board's place is."""
    pose = _pose(camera, view, board)
    if pose is None:
        return float("inf")
    bent = _with_bent_edges(view, camera, pose, board)
    pose = _pose(camera, bent, board)
    return float("inf") if pose is None else _error(camera, bent, pose, board)


def _error(camera: Camera, view: SeenTags, camera_from_board: np.ndarray, board: Board) -> float:
    """Pixels, root mean square, of the corners of a view beside where the camera has them."""
    seen = _on_board(view, board) @ camera_from_board[:3, :3].T + camera_from_board[:3, 3]
    if (seen[:, 2] <= 0).any():
        return float("inf")
    off = camera.project(seen) - view.corners.reshape(-1, 2)
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


def _on_board(view: SeenTags, board: Board) -> np.ndarray:
    """[4 K, 3] metres, board coordinates, of the corners of a view."""
    flat = (board.tag_corners[view.tags][:, None] + _SQUARE * board.tag_side).reshape(-1, 2)
    return np.column_stack([flat, np.zeros(len(flat))])


def _outline(view: SeenTags, board: Board) -> np.ndarray:
    """[4, 2] pixels: about where the corners of the whole board are, in view or not."""
    places = _on_board(view, board)[:, :2]
    homography, _ = cv2.findHomography(places, view.corners.reshape(-1, 2))
    width, height = board.size
    ends = np.array([[(0, 0), (width, 0), (width, height), (0, height)]], float)
    return np.asarray(cv2.perspectiveTransform(ends, homography)[0])


def _is_spread(view: SeenTags, board: Board) -> bool:
    """Whether the tags lie in two rows and two columns."""
    return len(set(view.tags // board.columns)) > 1 and len(set(view.tags % board.columns)) > 1
