"""Where the camera is when no board lies on the table: motion over the table's own texture, up to scale."""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from egophys_core.errors import EpisodeError
from egophys_core.perception.camera.dominant_plane import PlaneTracker
from egophys_core.perception.camera.plane_bundle import (
    Bundle,
    Link,
    adjust,
    camera_over_plane,
    plane_normals,
    pose_from_move,
)
from egophys_core.perception.camera.plane_links import plane_links, without_outliers

LARGEST_TILT_DEG = 1.0
"""Degrees, standard deviation: a table whose tilt is less certain than this is no base for gravity and heights."""
FEWEST_FRAMES = 5
LONGEST_SIZE_M = 100.0

_TRIAL_FRAMES = 40
_AMBIGUOUS = 1.1
_UNLIKE_DEG = 10.0
_ADVICE = "move the head sideways by a hand's breadth while looking at the table, or lay the board on the table"


@dataclass(frozen=True, kw_only=True)
class BackgroundPoses:
    """The camera over T frames in a world made of the dominant plane, taken for the table.

    The table is z = 0 and z points away from it towards the camera. The origin is where the first tied camera's
    optical axis meets the table (or the middle of what it sees of it, if the axis meets none); x points to the right
    in that camera's image.
    """

    world_from_camera: np.ndarray
    """[T, 4, 4] float64; NaN where lost. Lengths are metres only if the first camera is `height_m` over the table."""
    known: np.ndarray
    """[T] bool: tied to the table by its own image; nothing is interpolated."""
    scale_is_known: bool
    """Always False: images alone do not tell a near small scene from a far large one. All lengths, and with them
    velocities, masses over densities and stiffnesses, are wrong by one unknown common factor. Multiply positions by
    (true length) / (length here) of anything measured."""
    residual_px: float
    """Root mean square distance, pixels, of points on the table from where the poses have them."""
    tilt_sigma_deg: float
    """Standard deviation, degrees, of the table's normal, which is taken for gravity."""
    note: str
    """What was assumed, inferred and lost: sentences for the user."""


def background_poses(
    frames: Iterable[tuple[int, np.ndarray]],
    camera_matrix: np.ndarray,
    *,
    height_m: float = 0.6,
    progress: Callable[[int], None] | None = None,
) -> BackgroundPoses:
    """Find the camera's path from the texture of the table; no board is needed.

    Frames are tied to keyframes by homographies of the dominant plane; its normal follows from all of them, and poses
    and normal are then fitted together to the points seen. Frames are read one by one; of each about 4 kB are kept.

    Args:
        frames: (stamp in nanoseconds, [H, W, 3] uint8 BGR pinhole image) in order of time, all of one size.
        camera_matrix: [3, 3] K of the images, pixels.
        height_m: what the first tied camera's height over the table is taken for, metres.
        progress: called with the number of frames done.

    Raises:
        EpisodeError: no frames or of different sizes; too little texture; too little motion to tell how the table is
            tilted; says what to do.
    """
    if not 0 < height_m < LONGEST_SIZE_M:
        raise EpisodeError(f"height_m must be metres in 0 .. {LONGEST_SIZE_M:g}, got {height_m}; 0.6 is a seated head")
    tracker, count, shape = PlaneTracker(), 0, None
    for stamp, image in frames:
        if image.ndim != 3 or image.dtype != np.uint8 or (shape is not None and image.shape != shape):
            raise EpisodeError(
                f"frame {count} at {stamp} ns: images must be [H, W, 3] uint8, all of the size of the first, "
                f"got {image.shape} {image.dtype}, the first is {shape}; undistort all with one FullView"
            )
        shape = image.shape
        tracker.add(count, image)
        count += 1
        if progress is not None:
            progress(count)
    tied = np.array(sorted(tracker.from_first), int)
    if len(tied) < FEWEST_FRAMES:
        raise EpisodeError(
            f"only {len(tied)} of {count} frames can be tied to one table ({_why_lost(tracker) or 'no frames'}); at "
            f"least {FEWEST_FRAMES} are needed: use a table with texture (a patterned cloth), more light, or the board"
        )
    return _solve(tracker, tied, count, np.asarray(camera_matrix, dtype=np.float64), height_m)


