"""Forward and inverse kinematics of the xArm6. Millimetres and radians, as on the wire."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

JOINTS = 6

SHOULDER_OFFSET = math.atan2(284.5, 53.5)
"""Joints 2 and 3 are zero where the bent upper arm (53.5 mm forward, 284.5 mm up) stands upright."""

# Modified (Craig) DH parameters of UFACTORY's xArm User Manual, appendix on kinematics:
# alpha, a, d, theta offset.
DH = (
    (0.0, 0.0, 267.0, 0.0),
    (-math.pi / 2, 0.0, 0.0, -SHOULDER_OFFSET),
    (0.0, math.hypot(284.5, 53.5), 0.0, SHOULDER_OFFSET),
    (-math.pi / 2, 77.5, 342.5, 0.0),
    (math.pi / 2, 0.0, 0.0, 0.0),
    (-math.pi / 2, 76.0, 97.0, 0.0),
)

JOINT_LIMITS = np.array(
    [
        (-2 * math.pi, 2 * math.pi),
        (-2.059488, 2.094395),
        (-3.92699, 0.191986),
        (-2 * math.pi, 2 * math.pi),
        (-1.692969, math.pi),
        (-2 * math.pi, 2 * math.pi),
    ]
)
"""[6, 2] radians, xArm User Manual."""

READY_JOINTS = np.array([0.0, -0.4, -1.0, 0.0, 1.4, 0.0])
"""Elbow bent, gripper down: a start for the inverse kinematics far from singular poses, radians."""

ITERATIONS = 60
DAMPING = 1e-3
ANGLE_SCALE = 300.0
"""Millimetres that count as much as one radian: the arm's size, so that errors are comparable."""
LARGEST_STEP = 0.3
POSITION_TOLERANCE = 1e-3
ANGLE_TOLERANCE = 1e-5


@dataclass(frozen=True, slots=True)
class Pose:
    """Pose in the robot base frame."""

    position: np.ndarray
    """[3] millimetres."""
    rotation: Rotation

    @classmethod
    def from_wire(cls, values: tuple[float, ...]) -> "Pose":
        """From x, y, z in millimetres and roll, pitch, yaw in radians (fixed axes)."""
        return cls(np.array(values[:3]), Rotation.from_euler("xyz", values[3:6]))

    def to_wire(self) -> list[float]:
        """x, y, z in millimetres and roll, pitch, yaw in radians."""
        return [*self.position.tolist(), *self.rotation.as_euler("xyz").tolist()]

    def __matmul__(self, other: "Pose") -> "Pose":
        return Pose(self.position + self.rotation.apply(other.position), self.rotation * other.rotation)

    def inverse(self) -> "Pose":
        """The pose of this frame's parent in this frame."""
        back = self.rotation.inv()
        return Pose(-back.apply(self.position), back)


def forward(joints: np.ndarray) -> Pose:
    """Flange pose of joint angles [6] in radians."""
    flange = _joint_frames(joints)[-1]
    return Pose(flange[:3, 3].copy(), Rotation.from_matrix(flange[:3, :3]))


def inverse(goal: Pose, seed: np.ndarray) -> np.ndarray | None:
    """Joint angles [6] whose flange pose is `goal`, near `seed` if it can be reached from there; else None."""
    turned = READY_JOINTS.copy()
    turned[0] = math.atan2(goal.position[1], goal.position[0])
    joints = inverse_near(goal, seed)
    return inverse_near(goal, turned) if joints is None else joints


def inverse_near(goal: Pose, seed: np.ndarray) -> np.ndarray | None:
    """Joint angles [6] whose flange pose is `goal`, found by going there from `seed`; None if that fails.

    Damped least squares (Wampler, IEEE Trans. SMC 16 (1986) 93): the wrist's offset of 76 mm rules out
    the closed form for spherical wrists.
    """
    joints = np.array(seed, dtype=np.float64)
    goal_matrix = goal.rotation.as_matrix()
    for _ in range(ITERATIONS):
        frames = _joint_frames(joints)
        flange = frames[-1]
        error = np.empty(6)
        error[:3] = (goal.position - flange[:3, 3]) / ANGLE_SCALE
        error[3:] = Rotation.from_matrix(goal_matrix @ flange[:3, :3].T).as_rotvec()
        if np.abs(error[:3]).max() * ANGLE_SCALE < POSITION_TOLERANCE and np.abs(error[3:]).max() < ANGLE_TOLERANCE:
            return joints
        axes = np.stack([frame[:3, 2] for frame in frames])
        arms = flange[:3, 3] - np.stack([frame[:3, 3] for frame in frames])
        jacobian = np.vstack([np.cross(axes, arms).T / ANGLE_SCALE, axes.T])
        step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + DAMPING**2 * np.eye(6), error)
        joints = joints + step * min(1.0, LARGEST_STEP / max(np.abs(step).max(), 1e-12))
    return None


def _joint_frames(joints: np.ndarray) -> list[np.ndarray]:
    """Pose [4, 4] of every joint's frame in the base frame; the last is the flange."""
    frames = []
    pose = np.eye(4)
    for (alpha, a, d, offset), angle in zip(DH, joints, strict=True):
        sin_alpha, cos_alpha = math.sin(alpha), math.cos(alpha)
        sin_theta, cos_theta = math.sin(angle + offset), math.cos(angle + offset)
        pose = pose @ np.array(
            [
                [cos_theta, -sin_theta, 0.0, a],
                [sin_theta * cos_alpha, cos_theta * cos_alpha, -sin_alpha, -d * sin_alpha],
                [sin_theta * sin_alpha, cos_theta * sin_alpha, cos_alpha, d * cos_alpha],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )
        frames.append(pose)
    return frames
