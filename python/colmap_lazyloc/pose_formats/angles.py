"""Rotations from angles in degrees, and the angles of rotations."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# The axes of a camera that looks north along the horizon, in the frame east, north, up: right, down, forward.
LEVEL_CAMERA = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


@dataclasses.dataclass(frozen=True)
class Angles:
    """Three turns, each about an axis that the turns before have moved.

    `axes`: three different ones of X, Y and Z; `signs`: -1 for an angle that is clockwise.
    """

    axes: str
    signs: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def rotation(self, angles_deg: ArrayLike) -> Array:
        """Returns the rotation of three angles in degrees."""
        from scipy.spatial.transform import Rotation

        angles = (np.asarray(angles_deg, float) * self.signs).tolist()
        return np.asarray(Rotation.from_euler(self.axes, angles, degrees=True).as_matrix())

    def of(self, rotation: Array) -> Array:
        """Returns the three angles of a rotation in degrees; the second is between -90 and 90.

        The later angles are measured in what the earlier ones leave. So they are exact where the second is 90 degrees,
        too, and the first is arbitrary: RealityCapture's pitch of a camera that looks along the horizon.
        """
        first, second, third = (np.eye(3)["XYZ".index(axis)] for axis in self.axes)
        angles, rest = [], rotation
        for axis, arm, turned in ((first, third, third), (second, third, third), (third, second, second)):
            moved = rest @ turned
            angles.append(float(np.arctan2(moved @ np.cross(axis, arm), moved @ arm)))
            rest = _turn(axis, -angles[-1]) @ rest
        return np.degrees(angles) * self.signs


# Of a body from pointing north, in the frame east, north, up: yaw is clockwise from above, pitch lifts its front, roll
# lowers its right side.
YAW_PITCH_ROLL = Angles("ZXY", (-1.0, 1.0, 1.0))
# Of photogrammetry: at 0 a camera looks down, its top north.
OMEGA_PHI_KAPPA = Angles("XYZ")
# Of GeoPose: a body's axes x forward, y left, z up in the frame east, north, up.
YAW_PITCH_ROLL_ZYX = Angles("ZYX")


def _turn(axis: Array, angle: float) -> Array:
    """Returns the rotation about an axis by an angle in radians."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(angle * axis).as_matrix())
