"""The arm that viewers draw is the arm that moves: the URDF's kinematics are the controller's."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from xarm_bridge.kinematics import JOINT_LIMITS, forward

from tests.xarm_bridge.emulator_process import PACKAGE

URDF = PACKAGE / "urdf" / "xarm6.urdf"
LINKS = ["link_base", *(f"link{number}" for number in range(1, 7)), "link_eef"]
JOINTS = [*(f"joint{number}" for number in range(1, 7)), "joint_eef"]


@pytest.fixture(scope="module")
def robot() -> ElementTree.Element:
    return ElementTree.parse(URDF).getroot()


def numbers(element: ElementTree.Element, name: str) -> np.ndarray:
    return np.array(element.get(name).split(), float)


def tip(robot: ElementTree.Element, joints: np.ndarray) -> np.ndarray:
    """[4, 4] pose of link_eef in link_base, metres, along the chain that the file gives."""
    angles = dict(zip(JOINTS, [*joints, 0.0], strict=True))
    by_child = {joint.find("child").get("link"): joint for joint in robot.iter("joint")}
    pose, link = np.eye(4), "link_eef"
    while link in by_child:
        joint = by_child[link]
        origin, step = joint.find("origin"), np.eye(4)
        turn = Rotation.from_euler("xyz", numbers(origin, "rpy"))
        if joint.get("type") == "revolute":
            turn = turn * Rotation.from_rotvec(angles[joint.get("name")] * numbers(joint.find("axis"), "xyz"))
        step[:3, :3], step[:3, 3] = turn.as_matrix(), numbers(origin, "xyz")
        pose, link = step @ pose, joint.find("parent").get("link")
    assert link == "link_base"
    return pose


def test_links_and_joints_are_named_as_the_makers_driver_names_them(robot):
    assert [link.get("name") for link in robot.iter("link")] == LINKS
    assert [joint.get("name") for joint in robot.iter("joint")] == JOINTS
    # Every link but the empty flange frame is drawn, with shapes that need no other file.
    assert [link.get("name") for link in robot.iter("link") if not link.findall("visual")] == ["link_eef"]
    assert not list(robot.iter("mesh"))
    for joint, (lower, upper) in zip(robot.iter("joint"), JOINT_LIMITS, strict=False):
        limit = joint.find("limit")
        assert (float(limit.get("lower")), float(limit.get("upper"))) == pytest.approx((lower, upper), abs=1e-6)


def test_kinematics_are_those_of_the_controller(robot):
    random = np.random.default_rng(0)
    for joints in [np.zeros(6), *random.uniform(*JOINT_LIMITS.T, (200, 6))]:
        drawn, moved = tip(robot, joints), forward(joints)
        np.testing.assert_allclose(drawn[:3, 3], moved.position / 1000, atol=1e-6)
        np.testing.assert_allclose(drawn[:3, :3], moved.rotation.as_matrix(), atol=1e-6)
