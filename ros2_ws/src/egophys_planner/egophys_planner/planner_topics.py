"""The topics of the planner: the newest plan, and what it was made from."""

import json

import numpy as np
from egophys_msgs.msg import WaypointPlan
from egophys_ros_common.conversions import points_message
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.qos import latched
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.time import Time
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header, String

from egophys_core.options import to_mapping
from egophys_planner.planning_job import PlanningJob, PlanningProblem


class PlannerTopics:
    """Publishers of the planner, all latched."""

    def __init__(self, node: ManagedNode) -> None:
        """Create the publishers; the node destroys them at cleanup."""

        def publisher(kind: type, name: str) -> Publisher:
            return node.own(node.create_publisher(kind, name, latched()), node.destroy_publisher)

        self._plan = publisher(WaypointPlan, "~/plan")
        self._path = publisher(Path, "~/path")
        self._problem = publisher(String, "~/problem")
        self._target = publisher(PointCloud2, "~/target")
        self._start = publisher(PointCloud2, "~/start")

    def publish_problem(self, job: PlanningJob, problem: PlanningProblem) -> None:
        """Everything a plan depends on besides the twin, so that a log is enough to plan it again."""
        described = {
            "seed": job.seed,
            "options": to_mapping(job.options),
            "twin_id": job.twin.twin_id,
            "grasp_m": problem.start.grasp.tolist(),
        }
        self._problem.publish(String(data=json.dumps(described)))
        for publisher, points in ((self._target, problem.target), (self._start, problem.start.nodes)):
            publisher.publish(points_message(points, ids=np.arange(len(points))))

    def publish_plan(self, plan: WaypointPlan) -> None:
        """The plan, and its poses to look at."""
        self._plan.publish(plan)
        self._path.publish(path_message(plan))


def path_message(plan: WaypointPlan) -> Path:
    """A plan's poses, stamped as if it started when it was made."""
    start = Time.from_msg(plan.header.stamp)
    return Path(
        header=plan.header,
        poses=[
            PoseStamped(
                header=Header(frame_id=plan.header.frame_id, stamp=(start + Duration.from_msg(after)).to_msg()),
                pose=pose,
            )
            for pose, after in zip(plan.poses, plan.time_from_start, strict=True)
        ],
    )
