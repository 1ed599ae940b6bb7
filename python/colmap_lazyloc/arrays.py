"""Checks what users give to the extension module, and converts it to the arrays that the module takes."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.extension import core
from colmap_lazyloc.inputs import CameraInput, GravityPrior, ModelInput, PoseInput, PositionPrior
from colmap_lazyloc.model import Model
from colmap_lazyloc.poses import Pose, find_pose
from colmap_lazyloc.settings import check_text

if TYPE_CHECKING:
    from colmap_lazyloc import _core

MAX_IMAGE_SIZE = 1 << 15  # pixels, of one side
_MAX_NON_ORTHOGONALITY = 1e-3  # of rotation matrices, because files may round them to few digits


def to_rows(values: ArrayLike, num_columns: int, label: str) -> NDArray[np.float64]:
    """Returns n x num_columns finite numbers in one block of memory."""
    array = _to_numbers(values, label)
    if array.size == 0 and array.ndim <= 2:
        array = array.reshape(0, num_columns)
    if array.ndim != 2 or array.shape[1] != num_columns:
        raise InputError(f"{label}: must have the shape n x {num_columns}, but has {_shape(array)}")
    return array


def to_matches(values: ArrayLike, label: str) -> NDArray[np.uint32]:
    """Returns n x 2 indices of keypoints."""
    array = _to_array(values, label)
    if array.size == 0:
        return np.zeros((0, 2), np.uint32)
    if array.dtype.kind not in "iu":
        raise InputError(f"{label}: matches must be integers, but have the type {array.dtype}")
    if array.ndim != 2 or array.shape[1] != 2:
        raise InputError(f"{label}: matches must have the shape n x 2, but have {_shape(array)}")
    if array.min() < 0 or array.max() >= 1 << 32:
        raise InputError(f"{label}: a match names a keypoint that its image does not have")
    return np.ascontiguousarray(array, np.uint32)


def to_pixels(image: ArrayLike) -> NDArray[np.uint8]:
    """Returns height x width x 1 (grey) or 3 (RGB) values."""
    array = _to_array(image, "photo")
    if array.dtype != np.uint8:
        raise InputError(f"photo: an array must have the type uint8, but has {array.dtype}")
    if array.ndim == 2:
        array = array[:, :, None]
    if array.ndim != 3 or array.shape[2] not in (1, 3):
        raise InputError(f"photo: an array must have the shape height x width (x 3), but has {_shape(array)}")
    if not all(1 <= size <= MAX_IMAGE_SIZE for size in array.shape[:2]):
        raise InputError(f"photo: an array must have 1 to {MAX_IMAGE_SIZE} rows and columns, but has {_shape(array)}")
    return np.ascontiguousarray(array)


def to_camera(camera: CameraInput) -> "_core.Camera":
    """Returns the extension module's camera.

    Takes `MODEL width height params...`, a dict with the keys model, width, height and params, or an object with these
    attributes, for example pycolmap.Camera or colmap_lazyloc.model.Camera.
    """
    if isinstance(camera, str):
        words = camera.split()
        values: list[Any] = [*words[:3], words[3:]]
    elif isinstance(camera, Mapping):
        values = [camera.get(key) for key in ("model", "width", "height", "params")]
    else:
        values = [getattr(camera, key, None) for key in ("model", "width", "height", "params")]
    if len(values) != 4 or any(value is None for value in values):
        raise InputError("camera: must have model, width, height and params")
    model = getattr(values[0], "name", values[0])
    try:
        width, height = int(values[1]), int(values[2])
        params = [float(param) for param in values[3]]
    except (TypeError, ValueError, OverflowError):
        raise InputError("camera: width, height and params must be numbers") from None
    if not (0 < width < 1 << 31 and 0 < height < 1 << 31):
        raise InputError(f"camera: cannot have {width} x {height} pixels")
    check_text(str(model), "camera: the model")
    return core.Camera(str(model), width, height, params)


def to_pose(pose: PoseInput, label: str) -> NDArray[np.float64]:
    """Returns qw qx qy qz tx ty tz.

    Takes a 3x4 or 4x4 matrix, a pair of a rotation (3x3 matrix or quaternion w x y z) and a translation, or a
    colmap_lazyloc.poses.Pose, a pycolmap.Rigid3d or a pycolmap.Image, whose bits are kept.
    """
    found = find_pose(pose)
    rotation: ArrayLike
    translation: ArrayLike
    if found is not None:
        rotation, translation = found.qvec, found.tvec
    elif hasattr(pose, "cam_from_world"):
        raise InputError(f"{label}: has no pose")
    elif isinstance(pose, tuple | list) and len(pose) == 2:
        rotation, translation = pose
    else:
        matrix = _to_array(pose, label)
        if matrix.shape not in ((3, 4), (4, 4)):
            raise InputError(f"{label}: a pose must be a 3x4 or 4x4 matrix or (R, t), but has {_shape(matrix)}")
        rotation, translation = matrix[:3, :3], matrix[:3, 3]
    tvec = _to_numbers(translation, label)
    if tvec.size != 3:
        raise InputError(f"{label}: a translation must have 3 numbers, but has {tvec.size}")
    return np.concatenate([_to_quaternion(_to_numbers(rotation, label), label), tvec.ravel()])


def to_poses(poses: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Returns n x 7 numbers."""
    return np.ascontiguousarray(poses, np.float64).reshape(-1, 7)


