"""Camera poses, their errors, and files of poses."""

import dataclasses
import math
import pathlib

import numpy as np

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.text_files import read_entries


@dataclasses.dataclass(frozen=True, eq=False)
class Pose:
    """A pose cam_from_world: x_cam = rotation x_world + tvec. Both vectors keep every bit; qvec is never normalized."""

    qvec: np.ndarray  # quaternion w, x, y, z
    tvec: np.ndarray  # in the unit of the world

    @staticmethod
    def from_matrix(rotation, tvec) -> "Pose":
        """Makes a pose from a 3x3 rotation and a translation, both cam_from_world."""
        return Pose(_quaternion(np.asarray(rotation, float)), np.array(tvec, float))

    @staticmethod
    def from_centre(rotation, cam_in_world) -> "Pose":
        """Makes a pose from a 3x3 rotation (cam_from_world) and the projection centre."""
        return Pose.from_matrix(rotation, -(rotation @ np.asarray(cam_in_world, float)))

    @property
    def rotation(self) -> np.ndarray:
        """Returns the 3x3 rotation matrix, cam_from_world."""
        return rotation_matrices((self.qvec / np.linalg.norm(self.qvec))[None])[0]

    @property
    def cam_in_world(self) -> np.ndarray:
        """Returns the projection centre."""
        return -self.rotation.T @ self.tvec

    def __call__(self, points_in_world: np.ndarray) -> np.ndarray:
        """Transforms n x 3 points into the camera's frame."""
        return points_in_world @ self.rotation.T + self.tvec

    def errors(self, truth: "Pose") -> tuple[float, float]:
        """Returns the distance of the projection centres, and the angle between the rotations in degrees."""
        poses = ((pose.qvec / np.linalg.norm(pose.qvec), pose.tvec) for pose in (self, truth))
        (distance,), (angle_deg,) = pose_errors(*(vector[None] for pose in poses for vector in pose))
        return float(distance), float(angle_deg)

    def bits(self) -> bytes:
        """Returns the seven doubles as COLMAP's binary models hold them: qvec, tvec."""
        return np.array([*self.qvec, *self.tvec], "<f8").tobytes()

    def text(self) -> str:
        """Returns `qw qx qy qz tx ty tz`, from which the same numbers are read again."""
        return " ".join(f"{number:.17g}" for number in (*self.qvec, *self.tvec))


def rotation_matrices(qvecs: np.ndarray) -> np.ndarray:
    """Returns the rotations, n x 3 x 3, of unit quaternions, n x 4."""
    w, x, y, z = qvecs.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def centres(qvecs: np.ndarray, tvecs: np.ndarray) -> np.ndarray:
    """Returns the projection centres, n x 3, of poses cam_from_world."""
    return -np.einsum("nji,nj->ni", rotation_matrices(qvecs), tvecs)


def pose_errors(qvecs, tvecs, true_qvecs, true_tvecs) -> tuple[np.ndarray, np.ndarray]:
    """Returns the distances of the projection centres, and the angles between the rotations in degrees."""
    distances = np.linalg.norm(centres(qvecs, tvecs) - centres(true_qvecs, true_tvecs), axis=1)
    w1, v1, w2, v2 = qvecs[:, :1], qvecs[:, 1:], true_qvecs[:, :1], -true_qvecs[:, 1:]
    # Use the arc tangent, because the arc cosine of the trace is inaccurate for small angles.
    sines = np.linalg.norm(w1 * v2 + w2 * v1 + np.cross(v1, v2), axis=1)
    cosines = np.abs(w1 * w2 - np.sum(v1 * v2, axis=1, keepdims=True))[:, 0]
    return distances, np.degrees(2 * np.arctan2(sines, cosines))


def look_at(cam_in_world, target, down, roll_deg: float = 0.0) -> np.ndarray:
    """Returns the rotation, cam_from_world, of a camera that looks at a target.

    `down`: the direction in the world that points down in the image; `roll_deg`: a turn about the viewing direction.
    """
    forward = np.asarray(target, float) - cam_in_world
    forward /= np.linalg.norm(forward)
    right = np.cross(down, forward)
    right /= np.linalg.norm(right)
    cosine, sine = math.cos(math.radians(roll_deg)), math.sin(math.radians(roll_deg))
    roll = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    return roll @ np.stack([right, np.cross(forward, right), forward])


def read_poses(path) -> dict[str, Pose]:
    """Reads a file with lines `name qw qx qy qz tx ty tz`, cam_from_world, such as poses.txt. Names may have blanks."""
    poses = {}
    for line_number, line in read_entries(path):
        words = line.rsplit(maxsplit=7)
        try:
            name, numbers = words[0], np.array([float(word) for word in words[1:]])
            if numbers.size != 7 or not np.all(np.isfinite(numbers)):
                raise ValueError
        except ValueError:
            raise InputError(f"{path}:{line_number}: expected `name qw qx qy qz tx ty tz`, found '{line}'") from None
        norm = np.linalg.norm(numbers[:4])
        if abs(norm - 1) > 0.01:
            raise InputError(f"{path}:{line_number}: the quaternion's norm is {norm:.6g}, not 1")
        if name in poses:
            raise InputError(f"{path}:{line_number}: image '{name}' has a pose already")
        poses[name] = Pose(numbers[:4], numbers[4:])
    return poses


def write_poses(path: pathlib.Path, poses: dict[str, Pose]):
    """Writes a file that `read_poses` reads, sorted by name; makes its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{name} {pose.text()}\n" for name, pose in sorted(poses.items())), encoding="utf-8")


def _quaternion(r: np.ndarray) -> np.ndarray:
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
    return row * np.copysign(1 / np.linalg.norm(row), row[0])
