"""Rotations from angles."""

import numpy as np
from numpy.typing import NDArray

# The axes of a camera that looks north along the horizon, in the frame east, north, up: right, down, forward.
LEVEL_CAMERA = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def rotation_of_angles(yaw_deg: float, pitch_deg: float, roll_deg: float) -> NDArray[np.float64]:
    """Returns the rotation, in the frame east, north, up, of a body from pointing north: yaw is clockwise from above,
    pitch lifts its front, roll lowers its right side."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler("ZXY", [-yaw_deg, pitch_deg, roll_deg], degrees=True).as_matrix())
