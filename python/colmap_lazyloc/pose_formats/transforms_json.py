"""Reads transforms.json of nerfstudio, instant-ngp and Polycam.

Each frame has `file_path` and `transform_matrix`, the camera's axes in OpenGL's order and its centre in the world.
Intrinsics stand in the frame or beside the frames.
"""

import math
from typing import Any

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.cameras import brown_camera, fisheye_camera
from colmap_lazyloc.pose_formats.posed_images import Photos, PosedImage, PosedImages, Source, pose_of_camera
from colmap_lazyloc.pose_formats.text import read_json

PERSPECTIVE = ("OPENCV", "FULL_OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")


def read(source: Source) -> PosedImages:
    data = read_json(source.path)
    images = []
    for frame in data["frames"]:
        name = source.find_photo(frame["file_path"])
        if name is not None:
            camera = source.camera or _camera({**data, **frame}, name, source.photos)
            images.append(PosedImage(name, camera, pose_of_camera(frame["transform_matrix"], is_opengl=True)))
    return PosedImages(images)


def _camera(values: dict[str, Any], name: str, photos: Photos) -> Camera:
    """Makes a camera of the values of a frame and of those beside the frames."""
    if "w" in values and "h" in values:
        width, height = float(values["w"]), float(values["h"])
    else:
        width, height = photos.size(name)
    focal_x = _focal(values, "x", width)
    focal_y = _focal(values, "y", height) or focal_x
    focal_x = focal_x or focal_y
    if focal_x is None or focal_y is None:
        raise InputError(f"'{name}' has no focal length (fl_x or camera_angle_x)")
    size, focal = (int(width), int(height)), (focal_x, focal_y)
    centre = float(values.get("cx", width / 2)), float(values.get("cy", height / 2))
    k1, k2, k3, k4, p1, p2 = (float(values.get(key, 0)) for key in ("k1", "k2", "k3", "k4", "p1", "p2"))
    model = values.get("camera_model", "OPENCV")
    if model == "OPENCV_FISHEYE" or values.get("is_fisheye"):
        return fisheye_camera(size, focal, centre, (k1, k2, k3, k4))
    if model not in PERSPECTIVE:
        raise InputError(f"'{name}' has the camera model {model}, which is not supported")
    return brown_camera(size, focal, centre, (k1, k2, k3, k4), (p1, p2))


def _focal(values: dict[str, Any], axis: str, length: float) -> float | None:
    """Returns the focal length in pixels along an axis; None if it is not given."""
    if f"fl_{axis}" in values:
        return float(values[f"fl_{axis}"])
    if f"camera_angle_{axis}" in values:
        return length / (2 * math.tan(float(values[f"camera_angle_{axis}"]) / 2))
    return None
