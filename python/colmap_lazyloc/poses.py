"""Camera poses, their errors, and files of poses."""

import dataclasses
import math
import pathlib
from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from colmap_lazyloc.array_types import Floats
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.text_files import Path, read_entries


class Rotation3dLike(Protocol):
    """The attributes of pycolmap.Rotation3d that are read."""

    @property
    def quat(self) -> ArrayLike: ...  # x, y, z, w


class Rigid3dLike(Protocol):
    """The attributes of pycolmap.Rigid3d that are read."""

    @property
    def rotation(self) -> Rotation3dLike: ...

    @property
    def translation(self) -> ArrayLike: ...


class PosedLike(Protocol):
    """The attribute of pycolmap.Image that is read; since COLMAP 3.12 it is a method."""

    @property
    def cam_from_world(self) -> object: ...


@dataclasses.dataclass(frozen=True, eq=False)
class Pose:
    """A pose cam_from_world: x_cam = rotation x_world + tvec.

    qvec and tvec keep their exact values: qvec is not normalized.
    """

    qvec: Floats  # quaternion w, x, y, z
    tvec: Floats  # in the world's unit of length

    @staticmethod
    def of(value: "PoseLike") -> "Pose":
        """Returns the pose of a pycolmap.Rigid3d or a pycolmap.Image; a Pose is returned unchanged."""
        pose = find_pose(value)
        if pose is None:
            raise InputError(f"a pose must be a Pose, a Rigid3d or an Image with one, but is {_describe(value)}")
        return pose

    @staticmethod
    def from_matrix(rotation: ArrayLike, tvec: ArrayLike) -> "Pose":
        """Makes a pose from a 3x3 rotation and a translation, both cam_from_world."""
        return Pose(_quaternion(np.asarray(rotation, float)), np.array(tvec, float))

    @staticmethod
    def from_centre(rotation: ArrayLike, cam_in_world: ArrayLike) -> "Pose":
        """Makes a pose from a 3x3 rotation (cam_from_world) and the camera's centre in the world."""
        return Pose.from_matrix(rotation, -(np.asarray(rotation) @ np.asarray(cam_in_world, float)))

    @property
    def rotation(self) -> Floats:
        """Returns the 3x3 rotation matrix of cam_from_world."""
        rotation: Floats = rotation_matrices((self.qvec / np.linalg.norm(self.qvec))[None])[0]
        return rotation

    @property
    def cam_in_world(self) -> Floats:
        """Returns the camera's centre in the world."""
        return -self.rotation.T @ self.tvec

    def inverse(self) -> "Pose":
        """Returns the inverse pose, world_from_cam."""
        return Pose.from_matrix(self.rotation.T, self.cam_in_world)

    def __matmul__(self, first: "Pose") -> "Pose":
        """Returns b_from_world of b_from_a @ a_from_world."""
        return Pose.from_matrix(self.rotation @ first.rotation, self.rotation @ first.tvec + self.tvec)

    def __call__(self, points_in_world: Floats) -> Floats:
        """Transforms n x 3 points into the camera's frame."""
        return points_in_world @ self.rotation.T + self.tvec

    def errors(self, truth: "PoseLike") -> tuple[float, float]:
        """Returns the distance between the camera centres of this pose and of `truth`, and the angle between the two
        rotations in degrees."""
        poses = ((pose.qvec / np.linalg.norm(pose.qvec), pose.tvec) for pose in (self, Pose.of(truth)))
        (distance,), (angle_deg,) = pose_errors(*(vector[None] for pose in poses for vector in pose))
        return float(distance), float(angle_deg)

    def bits(self) -> bytes:
        """Returns the bytes of qvec and tvec: seven doubles, as in COLMAP's binary models."""
        return np.array([*self.qvec, *self.tvec], "<f8").tobytes()

    def text(self) -> str:
        """Returns the text `qw qx qy qz tx ty tz`, with enough digits to read exactly the same numbers."""
        return " ".join(f"{number:.17g}" for number in (*self.qvec, *self.tvec))


PoseLike = Pose | Rigid3dLike | PosedLike  # a Pose, a pycolmap.Rigid3d or a pycolmap.Image


def find_pose(value: object) -> Pose | None:
    """Returns the pose of a Pose, a pycolmap.Rigid3d or a pycolmap.Image; None for an image without one, and others."""
    if isinstance(value, Pose):
        return value
    if hasattr(value, "cam_from_world"):
        # Ask first, because pycolmap up to 3.10 has an identity for an image without a pose, and 4 ends with an error.
        if not getattr(value, "has_pose", getattr(value, "registered", True)):
            return None
        pose = value.cam_from_world
        return find_pose(pose() if callable(pose) else pose)
    if hasattr(value, "rotation") and hasattr(value, "translation") and hasattr(value.rotation, "quat"):
        return Pose(np.roll(np.asarray(value.rotation.quat, float), 1), np.array(value.translation, float))
    return None


