"""twin_node: builds twins from recordings, keeps one in use, and rolls it out."""

import sys
import uuid
from functools import partial
from pathlib import Path

import numpy as np
from egophys_msgs.action import BuildTwin
from egophys_msgs.msg import BuildJob, TwinInfo
from egophys_msgs.srv import RebuildTwin, RolloutTwin
from egophys_ros_common.conversions import points_message, time_message
from egophys_ros_common.managed_node import ManagedNode, run_node
from egophys_ros_common.parameters import declare_options, read_option_groups
from egophys_ros_common.worker import Worker
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from std_srvs.srv import Trigger
from unique_identifier_msgs.msg import UUID

from egophys_core.episode_source import EpisodeSource, SourceOptions
from egophys_core.errors import EgophysError, TwinError
from egophys_core.identification import FitOptions
from egophys_core.perception.board import Board
from egophys_core.perception.options import PerceptionOptions
from egophys_core.recording import CONTROLLER_TOPIC, OBJECT_TOPIC, xyz_of_message
from egophys_core.twin import Twin, load_twin
from egophys_core.waypoint_plan import plan_of_message
from egophys_twin.build import BuildRequest
from egophys_twin.build_jobs import BuildJobs, Job
from egophys_twin.rollouts import simulate
from egophys_twin.twin_topics import TwinTopics, info_message

TEXT_PARAMETERS = {
    "twin_path": ("", "twin file to use from the start; empty for none"),
    "object_topic": (OBJECT_TOPIC, "topic of the object's points in the recordings to build from"),
    "controller_topic": (CONTROLLER_TOPIC, "topic of the hands' points in the recordings to build from"),
}

OPTION_GROUPS = ((FitOptions, ""), (SourceOptions, ""), (PerceptionOptions, "perception."), (Board, "board."))
"""Classes of options and the prefixes of their parameters."""


