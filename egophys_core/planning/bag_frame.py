"""One frame of a bag, by index or time: `towel.mcap@70`, `towel.mcap@2.3s`."""

import os
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from egophys_core.episode import WORLD_FRAME
from egophys_core.errors import PlanningError
from egophys_core.recording import PointFrame, decode_points, read_records

BAG_SUFFIXES = (".mcap", ".db3")


def is_bag(path: Path) -> bool:
    """Whether a path is that of a bag, by its name or because it is a folder."""
    return path.suffix.lower() in BAG_SUFFIXES or os.path.isdir(path)


def path_and_frame(source: str) -> tuple[Path, str]:
    """The path and what stands after @, empty for nothing; a path with an @ in its name is not cut if it is there.

    Raises:
        PlanningError: what stands after @ is neither an index nor a time.
    """
    path, at, frame = source.rpartition("@")
    if not at or os.path.exists(source):
        return Path(source), ""
    if not re.fullmatch(r"\d+(\.\d*)?s|\d+", frame):
        raise PlanningError(f"{source}: after @ stands a frame (@70) or a time in seconds (@2.3s), not {frame!r}")
    return Path(path), frame


def object_messages(path: Path, topic: str) -> list[PointFrame]:
    """The messages of the object's points in a bag, at least one, by stamp.

    Raises:
        RecordingError: not a bag, or the topic is not in it.
        PlanningError: the topic has no message, or is in another frame.
    """
    messages = [decode_points(each.cdr, source=f"{path} {topic}") for each in read_records(path, (topic,))]
    if not messages:
        raise PlanningError(f"{path} has no message on {topic}; make points of its video with `egophys perceive`")
    other = next((each.frame_id for each in messages if each.frame_id != WORLD_FRAME), None)
    if other is not None:
        raise PlanningError(f"{path}: the points are in frame {other!r}, needed is {WORLD_FRAME!r}")
    return sorted(messages, key=lambda each: each.stamp_ns)


def frame_index(frame: str, messages: Sequence[PointFrame], path: Path) -> int:
    """Which message a frame means, the last if it is empty.

    Raises:
        PlanningError: it is not in the bag.
    """
    times = np.array([each.stamp_ns - messages[0].stamp_ns for each in messages]) * 1e-9
    if frame.endswith("s"):
        wanted = float(frame[:-1])
        if wanted > times[-1]:
            raise PlanningError(f"{path} shows 0 .. {times[-1]:.2f} s, not {wanted:g} s")
        return int(np.argmin(np.abs(times - wanted)))
    index = int(frame) if frame else len(messages) - 1
    if index >= len(messages):
        raise PlanningError(f"{path} has frames 0 .. {len(messages) - 1}, not {index}")
    return index


def seen_points(message: PointFrame) -> tuple[np.ndarray, np.ndarray]:
    """Ids [P], increasing, and positions [P, 3] metres of the points that are seen in a message."""
    good = np.isfinite(message.xyz).all(axis=1) & (message.confidence > 0)
    ids, first = np.unique(message.ids[good], return_index=True)
    return ids, message.xyz[good][first]
