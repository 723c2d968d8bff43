"""The build jobs of the twin node: one at a time, from an action goal or a service call."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import isnan
from pathlib import Path
from threading import Event

from egophys_msgs.msg import BuildJob
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.worker import CanceledError, Worker
from unique_identifier_msgs.msg import UUID

from egophys_core.episode_source import LoadedEpisode
from egophys_core.errors import TwinError
from egophys_core.twin import Twin
from egophys_twin.build import NOT_KNOWN, BuildRequest, run_build
from egophys_twin.twin_topics import TwinTopics

OnProgress = Callable[[str, float, float], None]
"""Stage, share done (0..1), best loss in metres."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """A build that was accepted."""

    id: UUID
    request: BuildRequest
    on_progress: OnProgress = lambda stage, share, loss: None
    canceled: Event = field(default_factory=Event)


class BuildJobs:
    """Runs a job on a worker thread and publishes its state. Everything but the build is on the executor."""

    def __init__(self, node: ManagedNode, topics: TwinTopics, use_twin: Callable[[Twin, Path], None]) -> None:
        """Run nothing yet; `use_twin` is called with each twin that was built, and its file."""
        self._node = node
        self._topics = topics
        self._use_twin = use_twin
        self._worker = node.own(Worker("build", node.hand_over), Worker.close)
        self.current: Job | None = None
        """The job that runs."""
        self.state = "none"
        """Stage or end of the newest job, for people."""

    def check(self, request: BuildRequest) -> None:
        """Look whether a job can start now.

        Raises:
            TwinError: the node is not active, another job runs, or the output cannot be written.
            RecordingError: a recording does not exist.
        """
        if not self._node.is_active:
            raise TwinError("the node is not active; configure and activate it first")
        if self.current is not None:
            raise TwinError(f"a build is running ({self.state}); wait for it, or cancel it, and ask again")
        request.check()

    def accept(self, job: Job) -> None:
        """Make a checked job the running one; `run` must follow."""
        self.current = job
        self._report(job, "accepted", 0.0, NOT_KNOWN)

    async def run(self, job: Job) -> BuildJob:
        """Do an accepted job; the answer is how it ended. Raises nothing."""
        work = partial(
            run_build,
            job.request,
            on_episodes=partial(self._node.hand_over, self._tell_of_episodes, job),
            progress=partial(self._progress, job),
        )
        try:
            twin = await self._worker.run(work)
            self._use_twin(twin, job.request.output_path)
        except CanceledError as error:
            return self._end(job, BuildJob.CANCELED, f"canceled: {error}")
        except Exception as error:
            return self._end(job, BuildJob.FAILED, self._node.refuse("build failed", error))
        self._node.last_error = ""
        return self._end(job, BuildJob.SUCCEEDED, f"built twin {twin.twin_id}: {job.request.output_path}")

    def cancel(self) -> bool:
        """Ask the running job to stop, which it does at its next generation or frame; False if none runs."""
        if self.current is None:
            return False
        self.current.canceled.set()
        return True

    def stop(self) -> None:
        """Cancel and wait for the end of the build; `run` then answers."""
        self.cancel()
        self._worker.stop()

    def _tell_of_episodes(self, job: Job, loaded: Sequence[LoadedEpisode]) -> None:
        self._topics.publish_training(job.id, job.request, loaded)
        for each in loaded:
            for note in each.report.notes if each.report else ():
                self._node.get_logger().info(f"{each.episode.name}: {note}")

    def _progress(self, job: Job, stage: str, share: float, loss: float) -> None:
        if job.canceled.is_set():
            raise CanceledError(f"stopped at {stage}, {share:.0%} done; the previous twin stays in use")
        self._node.hand_over(self._report, job, stage, share, loss)

    def _report(self, job: Job, stage: str, share: float, loss: float) -> None:
        self.state = f"{stage}, {share:.0%}"
        job.on_progress(stage, share, loss)
        self._topics.publish_job(
            BuildJob(
                job_id=job.id,
                stage=stage,
                progress=share,
                state=BuildJob.RUNNING,
                message="" if isnan(loss) else f"best loss {loss:.4g} m",
            )
        )

    def _end(self, job: Job, state: int, message: str) -> BuildJob:
        self.current = None
        self.state = message
        ended = BuildJob(job_id=job.id, stage="end", progress=1.0, state=state, message=message)
        self._topics.publish_job(ended)
        return ended