def _solve(
    tracker: PlaneTracker, tied: np.ndarray, count: int, camera_matrix: np.ndarray, height_m: float
) -> BackgroundPoses:
    inverse = np.linalg.inv(camera_matrix)
    moves = np.stack([inverse @ tracker.from_first[frame] @ camera_matrix for frame in tied])
    links = plane_links(tracker, tied, inverse)
    rays = np.concatenate([link.rays for link in links if link.source == 0])[::10]
    focal = float(np.sqrt(camera_matrix[0, 0] * camera_matrix[1, 1]))
    trial = _trial(links, len(tied))
    starts = [
        np.stack([pose_from_move(move, camera_over_plane(up, height_m)) for move in moves])
        for up in plane_normals(moves[:: 1 + len(moves) // _TRIAL_FRAMES], rays)
    ]
    if not starts:
        raise EpisodeError(f"no tilt of the table explains how it moves through the image; {_ADVICE}")
    tries = sorted((adjust(start, 0, trial, focal) for start in starts), key=lambda each: each.cost)
    chosen, reservation = _choose(tries)
    start = np.stack([pose_from_move(move, chosen.poses[0]) for move in moves])
    bundle = adjust(start, 0, links, focal)
    links = without_outliers(links, bundle)
    bundle = adjust(bundle.poses, 0, links, focal)
    tilt = float(np.degrees(bundle.tilt_sigma))
    if not tilt < LARGEST_TILT_DEG:
        path = float(np.ptp(bundle.poses[:, :3, 3], axis=0).max() / height_m)
        raise EpisodeError(
            f"the tilt of the table is uncertain by {tilt:.1f} degrees, allowed is {LARGEST_TILT_DEG:g}: the head "
            f"moved by only about {100 * path:.1f} % of its height over the table in {len(tied)} frames; {_ADVICE}"
        )
    poses = np.full((count, 4, 4), np.nan)
    poses[tied] = _in_world(bundle.poses, links, height_m)
    known = np.isfinite(poses).all(axis=(1, 2))
    residual = float(np.sqrt(np.mean(np.concatenate(bundle.residuals) ** 2)))
    note = (
        "Without a board the scale is arbitrary: the first camera's height over the table was taken for "
        f"{height_m:g} m, and all lengths are wrong by the same factor if it was not. Gravity was taken along the "
        f"normal of the plane that fills most of the view (uncertain by {tilt:.2f} degrees), which is right if that is "
        f"a level table. {known.sum()} of {count} frames are tied to it, with {residual:.2f} pixels left."
    )
    lost = _why_lost(tracker)
    return BackgroundPoses(
        world_from_camera=poses,
        known=known,
        scale_is_known=False,
        residual_px=residual,
        tilt_sigma_deg=tilt,
        note=" ".join(filter(None, [note, reservation, f"Lost: {lost}." if lost else ""])),
    )


def _why_lost(tracker: PlaneTracker) -> str:
    return ", ".join(f"{count} frames: {reason}" for reason, count in Counter(tracker.lost.values()).most_common())


def _trial(links: list[Link], count: int) -> list[Link]:
    """Links of some frames and of all that are keyframes: enough to compare normals."""
    frames = set(np.linspace(0, count - 1, _TRIAL_FRAMES).astype(int)) | {link.source for link in links}
    return [link for link in links if link.target in frames]


def _choose(tries: list[Bundle]) -> tuple[Bundle, str]:
    """The normal that fits best; of two that fit alike and differ the one that is more upright in the image."""
    best = tries[0]
    for other in tries[1:]:
        ups = best.poses[0, 2, :3], other.poses[0, 2, :3]
        apart = np.degrees(np.arccos(np.clip(ups[0] @ ups[1], -1, 1)))
        if apart > _UNLIKE_DEG and other.cost < _AMBIGUOUS * best.cost:
            upright = min((best, other), key=lambda each: each.poses[0, 2, 1])
            return upright, (
                f"Two tilts of the table, {apart:.0f} degrees apart, fit alike, since the head moved along one line; "
                "the one more upright in the image was taken: move the head along a curve."
            )
    return best, ""


def _in_world(poses: np.ndarray, links: list[Link], height_m: float) -> np.ndarray:
    """Poses with the origin where the first camera looks and x to its right."""
    first = poses[0]
    rays = np.concatenate([link.rays for link in links if link.source == 0]) @ first[:3, :3].T
    looks = first[:3, 2] if first[2, 2] < -0.1 else np.median(rays, axis=0)
    turned = camera_over_plane(first[2, :3], height_m)
    to_world = turned[:3, :3] @ first[:3, :3].T
    world = np.broadcast_to(np.eye(4), poses.shape).copy()
    world[:, :3, :3] = to_world @ poses[:, :3, :3]
    origin = first[:3, 3] - looks * (first[2, 3] / looks[2])
    world[:, :3, 3] = (poses[:, :3, 3] - origin) @ to_world.T
    return world
