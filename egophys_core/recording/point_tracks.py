"""From point clouds of single frames to tracks over time: pairing, stacking by id, filling short gaps."""

import warnings
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from egophys_core.episode import EpisodeWarning
from egophys_core.interpolation import values_at
from egophys_core.recording.pointcloud import PointFrame
from egophys_core.recording.stamps import require_steady_stamps

LONGEST_FILLED_GAP_S = 0.5
"""A controller unseen for longer than this is dropped: half a second of a hand's motion cannot be guessed."""


def order_by_stamp(frames: Sequence[PointFrame], label: str) -> list[PointFrame]:
    """Sort frames by header stamp; of several with one stamp the last recorded stays. Warns of either.

    Raises:
        EpisodeError: the stamps are not of one clock that ran through.
    """
    stamps = [frame.stamp_ns for frame in frames]
    require_steady_stamps(stamps, label)
    backwards = sum(later < earlier for earlier, later in pairwise(stamps))
    if backwards:
        _warn(f"{label}: {backwards} of {len(frames)} messages are stamped before their predecessor; sorted by stamp")
    last_of_stamp = dict(zip(stamps, frames, strict=True))
    repeated = len(frames) - len(last_of_stamp)
    if repeated:
        _warn(f"{label}: {repeated} of {len(frames)} messages repeat a header stamp; the last of each is kept")
    return [last_of_stamp[stamp] for stamp in sorted(last_of_stamp)]


def pair_by_stamp(
    objects: Sequence[PointFrame], controllers: Sequence[PointFrame], label: str
) -> tuple[list[PointFrame], list[PointFrame]]:
    """Pair each object frame with the controller frame nearest in time, one to one.

    Two frames are a pair when each is the other's nearest and they are at most half an object frame apart
    (the median step between object frames). The others are dropped with a warning that counts them.

    Args:
        objects: in order of their stamps, which differ; at least one.
        controllers: the same.
        label: the episode's name.

    Returns:
        The paired object frames and controller frames, of equal length, in order.
    """
    object_stamps = np.array([frame.stamp_ns for frame in objects], np.int64)
    controller_stamps = np.array([frame.stamp_ns for frame in controllers], np.int64)
    steps = np.diff(object_stamps)
    tolerance_ns = float(np.median(steps)) / 2 if steps.size else 0.0
    to_controller = _nearest(object_stamps, controller_stamps)
    to_object = _nearest(controller_stamps, object_stamps)
    is_mutual = to_object[to_controller] == np.arange(len(objects))
    is_close = np.abs(controller_stamps[to_controller] - object_stamps) <= tolerance_ns
    paired = np.flatnonzero(is_mutual & is_close)
    lost_objects, lost_controllers = len(objects) - len(paired), len(controllers) - len(paired)
    if lost_objects or lost_controllers:
        _warn(
            f"{label}: dropped {lost_objects} of {len(objects)} object and {lost_controllers} of "
            f"{len(controllers)} controller messages that have no partner within "
            f"{tolerance_ns * 1e-6:.1f} ms of header stamp"
        )
    return [objects[i] for i in paired], [controllers[to_controller[i]] for i in paired]


def stack_by_id(frames: Sequence[PointFrame], label: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Put the points of T frames into one table by id.

    A point with a coordinate that is not finite, or with confidence 0 or NaN, counts as not seen. Of an id
    that stands twice in a message the last is kept. Confidence is clipped to 0..1.

    Args:
        frames: one per time step.
        label: the episode's name and topic.

    Returns:
        ids [N] uint32 increasing, of points seen at least once; positions [T, N, 3] float32, NaN where not
        seen; confidence [T, N] float32, 0 where not seen.
    """
    finite = [np.isfinite(frame.xyz).all(axis=1) for frame in frames]
    seen = [mask & (frame.confidence > 0) for mask, frame in zip(finite, frames, strict=True)]
    broken = sum(int(np.count_nonzero(~mask)) for mask in finite)
    if broken:
        _warn(f"{label}: {broken} points with NaN or infinite coordinates count as not seen")
    ids = np.unique(np.concatenate([f.ids[mask] for f, mask in zip(frames, seen, strict=True)], dtype=np.uint32))
    positions = np.full((len(frames), len(ids), 3), np.nan, np.float32)
    confidence = np.zeros((len(frames), len(ids)), np.float32)
    repeated = 0
    for index, (frame, mask) in enumerate(zip(frames, seen, strict=True)):
        # np.unique finds the first of each id; of the reversed message that is the last.
        frame_ids, last = np.unique(frame.ids[mask][::-1], return_index=True)
        repeated += int(np.count_nonzero(mask)) - len(frame_ids)
        columns = np.searchsorted(ids, frame_ids)
        positions[index, columns] = frame.xyz[mask][::-1][last]
        confidence[index, columns] = np.clip(frame.confidence[mask][::-1][last], 0, 1)
    if repeated:
        _warn(f"{label}: {repeated} points repeat the id of another in the same message; the last is kept")
    return ids, positions, confidence


def fill_short_gaps(
    times: np.ndarray, ids: np.ndarray, positions: np.ndarray, label: str
) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate tracks linearly over frames where they are missing; drop those missing too long.

    A gap lasts from the frame before it to the frame after it, at the ends of the recording to its first or
    last frame. Gaps of up to `LONGEST_FILLED_GAP_S` are filled, at the ends with the nearest seen position; a
    track with a longer one is dropped with a warning.

    Args:
        times: [T] seconds.
        ids: [C], each seen at least once.
        positions: [T, C, 3] metres, NaN where not seen.
        label: the episode's name and topic.

    Returns:
        ids [K] and positions [T, K, 3] of the K tracks kept, finite everywhere.
    """
    filled = positions.copy()
    kept = []
    for column, track_id in enumerate(ids):
        seen = np.flatnonzero(np.isfinite(positions[:, column]).all(axis=1))
        gap = _longest_gap(times, seen)
        if gap > LONGEST_FILLED_GAP_S:
            _warn(
                f"{label}: controller {track_id} is not seen for {gap:.2f} s (longest filled: "
                f"{LONGEST_FILLED_GAP_S} s); dropped"
            )
            continue
        kept.append(column)
        missing = np.setdiff1d(np.arange(len(times)), seen)
        filled[missing, column] = values_at(times[seen], positions[seen, column], times[missing])
    return ids[kept], filled[:, kept]


def _longest_gap(times: np.ndarray, seen: np.ndarray) -> float:
    """Longest time unseen, seconds; 0 when no frame is missing, however far apart frames are."""
    ends = np.array([times[seen[0]] - times[0], times[-1] - times[seen[-1]]])
    inner = np.diff(times[seen])[np.diff(seen) > 1]
    return float(max(ends.max(), inner.max(initial=0.0)))


def _nearest(stamps: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Index into the increasing `others` of the one nearest to each of `stamps`; the earlier of two."""
    if len(others) == 1:
        return np.zeros(len(stamps), np.intp)
    after = np.clip(np.searchsorted(others, stamps), 1, len(others) - 1)
    return np.where(stamps - others[after - 1] <= others[after] - stamps, after - 1, after)


def _warn(message: str) -> None:
    warnings.warn(EpisodeWarning(message), stacklevel=3)
