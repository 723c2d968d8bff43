"""Serving jobs: an action, and a service that starts the same job and answers at once."""

import uuid
from abc import ABC, abstractmethod
from functools import partial
from typing import Any, Generic, TypeVar

from egophys_msgs.msg import BuildJob
from egophys_ros_common.goal_server import GoalServer
from egophys_ros_common.managed_node import ManagedNode
from rclpy.action.server import ServerGoalHandle
from unique_identifier_msgs.msg import UUID

from egophys_twin.jobs import Ended, Job, JobRequest, Jobs, Made, OnProgress

RequestT = TypeVar("RequestT", bound=JobRequest)
MadeT = TypeVar("MadeT", bound=Made)


class JobServer(ABC, Generic[RequestT, MadeT]):
    """One kind of job; a subclass says what its messages mean and does the work."""

    noun: str
    """What the job is called, `build`."""
    action: Any
    """Type of the action."""
    service: Any
    """Type of the service; its request has the fields of the action's goal."""

    def __init__(self, node: ManagedNode, jobs: Jobs, *, action_name: str, service_name: str) -> None:
        """Create action and service; the node destroys them at cleanup."""
        self._node = node
        self._jobs = jobs
        GoalServer(node, self.action, action_name, noun=self.noun, begin=self._begin, run=self._run, cancel=jobs.cancel)
        node.own(node.create_service(self.service, service_name, self._start), node.destroy_service)

    @abstractmethod
    def request_of(self, message: Any) -> RequestT:
        """What a goal or a request of the service asks for.

        Raises:
            EgophysError: it asks for what cannot be.
        """

    @abstractmethod
    def work(self, job_id: UUID, request: RequestT, progress: OnProgress) -> MadeT:
        """Do a job, on a worker thread; `progress` may raise, to stop it.

        Raises:
            EgophysError: it failed.
        """

    @abstractmethod
    def feedback(self, stage: str, share: float, loss: float) -> Any:
        """The action's feedback."""

    @abstractmethod
    def result_fields(self, made: MadeT) -> dict[str, Any]:
        """Fields of the result of a job that succeeded, besides success, message and info."""

    def _begin(self, handle: ServerGoalHandle) -> Job:
        request = self.request_of(handle.request)
        self._jobs.check(request)

        def feed_back(stage: str, share: float, loss: float) -> None:
            handle.publish_feedback(self.feedback(stage, share, loss))

        job = self._job(handle.goal_id, request, feed_back)
        self._jobs.accept(job)
        return job

    async def _run(self, job: Job, handle: ServerGoalHandle) -> Any:
        ended: Ended = await self._jobs.run(job)
        if ended.state == BuildJob.SUCCEEDED:
            handle.succeed()
            fields = self.result_fields(ended.made)  # type: ignore[arg-type]
            return self.action.Result(success=True, message=ended.message, info=ended.info, **fields)
        if ended.state == BuildJob.CANCELED and handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return self.action.Result(success=False, message=ended.message)

    def _start(self, request: Any, response: Any) -> Any:
        try:
            asked = self.request_of(request)
            self._jobs.check(asked)
        except Exception as error:
            response.message = self._node.refuse(f"{self.noun} refused", error)
            return response
        job = self._job(UUID(uuid=list(uuid.uuid4().bytes)), asked)
        self._jobs.accept(job)
        self._node.executor.create_task(self._jobs.run, job)
        response.accepted, response.job_id = True, job.id
        response.message = f"started; follow {self._node.resolve_topic_name('~/job')}"
        return response

    def _job(self, job_id: UUID, request: RequestT, on_progress: OnProgress = lambda stage, share, loss: None) -> Job:
        return Job(id=job_id, noun=self.noun, work=partial(self.work, job_id, request), on_progress=on_progress)
