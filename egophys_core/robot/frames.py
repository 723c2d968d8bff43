"""Rigid transforms and rotation conversions: quaternions x y z w, matrices, roll-pitch-yaw."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.errors import RobotError

ORTHONORMAL_TOLERANCE = 1e-6
"""Largest entry of R^T R - I that still counts as a rotation; float64 products stay far below."""

FIXED_AXES = "xyz"
"""scipy's name (lower case: extrinsic) for xArm's convention, R = Rz(yaw) Ry(pitch) Rx(roll)."""


@dataclass(frozen=True, kw_only=True)
class Transform:
    """Rigid motion p -> R p + t; also the pose of a frame, read as the motion from it to its parent."""

    rotation: np.ndarray
    """[3, 3] float64, orthonormal, determinant +1."""
    translation: np.ndarray
    """[3] float64, metres."""

    def __post_init__(self) -> None:
        rotation = np.asarray(self.rotation, dtype=np.float64)
        translation = np.asarray(self.translation, dtype=np.float64)
        if rotation.shape != (3, 3) or translation.shape != (3,):
            raise RobotError(
                f"a transform needs a rotation [3, 3] and a translation [3], "
                f"got {rotation.shape} and {translation.shape}"
            )
        if not (np.isfinite(rotation).all() and np.isfinite(translation).all()):
            raise RobotError(f"transform is not finite: rotation {rotation.tolist()}, {translation.tolist()}")
        skew = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
        if skew > ORTHONORMAL_TOLERANCE or np.linalg.det(rotation) < 0:
            raise RobotError(
                f"matrix {rotation.tolist()} is no rotation (off by {skew:.1e}, "
                f"determinant {np.linalg.det(rotation):.3f})"
            )
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation", translation)

    @classmethod
    def identity(cls) -> "Transform":
        """The transform that changes nothing."""
        return cls(rotation=np.eye(3), translation=np.zeros(3))

    @classmethod
    def from_quaternion(cls, translation: np.ndarray, quaternion: np.ndarray) -> "Transform":
        """From a translation [3] in metres and a quaternion [4] x y z w; its length is normalised away.

        Raises:
            RobotError: a number is not finite or the quaternion is zero.
        """
        quaternion = np.asarray(quaternion, dtype=np.float64)
        if quaternion.shape != (4,) or not np.isfinite(quaternion).all() or not quaternion.any():
            raise RobotError(f"quaternion must be four finite numbers x y z w, not all 0, got {quaternion}")
        return cls(rotation=Rotation.from_quat(quaternion).as_matrix(), translation=translation)

    @classmethod
    def from_rpy(cls, translation: np.ndarray, rpy: np.ndarray) -> "Transform":
        """From a translation [3] in metres and roll, pitch, yaw [3] in radians (fixed axes x, y, z)."""
        return cls(rotation=Rotation.from_euler(FIXED_AXES, rpy).as_matrix(), translation=translation)

    @property
    def quaternion(self) -> np.ndarray:
        """[4] float64 unit quaternion, x y z w."""
        return Rotation.from_matrix(self.rotation).as_quat()

    @property
    def rpy(self) -> np.ndarray:
        """[3] float64 roll, pitch, yaw in radians; at pitch = +-90 degrees one of many equal choices."""
        return rpy_from_quaternions(self.quaternion)

    def __matmul__(self, other: "Transform") -> "Transform":
        """`self @ other` applies `other` first."""
        return Transform(
            rotation=self.rotation @ other.rotation,
            translation=self.rotation @ other.translation + self.translation,
        )

    def inverse(self) -> "Transform":
        """The transform that undoes this one."""
        return Transform(rotation=self.rotation.T, translation=-self.rotation.T @ self.translation)

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Points [..., 3] in metres, moved."""
        return np.asarray(points, dtype=np.float64) @ self.rotation.T + self.translation


def rpy_from_quaternions(quaternions: np.ndarray) -> np.ndarray:
    """Roll, pitch, yaw [..., 3] in radians (fixed axes x, y, z) of quaternions [..., 4] x y z w.

    At pitch = +-90 degrees only roll -+ yaw is determined; yaw is then returned as 0.
    """
    quaternions = np.asarray(quaternions, dtype=np.float64)
    with np.errstate(all="ignore"):
        angles = Rotation.from_quat(quaternions.reshape(-1, 4)).as_euler(FIXED_AXES)
    return angles.reshape(*quaternions.shape[:-1], 3)


def quaternions_from_rpy(rpy: np.ndarray) -> np.ndarray:
    """Quaternions [..., 4] x y z w of roll, pitch, yaw [..., 3] in radians (fixed axes x, y, z)."""
    rpy = np.asarray(rpy, dtype=np.float64)
    return Rotation.from_euler(FIXED_AXES, rpy.reshape(-1, 3)).as_quat().reshape(*rpy.shape[:-1], 4)
