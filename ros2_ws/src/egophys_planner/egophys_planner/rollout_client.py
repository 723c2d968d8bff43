"""The twin node's rollout service as the planner's forward model."""

import time
from collections.abc import Sequence
from threading import Event

import numpy as np
from egophys_msgs.srv import RolloutTwin
from egophys_ros_common.conversions import plan_message, points_message
from egophys_ros_common.worker import CanceledError
from rclpy.client import Client

from egophys_core.errors import PlanningError
from egophys_core.waypoint_plan import WaypointPlan
from egophys_planner.planning_job import PlanningProblem

LOOK_PERIOD_S = 0.1
"""How often a waiting call looks whether it was canceled or the service has gone."""


class RolloutClient:
    """Costs of plans, from the service. Called on a worker thread; the executor delivers the answers."""

    def __init__(
        self,
        client: Client,
        *,
        twin_id: str,
        problem: PlanningProblem,
        service_timeout_s: float,
        answer_timeout_s: float,
        canceled: Event,
    ) -> None:
        """Ask nothing yet.

        Args:
            client: of the rollout service.
            twin_id: the twin to roll out; if another comes into use meanwhile, planning fails.
            problem: where rollouts begin, and the shape that costs are a distance to.
            service_timeout_s: how long to wait for the service to be there.
            answer_timeout_s: how long to wait for an answer.
            canceled: set to stop waiting.
        """
        self._client = client
        self._twin_id = twin_id
        self._target, self._start, self._grasp = (
            points_message(each, ids=np.arange(len(each)))
            for each in (problem.target, problem.start.nodes, problem.start.grasp)
        )
        self._service_timeout_s = service_timeout_s
        self._answer_timeout_s = answer_timeout_s
        self._canceled = canceled

    def __call__(self, plans: Sequence[WaypointPlan]) -> np.ndarray:
        """[K] metres: costs of plans, infinite for one that diverged.

        Raises:
            PlanningError: the service is not there, does not answer in time, or cannot roll out a plan.
            CanceledError: `canceled` was set.
        """
        name = self._client.service_name
        if not self._client.wait_for_service(self._service_timeout_s):
            raise PlanningError(
                f"no rollout service {name} within {self._service_timeout_s:g} s; is the twin node running?"
            )
        answered = Event()
        answer = self._client.call_async(
            RolloutTwin.Request(
                twin_id=self._twin_id,
                plans=[plan_message(plan) for plan in plans],
                target=self._target,
                start=self._start,
                grasp=self._grasp,
            )
        )
        answer.add_done_callback(lambda _: answered.set())
        try:
            self._wait(answered, name)
        except (CanceledError, PlanningError):
            self._client.remove_pending_request(answer)
            raise
        response = answer.result()
        if not response.success:
            raise PlanningError(f"rollout service {name}: {response.message}")
        return np.array(response.costs, np.float64)

    def _wait(self, answered: Event, name: str) -> None:
        deadline = time.monotonic() + self._answer_timeout_s
        while not answered.wait(LOOK_PERIOD_S):
            if self._canceled.is_set():
                raise CanceledError("stopped while a rollout was running")
            if not self._client.service_is_ready():
                raise PlanningError(f"rollout service {name} has gone; start the twin node again")
            if time.monotonic() > deadline:
                raise PlanningError(
                    f"no answer from rollout service {name} within {self._answer_timeout_s:g} s; raise "
                    "rollout_timeout_s, or lower samples"
                )
