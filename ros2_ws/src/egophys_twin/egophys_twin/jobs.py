"""The jobs of the twin node: one at a time, from an action goal or a service call; each makes a twin to use."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from math import isnan
from pathlib import Path
from threading import Event
from typing import Protocol

from egophys_msgs.msg import BuildJob, TwinInfo
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.worker import CanceledError, Worker
from unique_identifier_msgs.msg import UUID

from egophys_core.errors import TwinError
from egophys_core.twin import Twin
from egophys_twin.build import NOT_KNOWN
from egophys_twin.twin_topics import TwinTopics

OnProgress = Callable[[str, float, float], None]
"""Stage, share done (0..1), best loss in metres."""


class JobRequest(Protocol):
    """What someone asks for."""

    def check(self) -> None:
        """Look whether it can start at all; raises EgophysError with the reason."""


class Made(Protocol):
    """What a job ends with."""

    @property
    def twin(self) -> Twin:
        """To be used from now on."""

    @property
    def path(self) -> Path:
        """The twin's file."""

    @property
    def summary(self) -> str:
        """For a person."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """A request that was accepted."""

    id: UUID
    noun: str
    """What it is called, `build`."""
    work: Callable[[OnProgress], Made]
    """Does it, on a worker thread; the progress it reports may raise, to stop it."""
    on_progress: OnProgress = lambda stage, share, loss: None
    canceled: Event = field(default_factory=Event)


@dataclass(frozen=True, kw_only=True)
class Ended:
    """How a job ended."""

    state: int
    """Of BuildJob."""
    message: str
    made: Made | None = None
    """None unless it succeeded, as is `info`."""
    info: TwinInfo | None = None


class Jobs:
    """Runs a job on a worker thread and publishes its state. Everything but its work is on the executor."""

    def __init__(self, node: ManagedNode, topics: TwinTopics, use_twin: Callable[[Twin, Path], TwinInfo]) -> None:
        """Run nothing yet; `use_twin` is called with each twin that was made, and its file."""
        self._node = node
        self._topics = topics
        self._use_twin = use_twin
        self._worker = node.own(Worker("job", node.hand_over), Worker.close)
        self.current: Job | None = None
        """The job that runs."""
        self.state = "none"
        """Stage or end of the newest job, for people."""

    def check(self, request: JobRequest) -> None:
        """Look whether a job can start now.

        Raises:
            TwinError: the node is not active, or another job runs.
            EgophysError: the request cannot be met.
        """
        if not self._node.is_active:
            raise TwinError("the node is not active; configure and activate it first")
        if self.current is not None:
            raise TwinError(
                f"a {self.current.noun} is running ({self.state}); wait for it, or cancel it, and ask again"
            )
        request.check()

    def accept(self, job: Job) -> None:
        """Make a checked job the running one; `run` must follow."""
        self.current = job
        self._report(job, "accepted", 0.0, NOT_KNOWN)

    async def run(self, job: Job) -> Ended:
        """Do an accepted job. Raises nothing."""
        try:
            made = await self._worker.run(partial(job.work, partial(self._progress, job)))
            info = self._use_twin(made.twin, made.path)
        except CanceledError as error:
            return self._end(job, Ended(state=BuildJob.CANCELED, message=f"canceled: {error}"))
        except Exception as error:
            message = self._node.refuse(f"{job.noun} failed", error)
            return self._end(job, Ended(state=BuildJob.FAILED, message=message))
        self._node.last_error = ""
        return self._end(job, Ended(state=BuildJob.SUCCEEDED, message=made.summary, made=made, info=info))

    def cancel(self) -> bool:
        """Ask the running job to stop, which it does when it reports progress next; False if none runs."""
        if self.current is None:
            return False
        self.current.canceled.set()
        return True

    def stop(self) -> None:
        """Cancel and wait for the end of the work; `run` then answers."""
        self.cancel()
        self._worker.stop()

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

    def _end(self, job: Job, ended: Ended) -> Ended:
        self.current = None
        self.state = ended.message
        self._topics.publish_job(
            BuildJob(job_id=job.id, stage="end", progress=1.0, state=ended.state, message=ended.message)
        )
        return ended
