"""How files write poses. `pose_of` is the one place where a pose in a file becomes a pose with COLMAP's axes, and
`written` the one where it becomes that of a file again."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.pose_formats.angles import LEVEL_CAMERA, OMEGA_PHI_KAPPA, YAW_PITCH_ROLL, YAW_PITCH_ROLL_ZYX
from colmap_lazyloc.poses import Pose

Array = NDArray[np.float64]

DIRECTIONS = ("cam_from_world", "world_from_cam")
QUATERNION_ORDERS = ("wxyz", "xyzw")
# The axes of cameras by name. Columns: COLMAP's axes right, down and forward, in the axes of that name.
CAMERA_AXES: dict[str, Array] = {
    "opencv": np.eye(3),  # x right, y down, z forward: COLMAP's
    "opengl": np.diag([1.0, -1.0, -1.0]),  # x right, y up, z backward
    "body": np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]),  # x forward, y left, z up: of robots
    "frd": np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]),  # x forward, y right, z down: of aircraft
    "rfu": LEVEL_CAMERA,  # x right, y forward, z up
}
MAX_VALUE = 1e12  # of a coordinate in any unit; products of larger ones overflow
MAX_ROTATION_ERROR = 0.01  # of an element of a rotation in a file, which may have few digits


@dataclasses.dataclass(frozen=True)
class Convention:
    """How a file writes a pose.

    `rotation`: what it is written as, a key of ROTATIONS; `quaternion`: the order of its numbers, if it is one.
    `vector`: a translation in the pose's direction, the centre of the camera in the world, or such a centre in degrees,
    which is one whatever the direction.
    """

    direction: str = "cam_from_world"
    camera_axes: str = "opencv"
    rotation: str = "quaternion"
    quaternion: str = "wxyz"
    vector: str = "translation"

    def with_options(self, direction: str | None, camera_axes: str | None, quaternion: str | None) -> "Convention":
        """Returns the convention that the options of the command line give, where they are not None."""
        if quaternion is not None and self.rotation != "quaternion":
            raise InputError(f"--quaternion_order {quaternion}: the file has no quaternions")
        convention = self
        if direction is not None:  # of rotation and vector
            vector = self.vector if self.vector == "degrees" else "translation"
            convention = dataclasses.replace(self, direction=direction, vector=vector)
        return dataclasses.replace(
            convention,
            camera_axes=camera_axes or self.camera_axes,
            quaternion=quaternion or self.quaternion,
        )

    @property
    def is_of_angles(self) -> bool:
        """True if a rotation is written as angles relative to the horizon and to north."""
        return self.rotation in ANGLES

    def fixes_centre(self) -> bool:
        """Returns true if the other direction turns the rotations alone."""
        return self.vector == "degrees" or (self.vector == "centre" and self.direction == "cam_from_world")


COLMAP = Convention()


def pose_of(rotation: Any, vector: Any, convention: Convention) -> Pose:
    """Returns the pose cam_from_world, with COLMAP's axes, of what a file has; a pose of COLMAP keeps every bit."""
    vector = finite(vector, 3)
    if convention == COLMAP:
        return Pose(_unit(rotation), vector)
    written, scale = _rotation(rotation, convention)
    axes = CAMERA_AXES[convention.camera_axes]
    if convention.direction == "world_from_cam":
        return Pose.from_centre((written @ axes).T, vector)
    if convention.vector != "translation":
        return Pose.from_centre(axes.T @ written, vector)
    return Pose.from_matrix(axes.T @ written, axes.T @ vector / scale)


def written(pose: Pose, convention: Convention) -> tuple[Array, Array]:
    """Returns the rotation and the vector that a file has for a pose cam_from_world: the inverse of `pose_of`."""
    if convention == COLMAP:
        return pose.qvec, pose.tvec
    axes = CAMERA_AXES[convention.camera_axes]
    if convention.direction == "world_from_cam":
        return _written_rotation(pose.rotation.T @ axes.T, convention), pose.cam_in_world
    vector = axes @ pose.tvec if convention.vector == "translation" else pose.cam_in_world
    return _written_rotation(axes @ pose.rotation, convention), vector


