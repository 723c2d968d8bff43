"""Plans on an arm that is not the xArm6, where only sleep moves time on. A driver is all it needs."""

import itertools
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.errors import ArmFaultError, ArmLostError, RobotError
from egophys_core.robot import ArmDriver, Calibration, Clock, MotionLimits, PlanExecutor, Transform, load_driver
from egophys_core.robot.stream_guard import StreamGuard
from egophys_core.waypoint_plan import WaypointPlan
from tests.robot.second_arm import SecondArm

CALIBRATION = Calibration(
    world_to_base=Transform(rotation=np.eye(3), translation=np.array([0.45, 0.0, 0.0])),
    tool=Transform(rotation=np.eye(3), translation=np.array([0.0, 0.0, 0.172])),
)
PLAN = WaypointPlan(
    times=np.array([0.0, 1.0, 2.0]),
    positions=np.array([[0.0, 0.0, 0.1], [0.1, 0.0, 0.1], [0.1, 0.1, 0.1]]),
    quaternions=np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)),
    gripper_opening=np.array([0.08, 0.08, 0.0]),
    twin_id="",
    predicted_cost=0.0,
)
numbers = itertools.count()


class Unfinished(SecondArm):
    halt = ArmDriver.halt


class Time:
    """Moved on by sleeping, and by who wants a stall."""

    def __init__(self):
        self.now = 0.0

    def sleep(self, seconds):
        self.now += seconds

    def clock(self):
        return Clock(now=lambda: self.now, sleep=self.sleep)


@pytest.fixture
def arm():
    driver = load_driver("tests.robot.second_arm:SecondArm", f"arm{next(numbers)}")
    driver.connect()
    return driver


def executor(arm, time=None, **options):
    clock = (time or Time()).clock()
    return PlanExecutor(arm, calibration=CALIBRATION, limits=MotionLimits(), clock=clock, **options)


def test_a_second_arm_follows_a_plan(arm):
    executed = executor(arm).execute(PLAN)
    assert executed.completed
    tools = np.array([CALIBRATION.tool_in_world(pose).translation for pose in arm.streamed])
    for waypoint in PLAN.positions:
        assert np.linalg.norm(tools - waypoint, axis=1).min() < 1e-3
    steps = np.linalg.norm(np.diff(tools, axis=0), axis=1)
    assert steps.max() < 1.001 * 0.25 * 0.005, "no faster than allowed, at the arm's own period"
    assert arm.opening == 0.0
    assert not arm.is_streaming


def test_after_a_short_stall_the_plan_goes_on_late_and_after_a_long_one_it_ends(arm):
    time = Time()
    stalls = iter([0.4])

    def stall(share, pose):
        time.now += next(stalls, 0.0)

    assert executor(arm, time).execute(PLAN, on_progress=stall).completed
    tools = np.array([CALIBRATION.tool_in_world(pose).translation for pose in arm.streamed])
    assert np.linalg.norm(np.diff(tools, axis=0), axis=1).max() <= 0.25 * 0.02 + 1e-9, "no jump after the stall"
    stalls = iter([3.0])
    with pytest.raises(RobotError, match=r"held the stream of poses up for 3.0 s"):
        executor(arm, time).execute(PLAN, on_progress=stall)
    assert not arm.is_streaming, "halted"


def test_after_a_long_stall_not_one_pose_more_is_streamed(arm):
    time, streamed = Time(), []

    def stall():
        if len(arm.streamed) == 100:
            time.now += 3.0
            streamed.append(len(arm.streamed))

    with pytest.raises(RobotError, match=r"held the stream of poses up for 3.0 s"):
        executor(arm, time, require_permit=stall).execute(PLAN)
    assert streamed == [100]
    assert len(arm.streamed) == 100


@pytest.mark.parametrize(
    ("what", "error", "reason"),
    [
        ({"error": 7}, ArmFaultError, "error 7 of the second arm"),
        ({"is_lost": True}, ArmLostError, "no answer from arm"),
        ({"is_streaming": False}, RobotError, "the arm was halted"),
    ],
)
def test_what_the_arm_says_ends_the_plan(arm, what, error, reason):
    def happen(share, pose):
        if share > 0.5:
            vars(arm).update(what)

    with pytest.raises(error, match=reason):
        executor(arm).execute(PLAN, on_progress=happen)


