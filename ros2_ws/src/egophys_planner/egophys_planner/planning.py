"""Making plans, one at a time: what the action and the service of the planner do."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from egophys_msgs.action import PlanToTarget
from egophys_msgs.msg import WaypointPlan as WaypointPlanMessage
from egophys_msgs.srv import RolloutTwin
from egophys_ros_common.conversions import plan_message
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.parameters import read_options
from egophys_ros_common.qos import latched
from egophys_ros_common.worker import Worker
from std_msgs.msg import UInt8MultiArray

from egophys_core.errors import EgophysError, PlanningError
from egophys_core.planning import PlanOptions, parse_target
from egophys_core.recording import xyz_of_message
from egophys_core.twin import Twin, decode_twin
from egophys_planner.object_watch import ObjectWatch
from egophys_planner.planner_topics import PlannerTopics
from egophys_planner.planning_job import PlanningJob, PlanningProblem
from egophys_planner.rollout_client import RolloutClient

PRESENT, TWIN = "present", "twin"
"""Where plans begin, as goals and results say it."""

FeedBack = Callable[[int, int, float], None]
"""Called on a worker thread with iterations done, iterations, and the best cost in metres."""


@dataclass(frozen=True, kw_only=True)
class Planned:
    """The best plan found."""

    plan: WaypointPlanMessage
    initial_cost: float
    """Metres, of the start only held."""
    tolerance: float
    """Metres."""
    start: str
    why_twin: str

    @property
    def reached(self) -> bool:
        """Whether the plan is predicted to end within the tolerance."""
        return bool(self.plan.predicted_cost <= self.tolerance)

    @property
    def message(self) -> str:
        """What was found, and what to do where that is not enough."""
        ends, before = 1000 * self.plan.predicted_cost, 1000 * self.initial_cost
        begins = f"begins at {self.start}{f' ({self.why_twin})' if self.why_twin else ''}"
        if self.reached:
            return f"{begins}; {ends:.1f} mm from the target predicted, {before:.1f} mm without moving"
        return (
            f"the target is not reached: the best plan ends {ends:.1f} mm from it, tolerated are "
            f"{1000 * self.tolerance:.1f} mm ({before:.1f} mm without moving; it {begins}); raise iterations, samples "
            "or waypoints, widen the box (low_m, high_m), choose a nearer target, or raise tolerance_m"
        )


class Planning:
    """Makes a plan at a time with the twin that the twin node has in use."""

    def __init__(self, node: ManagedNode) -> None:
        """Create topics and the client, listen for the twin and the object; the node destroys them at cleanup."""
        self._node = node
        self._job: PlanningJob | None = None
        self._twin: Twin | None = None
        self._worker = node.own(Worker("plan", node.hand_over), Worker.close)
        self._topics = PlannerTopics(node)
        self._rollouts = node.own(
            node.create_client(RolloutTwin, node.get_parameter("rollout_service").value), node.destroy_client
        )
        self._model_topic = node.resolve_topic_name(node.get_parameter("model_topic").value)
        node.own(
            node.create_subscription(UInt8MultiArray, self._model_topic, self._take_twin, latched()),
            node.destroy_subscription,
        )
        self._object = ObjectWatch(node)

    @property
    def twin_id(self) -> str:
        """Of the twin that the next plan is made with, empty for none."""
        return self._twin.twin_id if self._twin else ""

    @property
    def is_busy(self) -> bool:
        """Whether a plan is being made."""
        return self._job is not None

    @property
    def object_state(self) -> str:
        """What is known of the object, in words."""
        return self._object.state

    def begin(self, goal: PlanToTarget.Goal) -> PlanningJob:
        """Take a goal on; `run` it next.

        Raises:
            EgophysError: the reason why it cannot be.
        """
        if not self._node.is_active:
            raise PlanningError("the node is not active; configure and activate it first")
        if self._job is not None:
            raise PlanningError("another goal is being planned; wait for it, or cancel it, and ask again")
        self._job = self._job_of(goal)
        return self._job

    async def run(self, job: PlanningJob, feed_back: FeedBack = lambda done, total, cost: None) -> Planned:
        """Make the plan of a job that was begun; a plan that reaches its target is published.

        Raises:
            EgophysError: there is none.
            CanceledError: someone asked to stop.
        """
        try:
            problem = await self._worker.run(job.prepare)
            self._topics.publish_problem(job, problem)
            plan, initial_cost = await self._worker.run(
                partial(job.run, problem, self._forward(job, problem), feed_back)
            )
        finally:
            self._job = None
        planned = Planned(
            plan=plan_message(plan, self._node.get_clock().now().to_msg()),
            initial_cost=initial_cost,
            tolerance=job.options.tolerance_m,
            start=TWIN if job.seen is None else PRESENT,
            why_twin=job.why_twin,
        )
        if planned.reached:
            self._node.last_error = ""
            self._topics.publish_plan(planned.plan)
        return planned

    def cancel(self) -> bool:
        """Ask the plan that is being made to stop; False if none is."""
        if self._job is None:
            return False
        self._job.canceled.set()
        return True

    def stop(self) -> None:
        """Cancel, and wait until nothing runs."""
        self.cancel()
        self._worker.stop()
        self._object.stop()

    def _forward(self, job: PlanningJob, problem: PlanningProblem) -> RolloutClient:
        return RolloutClient(
            self._rollouts,
            twin_id=job.twin.twin_id,
            problem=problem,
            service_timeout_s=self._node.get_parameter("service_timeout_s").value,
            answer_timeout_s=self._node.get_parameter("rollout_timeout_s").value,
            canceled=job.canceled,
        )

    def _take_twin(self, message: UInt8MultiArray) -> None:
        try:
            self._twin = decode_twin(bytes(message.data), name=self._model_topic)
        except EgophysError as error:
            self._node.refuse("cannot use the twin received", error)
        else:
            self._object.watch(self._twin)

    def _job_of(self, goal: PlanToTarget.Goal) -> PlanningJob:
        options = read_options(self._node, PlanOptions, goal.options_json)
        if goal.tolerance_m != 0.0:
            options = replace(options, tolerance_m=goal.tolerance_m)
        if self._twin is None:
            raise PlanningError(f"no twin received on {self._model_topic}; is the twin node active, with a twin?")
        if goal.twin_id not in ("", self._twin.twin_id):
            raise PlanningError(f"twin {goal.twin_id} is not in use, {self._twin.twin_id} is; ask for that one")
        has_points = len(goal.target.data) > 0
        if not has_points and not goal.target_source:
            raise PlanningError("the goal has no target: give points in `target`, or a text in `target_source`")
        target = xyz_of_message(goal.target, source="target") if has_points else parse_target(goal.target_source)
        if goal.start not in ("", PRESENT, TWIN):
            raise PlanningError(f"start must be {PRESENT}, {TWIN} or empty, got {goal.start!r}")
        # Who says nothing gets a plan without an observer, but no plan from the twin's shape for an object that is seen
        # and cannot be told now.
        why_twin = "" if goal.start else self._object.why_unknown
        seen = None if goal.start == TWIN or why_twin else self._object.seen()
        return PlanningJob(
            twin=self._twin, options=options, seed=goal.seed, target=target, seen=seen, why_twin=why_twin
        )
