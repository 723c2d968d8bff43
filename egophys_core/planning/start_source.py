"""Where a plan begins, as text: the object as a bag or a point cloud shows it."""

from dataclasses import replace

import numpy as np

from egophys_core.errors import PlanningError
from egophys_core.observation import SeenObject, present_nodes, with_new_points
from egophys_core.planning.bag_frame import frame_index, is_bag, object_messages, path_and_frame, seen_points
from egophys_core.planning.cloud_file import READERS, read_cloud
from egophys_core.planning.start import Start, carried_start
from egophys_core.planning.target import check_shape
from egophys_core.recording import OBJECT_TOPIC
from egophys_core.twin import Twin

LOOK_EVERY = 10
"""Messages of a bag after which points that are new are bound."""


def start_of_source(source: str, twin: Twin, *, object_topic: str = OBJECT_TOPIC) -> Start:
    """The start that a text names: `towel.mcap@2.3s`, `towel.mcap@70`, or a point cloud file.

    A bag that begins with the object at rest also shows it deformed later; a cloud, which has no ids, does not.

    Raises:
        PlanningError, RecordingError: it is none of these, or cannot be read; of a cloud also that it is empty, not
            finite, or too large or too far to be this object in metres.
        EpisodeError: the object's shape cannot be told from it.
    """
    path, frame = path_and_frame(source)
    if path.suffix.lower() in READERS:
        points, graph = read_cloud(path, "start"), twin.model.graph
        check_shape(points, graph.positions[graph.surface], f"start {path}")
        seen = SeenObject(ids=np.arange(len(points), dtype=np.uint32), points=points.astype(np.float32), bound=None)
        return carried_start(twin, present_nodes(twin, seen))
    if not is_bag(path):
        raise PlanningError(f"start {source}: give a bag (towel.mcap@2.3s) or a point cloud ({', '.join(READERS)})")
    messages = object_messages(path, object_topic)
    index = frame_index(frame, messages, path)
    bound = None
    for message in [*messages[: index + 1 : LOOK_EVERY], messages[index]]:
        ids, points = seen_points(message)
        seen = SeenObject(ids=ids, points=points, bound=bound)
        bound = with_new_points(twin, seen)
    return carried_start(twin, present_nodes(twin, replace(seen, bound=bound)))
