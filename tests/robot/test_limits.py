"""Plans are judged before anything moves; every refusal names the waypoint, the value and the limit."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from egophys_core.errors import OptionsError, RobotError
from egophys_core.robot import MotionLimits, PlannedPath, StraightMove, Transform, check_plan
from egophys_core.waypoint_plan import WaypointPlan

LIMITS = MotionLimits(workspace_min_m=(0.2, -0.4, 0.0), workspace_max_m=(0.7, 0.4, 0.5))
WORLD_TO_BASE = Transform(rotation=np.eye(3), translation=np.array([0.45, 0.0, 0.0]))
DOWN = np.array([1.0, 0.0, 0.0, 0.0])
PLAN = WaypointPlan(
    times=np.array([0.0, 1.0, 2.0]),
    positions=np.array([[0.0, 0.0, 0.1], [0.1, 0.0, 0.1], [0.1, 0.1, 0.1]]),
    quaternions=np.tile(DOWN, (3, 1)),
    gripper_opening=np.array([0.08, 0.08, 0.0]),
    twin_id="",
    predicted_cost=0.0,
)


def changed(**arrays_by_name):
    """The good plan with one entry replaced: `times=(index, value)`."""
    fields = {}
    for name, (index, value) in arrays_by_name.items():
        fields[name] = getattr(PLAN, name).copy()
        fields[name][index] = value
    return dataclasses.replace(PLAN, **fields)


def test_a_good_plan_passes():
    check_plan(PLAN, LIMITS, WORLD_TO_BASE)


@pytest.mark.parametrize(
    ("plan", "reason"),
    [
        (changed(positions=(2, [0.1, np.nan, 0.1])), r"waypoint 2: position .* is not finite"),
        (changed(times=(1, np.inf)), "waypoint 1: time inf is not finite"),
        (changed(quaternions=(1, [np.nan, 0, 0, 0])), "waypoint 1: quaternion .* not finite"),
        (changed(gripper_opening=(0, np.nan)), "waypoint 0: gripper opening nan"),
        (changed(quaternions=(1, [1.0, 1.0, 0, 0])), r"waypoint 1 \(t=1.00 s\): quaternion .* length 1.4142"),
        (changed(gripper_opening=(1, 80.0)), r"waypoint 1 .*80.0000 m is outside 0 \.\. 0.085 m"),
        (changed(gripper_opening=(1, -0.01)), "waypoint 1 .*outside"),
        (changed(times=(1, 0.0)), r"waypoint 1 .*0.0000 s after"),
        (changed(times=(2, 0.5)), r"waypoint 2 .*-0.5000 s after"),
        (changed(times=(0, -1.0)), "waypoint 0: time -1.000 s is before"),
        (
            changed(positions=(1, [0.3, 0.0, 0.1])),
            r"waypoint 1 .*x = 0.750 m is outside the workspace 0.200 \.\. 0.700",
        ),
        (changed(positions=(0, [0.0, 0.0, -0.01])), r"waypoint 0 .*z = -0.010 m"),
        (changed(times=(1, 0.1)), r"waypoint 1 .*speed 1.000 m/s exceeds 0.25 m/s; .*factor of 4.00"),
        (changed(quaternions=(1, [0.0, 1.0, 0.0, 0.0])), r"waypoint 1 .*angular speed 3.142 rad/s"),
        (changed(quaternions=(1, [0.0, 0.0, 0.0, 1.0])), "waypoints? .*tilted by .* from straight down, at most 1.0"),
    ],
)
def test_a_bad_waypoint_is_named(plan, reason):
    with pytest.raises(RobotError, match=reason):
        check_plan(plan, LIMITS, WORLD_TO_BASE)


def test_the_table_may_lie_higher_than_the_box():
    with pytest.raises(RobotError, match=r"waypoint 0 .*z = 0.100 m above the table is lower than 0.110 m"):
        check_plan(PLAN, dataclasses.replace(LIMITS, table_clearance_m=0.11), WORLD_TO_BASE)


def test_waypoints_far_apart_are_named():
    with pytest.raises(RobotError, match=r"waypoint 1 .*0.100 m from the waypoint before it, at most 0.05 m"):
        check_plan(PLAN, dataclasses.replace(LIMITS, max_step_m=0.05), WORLD_TO_BASE)


def test_a_tool_that_tips_over_between_upright_waypoints_is_noticed():
    """Both ends are tilted by 0.9 rad; half-way it is 1.32 rad."""
    first = Rotation.from_euler("x", 0.9) * Rotation.from_quat(DOWN)
    last = Rotation.from_euler("ZXZ", [1.8, 0.9, 1.8]) * Rotation.from_quat(DOWN)
    quaternions = np.array([first.as_quat(), *[last.as_quat()] * 2])
    plan = dataclasses.replace(PLAN, times=PLAN.times * 4, quaternions=quaternions)
    check_plan(plan, dataclasses.replace(LIMITS, max_tilt_rad=1.33), WORLD_TO_BASE)
    with pytest.raises(RobotError, match=r"between waypoints 0 and 1: the tool is tilted by 1.3\d+ rad"):
        check_plan(plan, LIMITS, WORLD_TO_BASE)


def test_sudden_turns_are_too_much_acceleration():
    slow = dataclasses.replace(LIMITS, max_acceleration_m_s2=0.05)
    with pytest.raises(RobotError, match=r"waypoint 0 .*acceleration 0.100 m/s\^2 exceeds 0.05"):
        check_plan(PLAN, slow, WORLD_TO_BASE)


def test_the_suggested_stretch_is_enough():
    fast = dataclasses.replace(PLAN, times=PLAN.times * 0.1)
    with pytest.raises(RobotError, match=r"factor of (\S+)") as refusal:
        check_plan(fast, LIMITS, WORLD_TO_BASE)
    factor = float(str(refusal.value).split("factor of ")[1].split()[0])
    check_plan(dataclasses.replace(PLAN, times=fast.times * (factor + 0.01)), LIMITS, WORLD_TO_BASE)


def test_a_plan_of_one_waypoint_passes():
    one = WaypointPlan(
        times=np.zeros(1),
        positions=np.zeros((1, 3)),
        quaternions=DOWN[None],
        gripper_opening=np.zeros(1),
        twin_id="",
        predicted_cost=0.0,
    )
    check_plan(one, LIMITS, WORLD_TO_BASE)
    assert PlannedPath(one).duration == 0


@given(
    arrays(np.float64, (2, 3), elements=st.floats(0, 1)),
    st.floats(0, 1),
)
def test_between_two_points_of_the_box_one_is_inside(shares, share):
    """The reason why checking waypoints is enough."""
    low, high = np.array(LIMITS.workspace_min_m), np.array(LIMITS.workspace_max_m)
    first, second = low + shares * (high - low)
    between = np.clip(first + share * (second - first), np.minimum(first, second), np.maximum(first, second))
    tool = WORLD_TO_BASE.inverse() @ Transform.from_quaternion(between, DOWN)
    assert dataclasses.replace(LIMITS, table_clearance_m=-0.05).why_not(tool, WORLD_TO_BASE) is None


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"workspace_max_m": (0.1, 0.4, 0.5)}, "empty along x"),
        ({"workspace_min_m": (0.2, np.nan, 0.0)}, "3 finite numbers"),
        ({"max_speed_m_s": 0.0}, r"max_speed_m_s must be in 0.005 \.\. 0.5"),
        ({"max_speed_m_s": np.nan}, "max_speed_m_s must be in"),
    ],
)
def test_impossible_limits_are_refused(fields, reason):
    with pytest.raises(OptionsError, match=reason):
        dataclasses.replace(LIMITS, **fields)


def test_limits_from_a_file(tmp_path):
    path = tmp_path / "limits.yaml"
    path.write_text("workspace_min_m: [0, -1, 0]\nworkspace_max_m: [1, 1, 1]\nmax_speed_m_s: 0.1\n")
    assert MotionLimits.load(path).max_speed_m_s == 0.1
    path.write_text("workspace_min_m: [0, -1, 0]\nworkspace_max_m: [1, 1, 1]\nmax_speed: 0.1\n")
    with pytest.raises(OptionsError, match="did you mean 'max_speed_m_s'"):
        MotionLimits.load(path)


@pytest.mark.parametrize(
    ("content", "error", "reason"),
    [
        ("5: 1", OptionsError, "unknown option 5;"),
        ("null: 3", OptionsError, "unknown option None;"),
        ("bridge_node:\n  ros__parameters:", RobotError, "ros__parameters must hold 'key: value' lines, got None"),
        ("bridge_node:\n  ros__parameters: [1]", RobotError, r"ros__parameters must hold .* got \[1\]"),
    ],
)
def test_files_without_names_of_limits_are_refused(tmp_path, content, error, reason):
    (tmp_path / "limits.yaml").write_text(content)
    with pytest.raises(error, match=reason):
        MotionLimits.load(tmp_path / "limits.yaml")


def test_what_the_bridge_has_under_keys_that_are_no_text_is_passed_over(tmp_path):
    (tmp_path / "bridge.yaml").write_text("bridge_node:\n  ros__parameters:\n    5: 1\n    max_speed_m_s: 1e-1\n")
    assert MotionLimits.load(tmp_path / "bridge.yaml").max_speed_m_s == 0.1


def test_the_path_is_linear_and_holds_the_gripper():
    path = PlannedPath(PLAN)
    np.testing.assert_allclose(path.pose_at(0.25).translation, [0.025, 0.0, 0.1])
    np.testing.assert_allclose(path.pose_at(99.0).translation, PLAN.positions[-1])
    np.testing.assert_allclose(path.pose_at(-1.0).translation, PLAN.positions[0])
    assert [path.opening_at(time) for time in (-1.0, 0.0, 1.99, 2.0)] == [0.08, 0.08, 0.08, 0.0]


def test_the_approach_keeps_the_limits():
    start = Transform.from_rpy(np.array([0.3, 0.1, 0.2]), np.array([np.pi, 0.0, 0.0]))
    goal = Transform.from_rpy(np.array([0.5, -0.2, 0.1]), np.array([np.pi, 0.0, 1.0]))
    move = StraightMove(start, goal, LIMITS)
    times = np.linspace(0, move.duration, 2001)
    points = np.array([move.pose_at(time).translation for time in times])
    speeds = np.linalg.norm(np.diff(points, axis=0), axis=1) / np.diff(times)
    assert speeds.max() <= LIMITS.max_speed_m_s * (1 + 1e-6)
    assert speeds[0] < 1e-3
    np.testing.assert_allclose(points[-1], goal.translation, atol=1e-12)
    np.testing.assert_allclose(move.pose_at(move.duration).rotation, goal.rotation, atol=1e-12)
    assert StraightMove(start, start, LIMITS).pose_at(0.0).translation == pytest.approx(start.translation)
