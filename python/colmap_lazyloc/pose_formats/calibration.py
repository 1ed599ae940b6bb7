"""Reads calibrations: a camera, and its pose on the body whose trajectory is known.

These are sensor.yaml of EuRoC, camchain.yaml of Kalibr, and calib.txt of KITTI. Their pixels have whole numbers at the
centres, COLMAP's at the borders.
"""

import pathlib
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.cameras import brown_camera, fisheye_camera
from colmap_lazyloc.pose_formats.conventions import nearest_rotation
from colmap_lazyloc.pose_formats.posed_images import Source
from colmap_lazyloc.pose_formats.raw_poses import DAMAGE, matrix_parts
from colmap_lazyloc.pose_formats.text import numbers, report_unused, words_of
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.text_files import read_entries

# What is read of EuRoC and of Kalibr, and what has nothing to do with the camera's pose on the body.
KNOWN = words_of(
    "tbs tcamimu tcncnm1 cameramodel intrinsics resolution distortionmodel distortioncoefficients distortioncoeffs "
    "sensortype comment ratehz rostopic camoverlaps"
)
COLMAP_FROM_CENTRES = 0.5  # pixels


def read_calibration(source: Source) -> tuple[Camera | None, Pose | None]:
    """Returns the camera and cam_from_body; None for what is not known."""
    path = source.calibration_path
    if path is None:
        return source.camera, None
    if not source.photos.names:
        raise InputError(f"--calibration {path}: needs photos (--image_path)")
    camera: Camera | None
    try:
        if path.suffix.lower() in (".yaml", ".yml"):
            camera, cam_from_body = _read_yaml(path, _number_of_folder("cam", source))
        else:
            camera, cam_from_body = _read_kitti(path, source, _number_of_folder("image", source))
    except DAMAGE as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"--calibration {path}: is not of EuRoC, Kalibr or KITTI: {error}") from None
    return source.camera or camera, cam_from_body


def _number_of_folder(word: str, source: Source) -> int:
    """Returns the number at the end of the folder of photos, such as image_02 or cam1; 0 if it has none."""
    folder = re.search(rf".*\b{word}_?0?(\d)/", f"{source.photos.folder}/{source.photos.names[0]}")
    return int(folder.group(1)) if folder else 0


def _read_yaml(path: pathlib.Path, number: int) -> tuple[Camera, Pose]:
    import yaml

    try:
        # Leave out OpenCV's first line, which is not YAML.
        data = yaml.safe_load(re.sub(r"\A%YAML:.*", "", path.read_text(encoding="utf-8")))
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        raise InputError(f"--calibration {path}: is not a YAML file that can be read") from None
    name = f"cam{number}"
    report_unused(path, [data, data.get(name)], KNOWN | {name})
    if "T_BS" in data:  # EuRoC: the body from the sensor
        matrix = np.linalg.inv(np.reshape(numbers(data["T_BS"]["data"], 16), (4, 4)))
        return _camera(data, "distortion_coefficients"), _pose(matrix)
    data = data[name]  # Kalibr
    if number and "T_cam_imu" not in data:
        raise ValueError(f"{name} has no T_cam_imu")
    matrix = np.array(data.get("T_cam_imu", np.eye(4)), float)
    return _camera(data, "distortion_coeffs"), _pose(matrix)


def _camera(data: dict[str, Any], coefficients: str) -> Camera:
    if data["camera_model"] != "pinhole":
        raise ValueError(f"the camera model {data['camera_model']} is not supported")
    fx, fy, cx, cy = numbers(data["intrinsics"], 4)
    width, height = (int(value) for value in numbers(data["resolution"], 2))
    centre = cx + COLMAP_FROM_CENTRES, cy + COLMAP_FROM_CENTRES
    model = data.get("distortion_model", "none")
    if model == "none":
        return brown_camera((width, height), (fx, fy), centre)
    c1, c2, c3, c4 = numbers(data[coefficients], 4)
    if model == "equidistant":
        return fisheye_camera((width, height), (fx, fy), centre, (c1, c2, c3, c4))
    if model not in ("radtan", "radial-tangential"):
        raise ValueError(f"the distortion model {model} is not supported")
    return brown_camera((width, height), (fx, fy), centre, (c1, c2), (c3, c4))


def _pose(matrix: NDArray[np.float64]) -> Pose:
    return Pose.from_matrix(nearest_rotation(matrix[:3, :3])[0], matrix[:3, 3])


def _read_kitti(path: pathlib.Path, source: Source, number: int) -> tuple[Camera | None, Pose]:
    """Reads the projection of a camera."""
    rows = {key.strip(): text for key, _, text in (line.partition(":") for _, line in read_entries(path))}
    if f"image_0{number}" in rows:  # calib_cam_to_pose.txt of KITTI-360
        rotation, centre = matrix_parts(numbers(rows[f"image_0{number}"], 12))
        return source.camera, Pose.from_centre(nearest_rotation(rotation)[0].T, centre)
    key = f"P{number}"
    projection = np.reshape(numbers(rows[key if key in rows else "P_rect_0" + key[1:]], 12), (3, 4))
    matrix = projection[:, :3]
    size = source.photos.size(source.photos.names[0])
    centre = matrix[0, 2] + COLMAP_FROM_CENTRES, matrix[1, 2] + COLMAP_FROM_CENTRES
    camera = brown_camera(size, (matrix[0, 0], matrix[1, 1]), centre)
    return camera, Pose(np.array([1.0, 0, 0, 0]), np.linalg.solve(matrix, projection[:, 3]))
