"""Waiting for a twin node's job."""

from collections.abc import Sequence

from egophys_msgs.msg import BuildJob
from egophys_ros_common.processes import RESULT_TIMEOUT, Client
from egophys_ros_common.qos import latched


def wait_for_job(
    client: Client,
    state: int,
    *,
    stage: str = "",
    job_id: Sequence[int] | None = None,
    node: str = "/twin_node",
) -> BuildJob:
    """The node's next report of a job, or of this one, in this state and stage.

    A job computes for as long as the machine takes: the time of a result, not of a message.
    """

    def reached(job: BuildJob) -> bool:
        mine = job_id is None or job.job_id == job_id
        return mine and job.state == state and job.stage.startswith(stage)

    return client.message(BuildJob, f"{node}/job", reached, latched(), timeout=RESULT_TIMEOUT)
