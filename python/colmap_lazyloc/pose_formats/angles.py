"""Rotations from angles in degrees."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

# The axes of a camera that looks north along the horizon, in the frame east, north, up: right, down, forward.
LEVEL_CAMERA = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def yaw_pitch_roll(angles_deg: ArrayLike) -> NDArray[np.float64]:
    """Returns the rotation, in the frame east, north, up, of a body from pointing north: yaw is clockwise from above,
    pitch lifts its front, roll lowers its right side."""
    yaw, pitch, roll = np.asarray(angles_deg, float).tolist()
    return _rotation("ZXY", [-yaw, pitch, roll])


def omega_phi_kappa(angles_deg: ArrayLike) -> NDArray[np.float64]:
    """Returns the rotation of photogrammetry, Rx(omega) Ry(phi) Rz(kappa): at 0 a camera looks down, its top north."""
    return _rotation("XYZ", angles_deg)


def _rotation(axes: str, angles_deg: ArrayLike) -> NDArray[np.float64]:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler(axes, angles_deg, degrees=True).as_matrix())
