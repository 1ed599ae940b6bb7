"""Computes with the poses of many images at once."""

import numpy as np

from colmap_lazyloc.array_types import Array, Floats
from colmap_lazyloc.model import Camera
from colmap_lazyloc.poses import Pose, rotation_matrices

MAX_HALF_FIELD_RAD = 1.1  # a wider image is drawn as if it ended here, because its border would be far away or behind


def stack_poses(poses: list[Pose | None]) -> tuple[Array, Array]:
    """Returns unit quaternions, n x 4 (w x y z), and translations, n x 3; NaN for missing poses."""
    missing = Pose(np.full(4, np.nan), np.full(3, np.nan))
    qvecs = np.array([(pose or missing).qvec for pose in poses], float).reshape(-1, 4)
    tvecs = np.array([(pose or missing).tvec for pose in poses], float).reshape(-1, 3)
    return normalized(qvecs), tvecs


def normalized(vectors: Array) -> Array:
    """Returns the rows at unit length."""
    unit_vectors: Array = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit_vectors


def viewer_quaternions(qvecs: Array) -> Array:
    """Returns the inverse rotations, world_from_cam, as x y z w."""
    return np.concatenate([-qvecs[:, 1:], qvecs[:, :1]], axis=1)


def position_covariances(qvecs: Floats, tvecs: Floats, covariances: Array) -> Array:
    """Returns the covariances of the projection centres, n x 6 (xx xy xz yy yz zz), from those of the poses."""
    x, y, z = tvecs.T
    zero = np.zeros_like(x)
    # A rotation by w and a translation by dt move the centre -R' t by -R' (dt + t x w).
    cross = np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), 2, 0)
    jacobian = np.concatenate([cross, np.broadcast_to(np.eye(3), cross.shape)], axis=2)
    jacobian = np.einsum("nji,njk->nik", rotation_matrices(qvecs), jacobian)
    full: Array = np.einsum("nij,njk,nlk->nil", jacobian, covariances, jacobian, optimize=True)
    return full[:, (0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2)]


def focal_lengths(camera: Camera) -> tuple[float, float]:
    """Returns the focal lengths along x and y in pixels."""
    return camera.params[0], camera.params[1 if camera.model in _TWO_FOCAL_LENGTHS else 0]


def image_extent(camera: Camera) -> tuple[float, float, float, float]:
    """Returns the left, top, right and bottom border of the image on the plane z = 1, without distortion."""
    if camera.model == "EQUIRECTANGULAR":
        return -1.0, -0.5, 1.0, 0.5
    fx, fy = focal_lengths(camera)
    cx, cy = camera.params[2:4] if camera.model in _TWO_FOCAL_LENGTHS else camera.params[1:3]
    borders = np.array([-cx / fx, -cy / fy, (camera.width - cx) / fx, (camera.height - cy) / fy])
    if "FISHEYE" in camera.model:
        borders = np.tan(np.clip(borders, -MAX_HALF_FIELD_RAD, MAX_HALF_FIELD_RAD))
    limit = np.tan(MAX_HALF_FIELD_RAD)
    left, top, right, bottom = map(float, np.clip(np.nan_to_num(borders), -limit, limit))
    return left, top, right, bottom


_TWO_FOCAL_LENGTHS = {
    "PINHOLE",
    "OPENCV",
    "OPENCV_FISHEYE",
    "FULL_OPENCV",
    "FOV",
    "THIN_PRISM_FISHEYE",
    "RAD_TAN_THIN_PRISM_FISHEYE",
    "DIVISION",
    "FISHEYE",
    "EUCM",
}