def test_without_a_permit_no_pose_is_streamed(arm):
    def refuse():
        raise RobotError("another process owns the arm")

    with pytest.raises(RobotError, match="another process"):
        executor(arm, require_permit=refuse).execute(PLAN)
    assert arm.streamed == []


@pytest.mark.parametrize(
    ("place", "reason"),
    [
        ([0.0, 0.0, 0.104], None),
        ([0.0, 0.0, 0.106], "0.0060 m from the pose before"),
        ([0.0, 0.0, -0.003], "outside the workspace"),
        ([np.nan, 0.0, 0.1], "outside the workspace"),
    ],
)
def test_the_last_look_before_the_arm_knows_nothing_of_plans(place, reason):
    def tool(place):
        rotation = Transform.from_rpy(np.zeros(3), np.array([np.pi, 0.0, 0.0])).rotation
        return SimpleNamespace(rotation=rotation, translation=np.array(place))

    guard = StreamGuard(MotionLimits(), CALIBRATION.world_to_base, tool([0.0, 0.0, 0.1]), 0.005)
    with pytest.raises(RobotError, match=reason) if reason else nullcontext():
        guard.check(tool(place))


def test_an_arm_at_the_very_edge_of_its_box_can_leave_it(arm):
    edge = replace(PLAN, positions=np.array([[0.1, 0.0, 0.1], [0.2, 0.0, 0.1], [0.2, 0.0, 0.1]]))
    assert executor(arm).execute(edge).completed
    arm.tcp = Transform(rotation=arm.tcp.rotation, translation=arm.tcp.translation + [1e-4, 0.0, 0.0])
    assert executor(arm).execute(PLAN).completed
    arm.tcp = Transform(rotation=arm.tcp.rotation, translation=np.array([0.66, 0.0, 0.3]))
    with pytest.raises(RobotError, match=r"the tool now stands where x = 0.660 m is outside"):
        executor(arm).execute(PLAN)


def test_a_tool_that_would_tip_over_on_the_way_to_the_first_waypoint_stays_where_it_is(arm):
    """Both ends are tilted by 0.9 rad; half-way it would be 1.32 rad."""
    down = Rotation.from_quat(PLAN.quaternions[0])
    first, last = (Rotation.from_euler("ZXZ", [angle, 0.9, angle]) * down for angle in (0.0, 1.8))
    plans = [replace(PLAN, quaternions=np.tile(each.as_quat(), (3, 1))) for each in (first, last)]
    assert executor(arm).execute(plans[0]).completed
    streamed = len(arm.streamed)
    with pytest.raises(RobotError, match=r"on the way to waypoint 0: the tool is tilted by 1.32\d\d rad"):
        executor(arm).execute(plans[1])
    assert len(arm.streamed) == streamed


def test_what_is_beyond_reach_is_refused_between_waypoints_too(arm):
    limits = MotionLimits(workspace_min_m=(-1.0, -1.0, 0.0), workspace_max_m=(1.0, 1.0, 1.0), max_step_m=2.0)
    through = replace(
        PLAN,
        times=np.array([0.0, 20.0, 40.0]),
        positions=np.array([[-0.45, -0.65, 0.1], [-0.45, 0.65, 0.1], [-0.45, 0.65, 0.2]]),
    )
    arm.tcp = Transform.from_rpy(np.array([0.0, -0.6, 0.3]), np.array([np.pi, 0.0, 0.0]))
    assert PlanExecutor(arm, calibration=CALIBRATION, limits=limits, clock=Time().clock()).execute(through).completed
    far = replace(through, positions=through.positions + [0.8, 0.0, 0.0])
    with pytest.raises(RobotError, match=r"waypoint 0 .*cannot reach"):
        PlanExecutor(arm, calibration=CALIBRATION, limits=limits, clock=Time().clock()).execute(far)


@pytest.mark.parametrize(
    "name", ["nowhere:Arm", "tests.robot.second_arm:Nobody", "tests.robot.second_arm:REACH_M", "", "..:x"]
)
def test_what_is_no_driver_is_named(name):
    with pytest.raises(RobotError, match=r"driver|subclass"):
        load_driver(name, "here")


def test_a_driver_that_lacks_a_method_is_named():
    with pytest.raises(RobotError, match=r"test_execution:Unfinished lacks halt"):
        load_driver(f"{__name__}:Unfinished", "here")
