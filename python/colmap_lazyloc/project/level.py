"""Where up is in a model, because people and drones hold cameras level."""

import dataclasses

import numpy as np

from colmap_lazyloc.array_types import Floats
from colmap_lazyloc.poses import Pose

# Which axis of the camera, x or y, points down in a photo as it is shown, and its sign, by EXIF's orientation.
DOWN = {3: (1, -1), 6: (0, 1), 8: (0, -1)}
# Of the roll of cameras, if its scatter is smaller: a person may hold all photos askew. Measured: 2.5 degrees with a
# phone, 2.6 with a headset.
MIN_ROLL_STDDEV_DEG = 3.0
MIN_SPREAD = 1e-9  # above rounding errors


@dataclasses.dataclass(frozen=True)
class Level:
    """The direction up in a model, and the standard deviation of the tilt."""

    up: Floats
    stddev_deg: float

    def agrees(self, up: Floats, max_angle_deg: float) -> bool:
        """True if a direction that is also said to be up, a unit vector, is near."""
        return bool(self.up @ up >= np.cos(np.radians(min(max_angle_deg, 180.0))))

    def align(self, centres: Floats, targets: Floats) -> tuple[float, Pose]:
        """Returns the scale, and then the rigid motion, that move centres to targets and turn `up` to the z axis."""
        offsets, wanted = centres - centres.mean(axis=0), targets - targets.mean(axis=0)
        levelled = offsets @ self.rotation().T
        plane = np.sum((levelled[:, 0] - 1j * levelled[:, 1]) * (wanted[:, 0] + 1j * wanted[:, 1]))
        scale = float((abs(plane) + levelled[:, 2] @ wanted[:, 2]) / np.sum(offsets**2))
        cosine, sine = plane.real / abs(plane), plane.imag / abs(plane)
        rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]) @ self.rotation()
        return scale, Pose.from_matrix(rotation, targets.mean(axis=0) - scale * rotation @ centres.mean(axis=0))

    def rotation(self) -> Floats:
        """Returns the smallest rotation from the model to a frame whose z axis points up."""
        x, y, z = self.up
        if z < -1 + 1e-12:
            return np.diag([1.0, -1.0, -1.0])
        mixed = -x * y / (1 + z)
        return np.array([[1 - x * x / (1 + z), mixed, -x], [mixed, 1 - y * y / (1 + z), -y], self.up])


def find_level(rotations: Floats, orientations: list[int]) -> Level:
    """Returns the direction from which the horizontal axes of cameras differ least by a right angle.

    `rotations`: of cam_from_world, n x 3 x 3; `orientations`: EXIF's values of the photos.
    """
    axes = [DOWN.get(orientation, (1, 1)) for orientation in orientations]
    down = np.array([sign * rotation[axis] for rotation, (axis, sign) in zip(rotations, axes)])
    right = np.array([rotation[1 - axis] for rotation, (axis, _) in zip(rotations, axes)])
    (least, second, _), directions = np.linalg.eigh(right.T @ right)
    up = directions[:, 0] * (-1 if np.sum(down @ directions[:, 0]) > 0 else 1)
    roll_deg = max(float(np.degrees(np.sqrt(max(least, 0) / len(right)))), MIN_ROLL_STDDEV_DEG)
    # The worst case: cameras are askew in such a way that their errors add up. If all have the same direction, the tilt
    # in this direction is unknown.
    is_known = second > MIN_SPREAD * len(right)
    error_deg = roll_deg * float(np.sum(np.abs(right @ directions[:, 1]))) / second if is_known else np.inf
    return Level(up, error_deg)
