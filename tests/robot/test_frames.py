"""Transforms and rotations: group laws, and xArm's roll-pitch-yaw written out."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from egophys_core.errors import RobotError
from egophys_core.robot import Transform, quaternions_from_rpy, rpy_from_quaternions

angles = st.floats(-np.pi, np.pi)
vectors = arrays(np.float64, 3, elements=st.floats(-5, 5))
transforms = st.builds(Transform.from_rpy, vectors, arrays(np.float64, 3, elements=angles))


def fixed_axes_matrix(roll, pitch, yaw):
    """R = Rz(yaw) Ry(pitch) Rx(roll), from the definition."""
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(a), np.sin(a)) for a in (roll, pitch, yaw))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


@given(angles, angles, angles)
def test_rpy_is_xarms_convention(roll, pitch, yaw):
    rotation = Transform.from_rpy(np.zeros(3), np.array([roll, pitch, yaw])).rotation
    np.testing.assert_allclose(rotation, fixed_axes_matrix(roll, pitch, yaw), atol=1e-12)


@given(transforms)
def test_rpy_and_quaternion_give_the_rotation_back(transform):
    # Near pitch = +-90 degrees arcsin loses half of the digits: 1e-7 is sqrt of the float64 resolution.
    np.testing.assert_allclose(fixed_axes_matrix(*transform.rpy), transform.rotation, atol=1e-7)
    again = Transform.from_quaternion(transform.translation, transform.quaternion)
    np.testing.assert_allclose(again.rotation, transform.rotation, atol=1e-12)


@given(arrays(np.float64, (4, 3), elements=st.floats(-1.5, 1.5)))
def test_arrays_of_rotations_convert_both_ways(rpy):
    np.testing.assert_allclose(rpy_from_quaternions(quaternions_from_rpy(rpy)), rpy, atol=1e-9)


@given(transforms, transforms, vectors)
def test_composition_applies_the_right_one_first(first, second, point):
    np.testing.assert_allclose((second @ first).apply(point), second.apply(first.apply(point)), atol=1e-9)


@given(transforms, vectors)
def test_the_inverse_undoes(transform, point):
    np.testing.assert_allclose(transform.inverse().apply(transform.apply(point)), point, atol=1e-9)


@pytest.mark.parametrize(
    ("rotation", "translation", "reason"),
    [
        (np.diag([1.0, 1.0, -1.0]), np.zeros(3), "no rotation"),
        (2 * np.eye(3), np.zeros(3), "no rotation"),
        (np.full((3, 3), np.nan), np.zeros(3), "not finite"),
        (np.eye(2), np.zeros(3), r"rotation \[3, 3\]"),
    ],
)
def test_what_is_no_rigid_motion_is_refused(rotation, translation, reason):
    with pytest.raises(RobotError, match=reason):
        Transform(rotation=rotation, translation=translation)


@pytest.mark.parametrize("quaternion", [[0, 0, 0, 0], [0, 0, np.nan, 1], [0, 0, 1]])
def test_a_quaternion_without_direction_is_refused(quaternion):
    with pytest.raises(RobotError, match="quaternion must be"):
        Transform.from_quaternion(np.zeros(3), np.array(quaternion, dtype=float))
