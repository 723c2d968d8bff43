"""What a waypoint plan does to the controller points."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egophys_core.errors import PlanningError
from egophys_core.planning import Grasp, controls_of_plan, grasp_from_points
from egophys_core.waypoint_plan import WaypointPlan

DOWN = np.array([1.0, 0.0, 0.0, 0.0])


def plan(times, positions, opening, quaternions=None) -> WaypointPlan:
    return WaypointPlan(
        times=np.array(times, float),
        positions=np.array(positions, float),
        quaternions=np.tile(DOWN, (len(times), 1)) if quaternions is None else np.array(quaternions, float),
        gripper_opening=np.array(opening, float),
        twin_id="",
        predicted_cost=float("nan"),
    )


def lift() -> WaypointPlan:
    """Down, close, and from 1 s on 0.3 m up and 0.1 m along x within a second."""
    return plan([0, 0.5, 1, 2], [[0, 0, 0.1], [0, 0, 0], [0, 0, 0], [0.1, 0, 0.3]], [0.08, 0, 0, 0])


GRASP = Grasp(position=np.zeros(3), controllers=np.array([[0.01, 0, 0], [0, 0.02, 0]]))


def test_controls_start_when_the_gripper_closes_and_end_with_the_plan():
    controls = controls_of_plan(lift(), GRASP)
    assert controls.times[0] == 0.0
    assert controls.times[-1] == pytest.approx(1.5)
    assert np.diff(controls.times) == pytest.approx(1 / 30)


def test_points_move_linearly_between_waypoints_and_turn_with_the_tool():
    controls = controls_of_plan(lift(), GRASP)
    # Half a turn about x: the tool's y axis points to -y.
    assert controls.positions[0] == pytest.approx(np.array([[0.01, 0, 0], [0, -0.02, 0]]), abs=1e-7)
    middle = int(np.argmin(np.abs(controls.times - 1.0)))
    assert controls.positions[middle, 0] == pytest.approx([0.06, 0, 0.15], abs=1e-6)
    assert controls.positions[-1, 0] == pytest.approx([0.11, 0, 0.3], abs=1e-6)


def test_rotation_is_interpolated_at_constant_rate():
    quaternions = [DOWN, DOWN, (Rotation.from_euler("z", 90, degrees=True) * Rotation.from_quat(DOWN)).as_quat()]
    turning = plan([0, 1, 2], np.zeros((3, 3)), [0, 0, 0], quaternions)
    controls = controls_of_plan(turning, GRASP)
    # A third of the way through the second second: 30 degrees.
    frame = int(np.argmin(np.abs(controls.times - 4 / 3)))
    assert controls.positions[frame, 0] == pytest.approx(
        [0.01 * np.cos(np.pi / 6), 0.01 * np.sin(np.pi / 6), 0], abs=1e-6
    )


def test_gripper_is_as_its_last_passed_waypoint_says():
    opens = plan([0, 1, 2, 3], np.zeros((4, 3)), [0.08, 0.0, 0.08, 0.0])
    controls = controls_of_plan(opens, GRASP)
    held = controls.contact[:, 0]
    assert np.array_equal(held, controls.contact[:, 1])
    # Closed from 1 s to 2 s, open until 3 s, closed again at the very end.
    assert held[controls.times < 1.0 - 1e-6].all()
    assert not held[(controls.times > 1.0 + 1e-6) & (controls.times < 2.0 - 1e-6)].any()
    assert held[-1]


def test_last_frame_is_not_before_the_end_of_the_plan():
    odd = plan([0, 1.01], [[0, 0, 0], [0.1, 0, 0]], [0, 0])
    controls = controls_of_plan(odd, GRASP)
    assert 1.01 <= controls.times[-1] < 1.01 + 1 / 30
    assert controls.positions[-1, 0, 0] == pytest.approx(0.11, abs=1e-6)


@pytest.mark.parametrize(
    ("bad", "text"),
    [
        (dataclasses.replace(lift(), positions=np.full((4, 3), np.nan)), "finite poses"),
        (dataclasses.replace(lift(), quaternions=np.full((4, 4), np.inf)), "finite poses"),
        (plan([0], [[0, 0, 0]], [0]), "at least 2 waypoints"),
        (plan([0, 1, 1, 2], np.zeros((4, 3)), [0, 0, 0, 0]), r"does not increase at waypoint 2 \(t=1 s\)"),
        (plan([0, 1, np.nan, 2], np.zeros((4, 3)), [0, 0, 0, 0]), "plan"),
        (plan([0, 1], np.zeros((2, 3)), [0.08, 0.08]), "gripper never closes"),
        (plan([0, 1], np.zeros((2, 3)), [0.08, 0.0]), "gripper never closes before the last waypoint"),
        (plan([0, 1], np.zeros((2, 3)), [np.nan, np.nan]), "gripper never closes"),
    ],
)
def test_plans_that_cannot_be_simulated_are_refused(bad, text):
    with pytest.raises(PlanningError, match=text):
        controls_of_plan(bad, GRASP)


def test_quaternion_of_length_zero_is_refused():
    zero = dataclasses.replace(lift(), quaternions=np.zeros((4, 4)))
    with pytest.raises(PlanningError, match="quaternion"):
        controls_of_plan(zero, GRASP)


@pytest.mark.parametrize("name", ["positions", "quaternions", "gripper_opening"])
def test_lists_of_other_lengths_are_refused(name):
    good = lift()
    with pytest.raises(PlanningError, match=f"plan {name} must be .* for 4 waypoints"):
        dataclasses.replace(good, **{name: getattr(good, name)[:-1]})
    with pytest.raises(PlanningError, match="at least one waypoint"):
        plan([], np.zeros((0, 3)), [])


def test_grasp_reproduces_the_points_of_the_hand():
    points = np.array([[0.1, 0.2, 0.05], [0.12, 0.2, 0.05], [0.11, 0.23, 0.06]], np.float32)
    grasp = grasp_from_points(points)
    assert grasp.position == pytest.approx(points.mean(axis=0))
    still = plan([0, 1], [grasp.position] * 2, [0, 0])
    assert controls_of_plan(still, grasp).positions[0] == pytest.approx(points, abs=1e-6)
    with pytest.raises(PlanningError, match="the twin has no grasp"):
        grasp_from_points(np.zeros((0, 3), np.float32))