def finite(values: Any, count: int) -> Array:
    """Returns `count` finite numbers of a sequence of any shape."""
    found = np.array(values, float).ravel()
    if len(found) != count:
        raise ValueError(f"there are {len(found)} numbers instead of {count}")
    if not np.all(np.isfinite(found)):
        raise ValueError("a pose has a value that is not finite")
    if np.any(np.abs(found) > MAX_VALUE):
        raise ValueError(f"a pose has the value {found[np.argmax(np.abs(found))]:g}")
    return found


def nearest_rotation(matrix: ArrayLike) -> tuple[Array, float]:
    """Returns the rotation nearest to a 3x3 matrix, which must be one up to rounding and a scale, and the scale."""
    values = finite(matrix, 9).reshape(3, 3)
    u, lengths, vt = np.linalg.svd(values)
    rotation: Array = u @ vt
    scale = float(lengths.mean())
    if not scale > 0 or np.linalg.det(rotation) < 0 or np.abs(values / scale - rotation).max() > MAX_ROTATION_ERROR:
        raise ValueError("a matrix is not a rotation")
    return rotation, scale


def quaternion_rotation(wxyz: ArrayLike) -> Array:
    """Returns the rotation of a quaternion, which is a unit up to rounding."""
    return Pose(_unit(wxyz), np.zeros(3)).rotation


def _unit(quaternion: ArrayLike) -> Array:
    """Returns the four numbers of a quaternion as they are, which is a unit up to rounding."""
    numbers = finite(quaternion, 4)
    norm = float(np.linalg.norm(numbers))
    if abs(norm - 1) > MAX_ROTATION_ERROR:
        raise ValueError(f"a quaternion's norm is {norm:g}, not 1")
    return numbers


def _from_rotation_vector(vector: ArrayLike) -> Array:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def _to_rotation_vector(rotation: Array) -> Array:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(rotation).as_rotvec())


ANGLES = ("yaw, pitch, roll", "omega, phi, kappa", "yaw, pitch, roll about z, y, x")
# Rotations that are neither matrices nor quaternions, but three numbers: from these, and to these.
ROTATIONS: dict[str, tuple[Callable[[ArrayLike], Array], Callable[[Array], Array]]] = {
    "rotation vector": (_from_rotation_vector, _to_rotation_vector),  # axis times angle in radians
    "yaw, pitch, roll": (YAW_PITCH_ROLL.rotation, YAW_PITCH_ROLL.of),
    "omega, phi, kappa": (OMEGA_PHI_KAPPA.rotation, OMEGA_PHI_KAPPA.of),
    "yaw, pitch, roll about z, y, x": (YAW_PITCH_ROLL_ZYX.rotation, YAW_PITCH_ROLL_ZYX.of),
}


def _rotation(values: Any, convention: Convention) -> tuple[Array, float]:
    """Returns a rotation as it is written, and the scale of its axes."""
    if convention.rotation == "matrix":
        return nearest_rotation(values)
    if convention.rotation == "quaternion":
        quaternion = finite(values, 4)
        return quaternion_rotation(np.roll(quaternion, 1) if convention.quaternion == "xyzw" else quaternion), 1.0
    return ROTATIONS[convention.rotation][0](finite(values, 3)), 1.0


def _written_rotation(rotation: Array, convention: Convention) -> Array:
    """Returns the numbers that a file has for a rotation."""
    if convention.rotation == "matrix":
        return rotation
    if convention.rotation == "quaternion":
        qvec = Pose.from_matrix(rotation, np.zeros(3)).qvec
        return np.roll(qvec, -1) if convention.quaternion == "xyzw" else qvec
    return ROTATIONS[convention.rotation][1](rotation)