def to_position(prior: PositionPrior | None) -> list[float]:
    """Returns the numbers of a line of a file of positions, without the name; none for None.

    Takes (x, y, z) and an uncertainty: a standard deviation, three of them, or a 3x3 covariance.
    """
    if prior is None:
        return []
    position, uncertainty = _to_prior(prior, "position")
    if uncertainty.shape == (3, 3):
        if not np.allclose(uncertainty, uncertainty.T):
            raise InputError("position: the covariance is not symmetric")
        uncertainty = uncertainty[np.triu_indices(3)]
    elif uncertainty.size not in (1, 3):
        raise InputError(
            "position: the uncertainty must be a standard deviation, three of them, or a 3x3 covariance, "
            f"but has {_shape(uncertainty)}"
        )
    return [*position.tolist(), *uncertainty.ravel().tolist()]


def to_gravity(prior: GravityPrior | None) -> list[float]:
    """Returns the numbers of a line of a file of gravity, without the name; none for None.

    Takes a direction (x, y, z) and a standard deviation in degrees.
    """
    if prior is None:
        return []
    direction, uncertainty = _to_prior(prior, "gravity")
    if uncertainty.size != 1:
        raise InputError(f"gravity: the uncertainty must be one number, but has {_shape(uncertainty)}")
    return [*direction.tolist(), *uncertainty.ravel().tolist()]


def _to_prior(prior: object, label: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if not isinstance(prior, tuple | list) or len(prior) != 2:
        raise InputError(f"{label}: must be a pair of (x, y, z) and its uncertainty")
    given = [prior[1]] if np.ndim(prior[1]) == 0 else prior[1]
    vector, uncertainty = _to_numbers(prior[0], label), _to_numbers(given, label)
    if vector.size != 3:
        raise InputError(f"{label}: must have 3 numbers, but has {vector.size}")
    return vector.ravel(), uncertainty


def to_model(model: ModelInput) -> "_core.Model":
    """Returns the extension module's model.

    Takes a colmap_lazyloc.model.Model, a pycolmap.Reconstruction, {name: (R, t, camera)} or {name: (pose, camera)}.
    """
    images: Mapping[str, Any]
    if isinstance(model, Mapping):
        images = model
    else:
        read = Model.of(model)
        images = {
            name: (image.cam_from_world, read.cameras.get(image.camera_id)) for name, image in read.images.items()
        }
    cameras: list[_core.Camera] = []
    index_of_camera: dict[int, int] = {}
    poses = []
    for name, value in images.items():
        if not isinstance(name, str) or not isinstance(value, tuple | list) or len(value) not in (2, 3):
            raise InputError(f"model: image {name!r} must be a name with (R, t, camera) or (pose, camera)")
        *pose, camera = value
        if camera is None:
            raise InputError(f"model: image {name} has no camera")
        check_text(name, "model: an image's name")
        poses.append(to_pose(pose[0] if len(pose) == 1 else tuple(pose), f"model: image {name}"))
        if id(camera) not in index_of_camera:
            index_of_camera[id(camera)] = len(cameras)
            cameras.append(to_camera(camera))
    camera_of_image = [index_of_camera[id(value[-1])] for value in images.values()]
    return core.Model(cameras, list(images), to_poses(poses), camera_of_image)


def _to_array(values: Any, label: str) -> NDArray[Any]:
    try:
        array = np.asarray(values)
    except (ValueError, TypeError):
        raise InputError(f"{label}: is not an array") from None
    if array.dtype.kind == "O" or array.ndim == 0:
        raise InputError(f"{label}: is not an array of numbers")
    return array


def _to_numbers(values: Any, label: str) -> NDArray[np.float64]:
    array = _to_array(values, label)
    if array.dtype.kind not in "iuf":
        raise InputError(f"{label}: must hold real numbers, but has the type {array.dtype}")
    array = np.ascontiguousarray(array, np.float64)
    if not np.isfinite(array).all():
        raise InputError(f"{label}: row {np.argwhere(~np.isfinite(array))[0][0]} is not finite")
    return array


def _shape(array: NDArray[Any]) -> str:
    return " x ".join(map(str, array.shape))


def _to_quaternion(rotation: NDArray[np.float64], label: str) -> NDArray[np.float64]:
    if rotation.shape == (4,):
        if abs(np.linalg.norm(rotation) - 1) > 0.01:
            raise InputError(f"{label}: the quaternion's norm is {np.linalg.norm(rotation):.6g}, not 1")
        return rotation
    if rotation.shape != (3, 3):
        raise InputError(f"{label}: a rotation must be a 3x3 matrix or a quaternion, but has {_shape(rotation)}")
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > _MAX_NON_ORTHOGONALITY or np.linalg.det(rotation) < 0:
        raise InputError(f"{label}: the matrix is not a rotation")
    return Pose.from_matrix(rotation, np.zeros(3)).qvec