class TwinNode(ManagedNode):
    """Serves build, rebuild, cancel and rollout, and publishes the twin in use."""

    def __init__(self) -> None:
        """Declare the parameters: those of the node and every option of perception and fit."""
        super().__init__("twin_node")
        for name, (default, description) in TEXT_PARAMETERS.items():
            self.declare_parameter(name, default, ParameterDescriptor(description=description))
        for options, prefix in OPTION_GROUPS:
            declare_options(self, options, prefix)
        self._twin: Twin | None = None
        self._info = TwinInfo()
        self._topics: TwinTopics
        self._jobs: BuildJobs
        self._rollouts: Worker

    def configure(self) -> None:
        """Load the twin of `twin_path`, if any, and create topics, services and the action."""
        read_option_groups(self, OPTION_GROUPS)
        self._twin = None
        if twin_path := self.get_parameter("twin_path").value:
            path = Path(twin_path)
            self._twin = load_twin(path)
            self._info = info_message(self._twin, path, time_message(path.stat().st_mtime_ns))
        self._topics = TwinTopics(self)
        self._jobs = BuildJobs(self, self._topics, self._use)
        self._rollouts = self.own(Worker("rollout", self.hand_over), Worker.close)
        self._serve()

    def activate(self) -> None:
        """Publish the twin loaded; from now on requests are taken."""
        if self._twin is not None:
            self._topics.publish_twin(self._twin, self._info)

    def deactivate(self) -> None:
        """Cancel the build, finish the rollout that runs, drop those that wait."""
        self._jobs.stop()
        self._rollouts.stop()

    def health(self) -> dict[str, str]:
        """Which twin is in use and what the newest job does."""
        return {"twin id": self._twin.twin_id if self._twin else "", "job": self._jobs.state}

    def _serve(self) -> None:
        build = ActionServer(
            self,
            BuildTwin,
            "~/build",
            self._build,
            goal_callback=self._check_goal,
            handle_accepted_callback=self._accept_goal,
            cancel_callback=self._cancel_goal,
        )
        self.own(build, ActionServer.destroy)
        waiting = ReentrantCallbackGroup()
        for kind, name, callback in (
            (RebuildTwin, "~/rebuild", self._rebuild),
            (RolloutTwin, "~/rollout", self._rollout),
            (Trigger, "~/cancel", self._cancel),
        ):
            service = self.create_service(kind, name, callback, callback_group=waiting)
            self.own(service, self.destroy_service)

    def _check_goal(self, goal: BuildTwin.Goal) -> GoalResponse:
        try:
            self._jobs.check(self._request(goal))
        except EgophysError as error:
            # An action rejects without words; they are in the log and in /diagnostics.
            self.refuse("build goal rejected", error)
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _accept_goal(self, handle: ServerGoalHandle) -> None:
        def feed_back(stage: str, share: float, loss: float) -> None:
            handle.publish_feedback(BuildTwin.Feedback(stage=stage, progress=share, best_loss=loss))

        job = Job(id=handle.goal_id, request=self._request(handle.request), on_progress=feed_back)
        self._jobs.accept(job)
        handle.execute(partial(self._build, job))

    def _cancel_goal(self, handle: ServerGoalHandle) -> CancelResponse:
        return CancelResponse.ACCEPT if self._jobs.cancel() else CancelResponse.REJECT

    async def _build(self, job: Job, handle: ServerGoalHandle) -> BuildTwin.Result:
        ended = await self._jobs.run(job)
        if ended.state == BuildJob.SUCCEEDED:
            handle.succeed()
            return BuildTwin.Result(success=True, message=ended.message, info=self._info)
        if ended.state == BuildJob.CANCELED and handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return BuildTwin.Result(success=False, message=ended.message)

    def _rebuild(self, request: RebuildTwin.Request, response: RebuildTwin.Response) -> RebuildTwin.Response:
        try:
            job = Job(id=UUID(uuid=list(uuid.uuid4().bytes)), request=self._request(request))
            self._jobs.check(job.request)
        except EgophysError as error:
            response.message = self.refuse("rebuild refused", error)
            return response
        self._jobs.accept(job)
        self.executor.create_task(self._jobs.run, job)
        response.accepted, response.job_id = True, job.id
        response.message = f"started; follow {self.resolve_topic_name('~/job')}"
        return response

    def _cancel(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._jobs.cancel()
        response.message = (
            "the build stops within a generation or a frame" if response.success else "no build is running"
        )
        return response

    async def _rollout(self, request: RolloutTwin.Request, response: RolloutTwin.Response) -> RolloutTwin.Response:
        try:
            twin = self._twin_meant(request.twin_id)
            plans = [plan_of_message(plan) for plan in request.plans]
            answer = await self._rollouts.run(partial(simulate, twin, plans, _target_points(request)))
        except Exception as error:
            response.message = self.refuse("rollout failed", error)
            return response
        surface = np.flatnonzero(twin.model.graph.surface)
        stamp = self.get_clock().now().to_msg()
        shapes = [points_message(shape, ids=surface, stamp=stamp) for shape in answer.shapes]
        if len(shapes) == 1:
            self._topics.publish_prediction(request.plans[0], shapes[0])
        response.success, response.twin_id, response.costs = True, twin.twin_id, answer.costs.tolist()
        response.final_shapes = shapes if request.return_shapes else []
        return response

    def _twin_meant(self, twin_id: str) -> Twin:
        if not self.is_active:
            raise TwinError("the node is not active; configure and activate it first")
        if self._twin is None:
            raise TwinError("no twin is in use; build one, or start the node with twin_path")
        if twin_id not in ("", self._twin.twin_id):
            raise TwinError(f"twin {twin_id} is not in use, {self._twin.twin_id} is; ask for that one")
        return self._twin

    def _use(self, twin: Twin, path: Path) -> None:
        self._twin = twin
        self._info = info_message(twin, path, self.get_clock().now().to_msg())
        self._topics.publish_twin(twin, self._info)

    def _request(self, message: BuildTwin.Goal | RebuildTwin.Request) -> BuildRequest:
        fit, choice, perception, board = read_option_groups(self, OPTION_GROUPS, message.options_json)
        return BuildRequest(
            episode_paths=tuple(Path(path) for path in message.episode_paths),
            output_path=Path(message.output_path),
            options=fit,
            seed=message.seed,
            source=EpisodeSource(
                source=choice.source,
                object_topic=self.get_parameter("object_topic").value,
                controller_topic=self.get_parameter("controller_topic").value,
                perception=perception,
                board=board,
            ),
        )


def _target_points(request: RolloutTwin.Request) -> np.ndarray:
    if len(request.target.data) == 0:
        return np.empty((0, 3), np.float32)
    return xyz_of_message(request.target, source="target")


def main() -> int:
    """Run the node; the exit code."""
    return run_node(TwinNode)


if __name__ == "__main__":
    sys.exit(main())
