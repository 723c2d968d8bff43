"""The object as it is seen: the newest observation, and which of its points are known by their ids."""

from functools import partial

import numpy as np
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.worker import CanceledError, Worker
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.qos import qos_profile_sensor_data
from rclpy.time import Time
from sensor_msgs.msg import PointCloud2

from egophys_core.episode import WORLD_FRAME
from egophys_core.errors import EgophysError, PlanningError
from egophys_core.kinds import kind_of
from egophys_core.observation import BoundPoints, SeenObject, require_at_rest, with_new_points
from egophys_core.recording import points_of_message
from egophys_core.twin import Twin
from egophys_core.waypoint_plan import NANOSECONDS

LOOK_PERIOD_S = 1.0
"""How often new points are bound to the twin; where the object does not look like it, that costs tenths of a second."""
KEPT_S = 1.0
"""Observations this far back tell whether the object is at rest."""


class ObjectWatch:
    """Keeps what a plan from the present state needs, from the time on when the node is configured."""

    def __init__(self, node: ManagedNode) -> None:
        """Subscribe; the node destroys that at cleanup."""
        self._node = node
        self._twin: Twin | None = None
        self._bound: BoundPoints | None = None
        self._recent: list[PointCloud2] = []
        self._is_looking = False
        self._worker = node.own(Worker("object", node.hand_over), Worker.close)
        self._topic = node.resolve_topic_name(node.get_parameter("object_topic").value)
        node.own(
            node.create_subscription(PointCloud2, self._topic, self._take, qos_profile_sensor_data),
            node.destroy_subscription,
        )
        waiting = ReentrantCallbackGroup()
        node.own(node.create_timer(LOOK_PERIOD_S, self._look, callback_group=waiting), node.destroy_timer)

    @property
    def why_unknown(self) -> str:
        """Why nothing is known of where the object is, empty if something is; then plans begin with the twin."""
        if self._twin is not None and kind_of(self._twin.model).from_surface is None:
            return "the twin was built from markers, which are not placed anew"
        return (
            ""
            if self._recent
            else f"the object has not been seen: no message on {self._topic} (does its observer run?)"
        )

    @property
    def state(self) -> str:
        """What `/diagnostics` says of it."""
        try:
            known = self.seen().bound
        except EgophysError as error:
            return str(error)
        return f"seen, {len(known.ids)} points known" if known else "seen, not known yet"

    def watch(self, twin: Twin) -> None:
        """Bind points to this twin from now on; a version of the same nodes keeps what is bound."""
        same = self._twin is not None and np.array_equal(self._twin.model.graph.positions, twin.model.graph.positions)
        self._bound = self._bound if same else None
        self._twin = twin

    def seen(self) -> SeenObject:
        """The object as it is now.

        Raises:
            PlanningError: it has not been seen, or not lately.
            EpisodeError: it moves.
            RecordingError: what is published is no tracked points.
        """
        if self.why_unknown:
            raise PlanningError(self.why_unknown)
        newest, limit = self._recent[-1], self._node.get_parameter("object_max_age_s").value
        age = self._seconds_since(newest)
        if age > limit:
            raise PlanningError(
                f"the object was last seen {age:.1f} s ago on {self._topic}, which is not now (object_max_age_s "
                f"{limit:g} s); show it to its observer, or plan from the twin's own shape (start: twin)"
            )
        now = self._object_of(newest)
        require_at_rest(self._object_of(self._recent[0]), now)
        return now

    def stop(self) -> None:
        """Wait until nothing is looked at."""
        self._worker.stop()

    def _take(self, message: PointCloud2) -> None:
        now = _stamp_ns(message)
        self._recent = [each for each in self._recent if 0 <= now - _stamp_ns(each) <= KEPT_S * NANOSECONDS]
        self._recent.append(message)

    async def _look(self) -> None:
        """Bind the points of the newest observation that are not known yet."""
        twin = self._twin
        if self._is_looking or twin is None or not self._recent or not self._node.is_active:
            return
        self._is_looking = True
        try:
            bound = await self._worker.run(partial(with_new_points, twin, self._object_of(self._recent[-1])))
            if twin is self._twin:
                self._bound = bound
        except CanceledError:
            pass
        except Exception as error:
            self._node.refuse(f"cannot use the points of {self._topic}", error)
        finally:
            self._is_looking = False

    def _object_of(self, message: PointCloud2) -> SeenObject:
        points = points_of_message(message, source=self._topic)
        if points.frame_id != WORLD_FRAME:
            raise PlanningError(f"{self._topic} is in frame {points.frame_id!r}, needed is {WORLD_FRAME!r}")
        good = np.isfinite(points.xyz).all(axis=1) & (points.confidence > 0)
        ids, first = np.unique(points.ids[good], return_index=True)
        return SeenObject(ids=ids, points=points.xyz[good][first], bound=self._bound)

    def _seconds_since(self, message: PointCloud2) -> float:
        return float(self._node.get_clock().now().nanoseconds - _stamp_ns(message)) / NANOSECONDS


def _stamp_ns(message: PointCloud2) -> int:
    return int(Time.from_msg(message.header.stamp).nanoseconds)
