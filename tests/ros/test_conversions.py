"""Messages <-> the core's types, and options as parameters; no node is started."""

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from egophys_ros_common.conversions import duration_message, plan_message, points_message
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2, PointField

from egophys_core.errors import PlanningError, RecordingError
from egophys_core.recording import decode_points, xyz_of_message
from egophys_core.waypoint_plan import WaypointPlan, plan_of_message

COORDINATES = st.floats(-2, 2, allow_nan=False)
TIMES = st.lists(st.integers(1, 10**12), min_size=1, max_size=5)


def make_plan(times, values):
    count = len(times)
    return WaypointPlan(
        times=np.array(times, np.float64),
        positions=np.resize(values, (count, 3)),
        quaternions=np.resize(values, (count, 4)),
        gripper_opening=np.resize(values, count),
        twin_id="0123456789abcdef",
        predicted_cost=values[0],
    )


def assert_same(one, other):
    for name in ("times", "positions", "quaternions", "gripper_opening"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), strict=True)
    assert (one.twin_id, one.predicted_cost) == (other.twin_id, other.predicted_cost)


@given(TIMES, st.lists(COORDINATES, min_size=1, max_size=9))
def test_a_plan_of_whole_nanoseconds_survives_exactly(nanoseconds, values):
    plan = make_plan(np.cumsum(nanoseconds) / 1e9, values)
    sent = plan_message(plan)
    received = deserialize_message(serialize_message(sent), type(sent))
    assert_same(plan_of_message(received), plan)


@given(st.lists(st.floats(0, 1e4), min_size=1, max_size=5))
def test_any_plan_is_the_same_after_each_further_trip(times):
    once = plan_of_message(plan_message(make_plan(times, [0.1])))
    np.testing.assert_allclose(once.times, times, rtol=0, atol=0.6e-9)
    assert_same(plan_of_message(plan_message(once)), once)


@pytest.mark.parametrize(
    ("seconds", "sec", "nanosec"),
    [(0.0, 0, 0), (1.999_999_999_9, 2, 0), (2.5, 2, 500_000_000), (-0.25, -1, 750_000_000)],
)
def test_a_duration_is_the_nearest_nanosecond(seconds, sec, nanosec):
    assert duration_message(seconds) == Duration(sec=sec, nanosec=nanosec)


def test_a_plan_in_another_frame_is_refused():
    message = plan_message(make_plan([0.0], [0.0]))
    message.header.frame_id = "link_base"
    with pytest.raises(PlanningError, match="'link_base'"):
        plan_of_message(message)


def test_points_are_written_as_recorded():
    xyz = np.array([[0.1, 0.2, 0.3], [np.nan, 0.0, 0.0]], np.float32)
    message = points_message(xyz, ids=np.array([7, 9]), confidence=np.array([0.5, 1.0]))
    decoded = decode_points(serialize_message(message), source="points")
    np.testing.assert_array_equal(decoded.xyz, xyz)
    assert decoded.ids.tolist() == [7, 9]
    assert decoded.confidence.tolist() == [0.5, 1.0]
    assert decoded.frame_id == "world"
    assert not message.is_dense
    np.testing.assert_array_equal(xyz_of_message(message, source="points"), xyz)


def cloud(xyz, *, dtype="<f4", offsets=(0, 4, 8), step=12):
    """A cloud of x, y, z alone, as other software writes it."""
    layout = np.dtype({"names": list("xyz"), "formats": [dtype] * 3, "offsets": offsets, "itemsize": step})
    table = np.zeros(len(xyz), layout)
    for name, values in zip("xyz", xyz.T, strict=True):
        table[name] = values
    message = PointCloud2(height=1, width=len(xyz), point_step=step, is_bigendian=dtype[0] == ">")
    message.header.frame_id = "world"
    message.data = table.tobytes()
    message.row_step = len(message.data)
    message.fields = [
        PointField(name=name, offset=offset, datatype=PointField.FLOAT32, count=1)
        for name, offset in zip("xyz", offsets, strict=True)
    ]
    return message


@pytest.mark.parametrize("layout", [{}, {"dtype": ">f4"}, {"offsets": (8, 0, 4), "step": 32}])
def test_positions_are_read_from_any_layout(layout):
    xyz = np.arange(12, dtype=np.float32).reshape(4, 3)
    np.testing.assert_array_equal(xyz_of_message(cloud(xyz, **layout), source="target"), xyz)


def test_clouds_without_positions_are_refused():
    message = cloud(np.zeros((2, 3)))
    message.fields[2].name = "depth"
    with pytest.raises(RecordingError, match="target: the point cloud has no field z; it has x, y, depth"):
        xyz_of_message(message, source="target")
    message = cloud(np.zeros((2, 3)))
    message.width = 3
    with pytest.raises(RecordingError, match="1 rows of 3 points of 12 bytes"):
        xyz_of_message(message, source="target")
