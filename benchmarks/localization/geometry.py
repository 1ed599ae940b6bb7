"""Poses and their errors."""

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation


@dataclasses.dataclass(frozen=True)
class Pose:
    """cam_from_world: x_cam = rotation x_world + translation."""

    rotation: np.ndarray
    translation: np.ndarray

    @staticmethod
    def from_qvec_tvec(qvec, tvec) -> "Pose":
        """`qvec` is w, x, y, z."""
        return Pose(Rotation.from_quat(qvec, scalar_first=True).as_matrix(), np.asarray(tvec, dtype=float))

    @staticmethod
    def from_rigid3d(cam_from_world) -> "Pose":
        """From pycolmap's type."""
        return Pose(cam_from_world.rotation.matrix(), np.array(cam_from_world.translation))

    def qvec(self) -> np.ndarray:
        return Rotation.from_matrix(self.rotation).as_quat(scalar_first=True)

    def cam_in_world(self) -> np.ndarray:
        return -self.rotation.T @ self.translation


def pose_errors(pose: Pose, true_pose: Pose) -> tuple[float, float]:
    """Distance of the projection centres in the scene's unit, angle between the rotations in degrees."""
    position_error = np.linalg.norm(pose.cam_in_world() - true_pose.cam_in_world())
    # The rotation vector keeps its precision for small angles, where the arc cosine of the trace does not.
    angle_rad = Rotation.from_matrix(pose.rotation @ true_pose.rotation.T).magnitude()
    return float(position_error), float(np.degrees(angle_rad))