def _describe(value: object) -> str:
    has_none = hasattr(value, "cam_from_world")
    return f"image '{getattr(value, 'name', '')}', which has none" if has_none else f"of type {type(value).__name__}"


def rotation_matrices(qvecs: Floats) -> Floats:
    """Returns the rotations, n x 3 x 3, of unit quaternions, n x 4."""
    w, x, y, z = qvecs.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def centres(qvecs: Floats, tvecs: Floats) -> Floats:
    """Returns the projection centres, n x 3, of poses cam_from_world."""
    minus_centres: Floats = np.einsum("nji,nj->ni", rotation_matrices(qvecs), tvecs)
    return -minus_centres


def pose_errors(qvecs: Floats, tvecs: Floats, true_qvecs: Floats, true_tvecs: Floats) -> tuple[Floats, Floats]:
    """Returns the distances of the projection centres, and the angles between the rotations in degrees."""
    distances = np.linalg.norm(centres(qvecs, tvecs) - centres(true_qvecs, true_tvecs), axis=1)
    w1, v1, w2, v2 = qvecs[:, :1], qvecs[:, 1:], true_qvecs[:, :1], -true_qvecs[:, 1:]
    # Use the arc tangent, because the arc cosine of the trace is inaccurate for small angles.
    sines = np.linalg.norm(w1 * v2 + w2 * v1 + np.cross(v1, v2), axis=1)
    cosines = np.abs(w1 * w2 - np.sum(v1 * v2, axis=1, keepdims=True))[:, 0]
    return distances, np.degrees(2 * np.arctan2(sines, cosines))


def look_at(cam_in_world: ArrayLike, target: ArrayLike, down: ArrayLike, roll_deg: float = 0.0) -> Floats:
    """Returns the rotation, cam_from_world, of a camera that looks at a target.

    `down`: the direction in the world that points down in the image; `roll_deg`: a turn about the viewing direction.
    """
    forward = np.subtract(target, cam_in_world, dtype=float)
    forward /= np.linalg.norm(forward)
    right = np.cross(np.asarray(down, float), forward)
    right /= np.linalg.norm(right)
    cosine, sine = math.cos(math.radians(roll_deg)), math.sin(math.radians(roll_deg))
    roll = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    rotation: Floats = roll @ np.stack([right, np.cross(forward, right), forward])
    return rotation


def read_poses(path: Path) -> dict[str, Pose]:
    """Reads a file in the format of poses.txt: lines `name qw qx qy qz tx ty tz` (cam_from_world). Names may contain
    spaces."""
    poses = {}
    expected = "expected `name qw qx qy qz tx ty tz`"
    for line_number, line in read_entries(path):
        words = line.rsplit(maxsplit=7)
        try:
            name, numbers = words[0], np.array([float(word) for word in words[1:]])
            if numbers.size != 7 or not np.all(np.isfinite(numbers)):
                raise ValueError
        except ValueError:
            raise InputError(f"{path}:{line_number}: {expected}, found '{line}'") from None
        norm = np.linalg.norm(numbers[:4])
        if abs(norm - 1) > 0.01:
            raise InputError(f"{path}:{line_number}: the quaternion's norm is {norm:.6g}, not 1: {expected}")
        if name in poses:
            raise InputError(f"{path}:{line_number}: image '{name}' has a pose already")
        poses[name] = Pose(numbers[:4], numbers[4:])
    return poses


def write_poses(path: pathlib.Path, poses: Mapping[str, PoseLike]) -> None:
    """Writes poses to a file in the format of poses.txt, sorted by name. Creates the file's folder if needed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = (f"{name} {Pose.of(poses[name]).text()}\n" for name in sorted(poses))
    path.write_text("".join(lines), encoding="utf-8")


def _quaternion(r: Floats) -> Floats:
    """Returns the quaternion w, x, y, z of a 3x3 rotation, with w >= 0."""
    # Each row is the quaternion times four times one of its elements. Use the largest, because it is the most accurate.
    rows = np.array(
        [
            [1 + r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], 1 + r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], 1 - r[0, 0] + r[1, 1] - r[2, 2], r[1, 2] + r[2, 1]],
            [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], 1 - r[0, 0] - r[1, 1] + r[2, 2]],
        ]
    )
    row = rows[np.argmax(np.diag(rows))]
    qvec: Floats = row * np.copysign(1 / np.linalg.norm(row), row[0])
    return qvec
