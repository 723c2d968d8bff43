"""twin_node: builds twins from recordings, keeps one in use, rolls it out, and finds what it lacks."""

import sys
from functools import partial
from pathlib import Path

import numpy as np
from egophys_msgs.msg import TwinInfo
from egophys_msgs.srv import RolloutTwin
from egophys_ros_common.conversions import points_message, time_message
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.parameters import declare_options, declare_texts, read_option_groups
from egophys_ros_common.running import run_node
from egophys_ros_common.worker import Worker
from rclpy.callback_groups import ReentrantCallbackGroup
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from egophys_core.errors import TwinError
from egophys_core.identification import FitOptions
from egophys_core.recording import xyz_of_message
from egophys_core.twin import Twin, load_twin
from egophys_core.waypoint_plan import plan_of_message
from egophys_twin.asked_world import declare_arm
from egophys_twin.build_server import BuildServer
from egophys_twin.diagnosis_server import DIAGNOSIS_GROUP, DiagnosisServer
from egophys_twin.episode_parameters import SOURCE_GROUPS, declare_source
from egophys_twin.jobs import Jobs
from egophys_twin.rollouts import simulate, start_of
from egophys_twin.twin_topics import TwinTopics, info_message

TWIN_PARAMETERS = {"twin_path": ("", "twin file to use from the start; empty for none")}

OPTION_GROUPS = ((FitOptions, ""), DIAGNOSIS_GROUP)
"""Classes of options, besides those of episodes, and the prefixes of their parameters."""


class TwinNode(ManagedNode):
    """Serves builds, diagnoses, their cancellation and rollouts, and publishes the twin in use."""

    def __init__(self) -> None:
        """Declare the parameters: those of the node and every option of perception, fit and diagnosis."""
        super().__init__("twin_node")
        declare_texts(self, TWIN_PARAMETERS)
        for options, prefix in OPTION_GROUPS:
            declare_options(self, options, prefix, at_once=True)
        declare_source(self)
        declare_arm(self)
        self._twin: Twin | None = None
        self._info = TwinInfo()
        self._topics: TwinTopics
        self._jobs: Jobs
        self._rollouts: Worker

    def configure(self) -> None:
        """Load the twin of `twin_path`, if any, and create topics, services and actions."""
        read_option_groups(self, (*OPTION_GROUPS, *SOURCE_GROUPS))
        self._twin = None
        if twin_path := self.get_parameter("twin_path").value:
            path = Path(twin_path).expanduser()
            self._twin = load_twin(path)
            self._info = info_message(self._twin, path, time_message(path.stat().st_mtime_ns))
        self._topics = TwinTopics(self)
        self._jobs = Jobs(self, self._topics, self._use)
        self._rollouts = self.own(Worker("rollout", self.hand_over), Worker.close)
        self._serve()

    def activate(self) -> None:
        """Publish the twin loaded; from now on requests are taken."""
        if self._twin is not None:
            self._topics.publish_twin(self._twin, self._info)

    def deactivate(self) -> None:
        """Cancel the job, finish the rollout that runs, drop those that wait."""
        self._jobs.stop()
        self._rollouts.stop()

    def status(self) -> str:
        """Whether there is a twin to roll out and to plan with."""
        if not self.is_active:
            return super().status()
        return "active" if self._twin else "no twin in use: build one, or start with twin_path"

    def health(self) -> dict[str, str]:
        """Which twin is in use and what the newest job does."""
        return {"twin id": self._twin.twin_id if self._twin else "", "job": self._jobs.state}

    def _serve(self) -> None:
        BuildServer(self, self._jobs, self._topics)
        DiagnosisServer(self, self._jobs, self._require_twin)
        waiting = ReentrantCallbackGroup()
        for kind, name, callback in (
            (RolloutTwin, "~/rollout", self._rollout),
            (Trigger, "~/cancel", self._cancel),
        ):
            service = self.create_service(kind, name, callback, callback_group=waiting)
            self.own(service, self.destroy_service)

    def _cancel(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        job = self._jobs.current
        response.success = self._jobs.cancel()
        response.message = f"the {job.noun} stops at its next step" if job else "no job is running"
        return response

    async def _rollout(self, request: RolloutTwin.Request, response: RolloutTwin.Response) -> RolloutTwin.Response:
        try:
            twin = self._twin_meant(request.twin_id)
            plans = [plan_of_message(plan) for plan in request.plans]
            start = start_of(twin, _points_of(request.start, "start"), _points_of(request.grasp, "grasp"))
            target = _points_of(request.target, "target")
            answer = await self._rollouts.run(partial(simulate, twin, plans, target, start))
        except Exception as error:
            response.message = self.refuse("rollout failed", error)
            return response
        surface = np.flatnonzero(twin.model.graph.surface)
        stamp = self.get_clock().now().to_msg()
        shapes = [points_message(shape, ids=surface, stamp=stamp) for shape in answer.shapes]
        if len(shapes) == 1:
            self._topics.publish_prediction(request.plans[0], shapes[0], start, stamp)
        response.success, response.twin_id, response.costs = True, twin.twin_id, answer.costs.tolist()
        response.final_shapes = shapes if request.return_shapes else []
        return response

    def _twin_meant(self, twin_id: str) -> Twin:
        if not self.is_active:
            raise TwinError("the node is not active; configure and activate it first")
        twin = self._require_twin()
        if twin_id not in ("", twin.twin_id):
            raise TwinError(f"twin {twin_id} is not in use, {twin.twin_id} is; ask for that one")
        return twin

    def _require_twin(self) -> Twin:
        if self._twin is None:
            raise TwinError("no twin is in use; build one, or start the node with twin_path")
        return self._twin

    def _use(self, twin: Twin, path: Path) -> TwinInfo:
        self._twin = twin
        self._info = info_message(twin, path, self.get_clock().now().to_msg())
        self._topics.publish_twin(twin, self._info)
        return self._info


def _points_of(message: PointCloud2, source: str) -> np.ndarray:
    """[P, 3] metres; none of a message that was left empty, which has no frame either."""
    if len(message.data) == 0:
        return np.empty((0, 3), np.float32)
    return xyz_of_message(message, source=source)


def main() -> int:
    """Run the node; the exit code."""
    return run_node(TwinNode)


if __name__ == "__main__":
    sys.exit(main())
