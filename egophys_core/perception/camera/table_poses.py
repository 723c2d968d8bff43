"""Where the camera is while the board is not seen, from the texture of the table, and how the board lies on that."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.perception.camera.board import Board
from egophys_core.perception.camera.board_pose import LARGEST_UNCERTAINTY, CameraPose
from egophys_core.perception.camera.dominant_plane import PlaneTracker
from egophys_core.perception.camera.plane_bundle import Bundle, Link, Tie, adjust, pose_from_move
from egophys_core.perception.camera.plane_links import plane_links, without_outliers

FEWEST_FRAMES = 2
FEWEST_POINTS = 60
"""Points on the table that a frame needs; usual are 200."""
TILT_TOLERANCE_DEG = 1.0
"""Degrees: a board that lies on a table at a larger angle lies on something else."""
HEIGHT_TOLERANCE_M = 0.004
"""Metres: a board on cardboard is not yet worth a word."""
HIGHEST_M = 0.1
"""Metres: no board lies on books higher than this; what is farther below it is the floor."""
STEEPEST_DEG = 25.0
"""Degrees: nor so steep."""

_CERTAIN = 5.0
"""Standard deviations from which on a tilt or a height is not a matter of chance."""


@dataclass(frozen=True, kw_only=True)
class TablePoses:
    """Cameras over the table, in a world whose z = 0 is the table; the board is where it is, seen from above."""

    world_from_camera: dict[int, np.ndarray]
    """[4, 4] metres, by number of those frames that are tied to the table."""
    world_from_said: np.ndarray
    """[4, 4]: from the world of the poses that the board gives, as if it lay on the table; the identity if it does."""
    board: Board
    """Where the board lies in that world: raised if it is certainly not on the table."""
    tilt_deg: float
    """Degrees between table and board; 0 if not certainly more than `TILT_TOLERANCE_DEG`."""
    height_m: float
    """Metres by which the middle of the board is higher than it would be on the table; 0 if not certain."""
    tilt_sigma_deg: float
    """Degrees: standard deviation of the angle between table and board."""
    height_sigma_m: float
    """Metres: standard deviation of the height of the board."""

    @property
    def note(self) -> str | None:
        """For the user: that the board does not lie on the table, if so."""
        said = []
        if self.tilt_deg:
            said.append(f"it is tilted by {self.tilt_deg:.1f} +- {self.tilt_sigma_deg:.1f} degrees against it")
        if self.height_m:
            said.append(f"its middle is {1e3 * self.height_m:.0f} +- {1e3 * self.height_sigma_m:.1f} mm too high")
        if not said:
            return None
        return (
            f"the board does not lie on the table: {', '.join(said)}; z = 0 and gravity were taken from the "
            "table's texture: lay the board flat on the table"
        )


def poses_over_table(
    frames: Iterable[tuple[int, np.ndarray]],
    located: Mapping[int, CameraPose],
    board: Board,
    camera_matrix: np.ndarray,
) -> TablePoses | None:
    """Locate frames on the table in which the board is not seen, by others in which it is; None if it cannot be done.

    Frames are tied to each other by homographies of the table (as for `background_poses`), and to the board by the
    poses it gives; all are fitted together. That the board lies on the table is taken for granted unless the fit says
    otherwise with certainty: then the table is z = 0 and gravity its normal. A plane above the board, far below it or
    steep is no table (a pillow's top, the floor, a wall) and says nothing.

    Args:
        frames: (number, [H, W, 3] uint8 BGR pinhole image) in order of the numbers.
        located: poses from the board by number, of one frame at least.
        board: what lies on the table.
        camera_matrix: [3, 3] K, pixels.
    """
    tracker = _track(frames, located, camera_matrix)
    tied = np.array(sorted(tracker.from_first), int)
    anchors = np.array([index for index, number in enumerate(tied) if number in located], int)
    if len(tied) < FEWEST_FRAMES or not len(anchors):
        return None
    links = plane_links(tracker, tied, np.linalg.inv(camera_matrix))
    if np.median(_points_seen(links, len(tied))) < FEWEST_POINTS:
        return None
    middle = _middle_of_board(board)
    ties = [_tie(index, len(tied), located[tied[index]], middle) for index in anchors]
    start = np.concatenate([_start(tracker, tied, anchors, located, camera_matrix), middle[None]])
    focal = float(np.sqrt(camera_matrix[0, 0] * camera_matrix[1, 1]))
    links, loose = _fit_loose(start, links, ties, focal)
    points = _points_seen(links, len(tied))
    tilt, height = _lie_of_board(loose, middle)
    tilt_sigma, height_sigma = loose.tilt_sigma, float(np.sqrt(loose.covariances[-1, 2, 2]))
    is_tilted = tilt > max(np.radians(TILT_TOLERANCE_DEG), _CERTAIN * tilt_sigma)
    is_elsewhere = abs(height) > max(HEIGHT_TOLERANCE_M, _CERTAIN * height_sigma)
    is_table = not (is_elsewhere and not 0 < height < HIGHEST_M) and not (is_tilted and tilt > np.radians(STEEPEST_DEG))
    if not is_table or _disagreement(loose, ties) > LARGEST_UNCERTAINTY:
        return None
    free = _free(tilt=is_tilted, height=is_elsewhere)
    fit = adjust(start, len(tied), links, focal, first_free=free, ties=ties, all_covariances=True)
    tilt, height = _lie_of_board(fit, middle)
    x, y, z = board.origin
    deviations = np.sqrt(np.trace(fit.covariances[:-1, :3, :3], axis1=1, axis2=2))
    certain = (points >= FEWEST_POINTS) & (deviations <= LARGEST_UNCERTAINTY)
    return TablePoses(
        world_from_camera={int(tied[index]): fit.poses[index] for index in np.flatnonzero(certain)},
        world_from_said=fit.poses[-1] @ np.linalg.inv(middle),
        board=replace(board, origin=(x, y, z + height)),
        tilt_deg=float(np.degrees(tilt)) if is_tilted else 0.0,
        height_m=height if is_elsewhere else 0.0,
        tilt_sigma_deg=float(np.degrees(tilt_sigma)),
        height_sigma_m=height_sigma,
    )


def _track(
    frames: Iterable[tuple[int, np.ndarray]], located: Mapping[int, CameraPose], camera_matrix: np.ndarray
) -> PlaneTracker:
    """Follow the table; where both ends are located on the board it is looked for where that lies."""
    tracker = PlaneTracker()
    last: int | None = None
    for number, image in frames:
        expected = None
        if number in located and last is not None and last in tracker.from_first:
            here, there = (_from_table(located[each], camera_matrix) for each in (number, last))
            expected = here @ np.linalg.inv(there) @ tracker.from_first[last]
        if tracker.add(number, image, expected) and number in located:
            last = number
    return tracker


def _from_table(pose: CameraPose, camera_matrix: np.ndarray) -> np.ndarray:
    """[3, 3] homography: pixels from places x, y, 1 on z = 0, metres."""
    return camera_matrix @ np.linalg.inv(pose.world_from_camera)[:3, [0, 1, 3]]


def _points_seen(links: list[Link], count: int) -> np.ndarray:
    """[K] int: points of the table by which each of K frames is tied."""
    points = np.zeros(count, int)
    for link in links:
        np.maximum.at(points, [link.source, link.target], len(link.points))
    return points


def _middle_of_board(board: Board) -> np.ndarray:
    """[4, 4] world from a frame along its axes, in the middle of the board, on the table."""
    pose = np.eye(4)
    pose[:2, 3] = board.origin[0] + board.size[0] / 2, board.origin[1] - board.size[1] / 2
    return pose


def _tie(index: int, middle_index: int, pose: CameraPose, middle: np.ndarray) -> Tie:
    return Tie(
        source=middle_index,
        target=index,
        pose=np.linalg.inv(middle) @ pose.world_from_camera,
        covariance=pose.covariance,
    )


def _start(
    tracker: PlaneTracker,
    tied: np.ndarray,
    anchors: np.ndarray,
    located: Mapping[int, CameraPose],
    camera_matrix: np.ndarray,
) -> np.ndarray:
    """[K, 4, 4] poses from the board, and from the homography from the nearest of these frames elsewhere."""
    inverse = np.linalg.inv(camera_matrix)
    poses = []
    for index, number in enumerate(tied):
        nearest = tied[anchors[np.abs(anchors - index).argmin()]]
        pose = located[nearest].world_from_camera
        if nearest != number:
            move = tracker.from_first[number] @ np.linalg.inv(tracker.from_first[nearest])
            pose = pose_from_move(inverse @ move @ camera_matrix, pose)
        poses.append(pose)
    return np.array(poses)


def _fit_loose(start: np.ndarray, links: list[Link], ties: list[Tie], focal: float) -> tuple[list[Link], Bundle]:
    """The fit in which the board lies as it may, and the links without what is off the table."""
    free = _free(tilt=True, height=True)
    board = len(start) - 1
    links = without_outliers(links, adjust(start, board, links, focal, first_free=free, ties=ties))
    return links, adjust(start, board, links, focal, first_free=free, ties=ties)


def _disagreement(fit: Bundle, ties: list[Tie]) -> float:
    """Metres between cameras as the plane and as the board have them, half of those that see both."""
    apart = [fit.poses[tie.target][:3, 3] - (fit.poses[tie.source] @ tie.pose)[:3, 3] for tie in ties]
    return float(np.median(np.linalg.norm(apart, axis=1)))


def _free(*, tilt: bool, height: bool) -> tuple[bool, ...]:
    """Which of place and turn of the board are free."""
    return (False, False, height, tilt, tilt, False)


def _lie_of_board(fit: Bundle, middle: np.ndarray) -> tuple[float, float]:
    """Radians by which the board is tilted against the table, and metres by which it is too high."""
    lies = fit.poses[-1]
    return float(np.arccos(np.clip(lies[2, 2], -1, 1))), float(lies[2, 3] - middle[2, 3])
