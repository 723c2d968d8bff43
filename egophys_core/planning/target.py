"""Targets as text: one grammar for the command line, the action and the service.

    SHAPE [translate=X,Y,Z] [rotate=R,P,Y]

SHAPE is `present` (the object where it is), a point cloud (.npy, .ply, .pcd, .xyz, .csv), a frame of a bag
(`towel.mcap@2.3s`, `towel.mcap@70`, by default the last) or another twin's shape (`other.twin`). It is turned about
its centre by roll, pitch and yaw in degrees about the axes of `world`, then shifted by metres.
"""

import os
import re
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.episode import WORLD_FRAME
from egophys_core.errors import PlanningError
from egophys_core.planning.bag_frame import (
    BAG_SUFFIXES,
    frame_index,
    is_bag,
    object_messages,
    path_and_frame,
    seen_points,
)
from egophys_core.planning.cloud_file import READERS, read_cloud
from egophys_core.recording import OBJECT_TOPIC
from egophys_core.twin import load_twin

PRESENT = "present"
TWIN_SUFFIX = ".twin"
FARTHEST_M = 3.0
"""Metres: a target as large, or as far from the object, is in another unit or another place."""
MOST_POINTS = 20_000
"""Of a denser cloud every n-th point is taken: each rollout is compared with all of them."""
EDIT = re.compile(r"(?P<source>.*?)\s+(?P<name>[a-z_]+)=(?P<values>\S*)")


@dataclass(frozen=True, kw_only=True)
class TargetText:
    """A target taken apart."""

    source: str
    """`present` or a path, with its frame if any."""
    translate: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Metres."""
    rotate: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw about the shape's centre, degrees."""


def parse_target(text: str) -> TargetText:
    """Take a text apart; what it names is not looked at.

    Raises:
        PlanningError: empty, an unknown edit, one that is not three finite numbers, or the present shape unedited.
    """
    source = text.strip()
    edits: dict[str, tuple[float, float, float]] = {}
    while match := EDIT.fullmatch(source):
        source, name = match["source"].strip(), match["name"]
        if name not in ("translate", "rotate"):
            raise PlanningError(f"target {text!r}: unknown edit {name}=; there are translate=X,Y,Z and rotate=R,P,Y")
        if name in edits:
            raise PlanningError(f"target {text!r}: {name}= stands there twice; give it once")
        edits[name] = _three(match["values"], f"target {text!r}: {name}=")
    if not source or re.match(r"(translate|rotate)=", source):
        raise PlanningError(f"target {text!r} names no shape; give `present`, a point cloud, a bag or a twin first")
    wanted = TargetText(source=source, **edits)
    if wanted == TargetText(source=PRESENT):
        raise PlanningError("the present shape is no target as it is; add translate=X,Y,Z or rotate=R,P,Y")
    return wanted


def target_points(target: TargetText, present: np.ndarray, *, object_topic: str = OBJECT_TOPIC) -> np.ndarray:
    """[P, 3] float32 metres, world: the shape that a target means.

    Args:
        target: from `parse_target`.
        present: [S, 3] metres, the object's surface where it is now.
        object_topic: of the object's points in bags.

    Raises:
        PlanningError: absent, unreadable, empty, not finite, or too large or too far to be this object in metres.
        RecordingError, TwinError: the bag or twin cannot be read.
    """
    points = present if target.source == PRESENT else _read(target.source, object_topic)
    name = f"target {target.source}"
    check_shape(points, present, name)
    points = points[:: -(-len(points) // MOST_POINTS)].astype(np.float64)
    if any(target.rotate):
        centre = points.mean(axis=0)
        points = Rotation.from_euler("xyz", target.rotate, degrees=True).apply(points - centre) + centre
    moved = points + np.array(target.translate)
    check_shape(moved, present, name)
    return moved.astype(np.float32)


def check_shape(points: np.ndarray, present: np.ndarray, name: str) -> None:
    """Check that points [P, 3] can be a shape of the object that is at [S, 3], both metres.

    Raises:
        PlanningError: there are none, they are not finite, or they are metres across or metres away.
    """
    if len(points) == 0:
        raise PlanningError(f"{name} has no points")
    broken = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(broken):
        raise PlanningError(
            f"{name}: {len(broken)} of {len(points)} points are not finite, point {broken[0]} the first; leave them out"
        )
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    apart = float(np.linalg.norm(points.mean(axis=0) - present.mean(axis=0)))
    for value, what in ((extent, "across"), (apart, "from the object")):
        if value > FARTHEST_M:
            raise PlanningError(
                f"{name} is {value:.3g} m {what}, more than {FARTHEST_M:g} m; points must be in metres, in frame "
                f"{WORLD_FRAME}: divide millimetres by 1000, or transform them"
            )


def _read(source: str, object_topic: str) -> np.ndarray:
    path, frame = path_and_frame(source)
    suffix = path.suffix.lower()
    if frame and (suffix in READERS or suffix == TWIN_SUFFIX):
        raise PlanningError(f"target {source}: only a bag has frames, leave @{frame} out")
    if suffix in READERS:
        return read_cloud(path, "target")
    if suffix == TWIN_SUFFIX:
        graph = load_twin(path).model.graph
        return graph.positions[graph.surface]
    if is_bag(path):
        messages = object_messages(path, object_topic)
        return seen_points(messages[frame_index(frame, messages, path)])[1]
    kinds = ", ".join((*READERS, *BAG_SUFFIXES, TWIN_SUFFIX))
    if os.path.isfile(path):
        raise PlanningError(f"target {path}: files that hold a shape are {kinds}, not {suffix or 'without extension'}")
    raise PlanningError(
        f"target {source}: there is no such file or folder; give `{PRESENT}`, or a file ({kinds}), or a bag's folder"
    )


def _three(values: str, label: str) -> tuple[float, float, float]:
    try:
        numbers = tuple(float(each) for each in values.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != 3 or not np.isfinite(numbers).all():
        raise PlanningError(f"{label} must be three numbers without blanks, like 0.1,0,0; got {values!r}")
    return numbers[0], numbers[1], numbers[2]
