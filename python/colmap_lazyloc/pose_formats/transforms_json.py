"""Reads and writes transforms.json of nerfstudio, instant-ngp and Polycam."""

import functools
import json
import pathlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.cameras import (
    CAMERA_NAMES,
    FISHEYE_KIND,
    PERSPECTIVE_KIND,
    SPHERICAL_KIND,
    coefficients,
    contradicted_angles,
    named_camera,
    size_of,
)
from colmap_lazyloc.pose_formats.conventions import nearest_rotation
from colmap_lazyloc.pose_formats.frames import Similarity
from colmap_lazyloc.pose_formats.posed_images import Source
from colmap_lazyloc.pose_formats.raw_poses import DAMAGE, RawPose, RawPoses, each, matrix_parts, reason_of
from colmap_lazyloc.pose_formats.text import numbers, read_json, report_unused, simple_name, words_of

HOLDS = {PERSPECTIVE_KIND: "fy k1 k2 k3 p1 p2", FISHEYE_KIND: "fy k1 k2 k3 k4", SPHERICAL_KIND: ""}
MODELS = {PERSPECTIVE_KIND: "OPENCV", FISHEYE_KIND: "OPENCV_FISHEYE", SPHERICAL_KIND: "EQUIRECTANGULAR"}
DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")
APPLIED = "applied_transform", "applied_scale"  # from the coordinates before nerfstudio has turned them
# Keys that are read, those of depth maps, of the space that a training fills, and of what photos have beside poses.
KNOWN = CAMERA_NAMES | words_of(
    "frames filepath transformmatrix rotation distortionparams appliedtransform appliedscale depthfilepath depthpath "
    "integerdepthscale enabledepthloading plyfilepath aabbscale renderaabb scale offset up time timestamp sharpness "
    "orientationoverride autoscaleposesoverride trainfilenames valfilenames testfilenames colmapimid"
)
DATAPARSER = "transform", "scale"  # of dataparser_transforms.json: from the same coordinates to those of a training


def parse(source: Source) -> RawPoses:
    data = read_json(source.path)
    contradicted: dict[str, float] = {}

    def parse_frame(frame: dict[str, Any]) -> RawPose:
        # Intrinsics stand in the frame or next to the frames.
        values = _values(data) | _values(frame)
        size = size_of(values)
        if size is not None and source.camera is None:
            contradicted.update(contradicted_angles(values, size))
        rotation, vector = matrix_parts(frame["transform_matrix"])
        return RawPose(rotation, vector, str(frame["file_path"]), camera=functools.partial(named_camera, values))

    poses = each(data["frames"], parse_frame)
    report_unused(source.path, [data, *data["frames"], contradicted], KNOWN)
    return RawPoses(poses)


def _values(data: dict[str, Any]) -> dict[str, Any]:
    """Returns values by their simple names; nerfstudio reads coefficients by their names, or as a list."""
    values = {simple_name(name): value for name, value in data.items()}
    coefficients = values.pop("distortionparams", None)
    if coefficients is not None:
        values |= zip(DISTORTION, numbers(coefficients, len(DISTORTION)))
    return values


def read_frame(path: pathlib.Path) -> Similarity:
    """Returns the transform from the coordinates of nerfstudio to those of the data that it was given: by
    dataparser_transforms.json, of a training, or by transforms.json, of its input."""
    data = read_json(path)
    try:
        similarity = _from_file(data, DATAPARSER) or _from_file(data, APPLIED)
    except DAMAGE as error:
        raise InputError(f"{path}: its transform cannot be used: {reason_of(error)}") from None
    if similarity is None:
        raise InputError(f"{path}: has neither a transform, as dataparser_transforms.json, nor an applied_transform")
    return similarity


def text(raw: RawPoses) -> str:
    """Returns the file; what is equal for all frames stands once, as instant-ngp needs it."""
    cameras = [_named(pose.camera) if isinstance(pose.camera, Camera) else {} for pose in raw.written]
    common = cameras[0]
    if any(camera != common for camera in cameras):  # nerfstudio reads the model from here, even so
        models = {camera.get("camera_model") for camera in cameras}
        common = {"camera_model": models.pop()} if len(models) == 1 else {}
    frames = [
        {
            "file_path": pose.name,
            **{name: value for name, value in camera.items() if name not in common},
            "transform_matrix": _rows(pose.rotation, pose.vector) + [[0.0, 0.0, 0.0, 1.0]],
        }
        for pose, camera in zip(raw.written, cameras)
    ]
    data: dict[str, Any] = dict(common)
    similarity = raw.written[0].similarity
    if similarity is not None:
        to_file = similarity.inverse()
        rotation, scale = nearest_rotation(to_file.matrix)
        data |= dict(zip(APPLIED, (_rows(rotation, to_file.offset / scale), scale)))
    return json.dumps({**data, "frames": frames}, indent=2, ensure_ascii=False) + "\n"


def _from_file(data: Any, names: tuple[str, str]) -> Similarity | None:
    """Returns the inverse of x -> scale (R x + t), which a file has by these names; None if it has none."""
    if not isinstance(data, dict) or data.get(names[0]) is None:
        return None
    rotation, offset = matrix_parts(data[names[0]])
    rotation, _ = nearest_rotation(rotation)
    scale = float(data.get(names[1], 1.0))
    if not (np.all(np.isfinite(offset)) and np.isfinite(scale) and scale > 0):
        raise ValueError(f"{names[0]} or {names[1]} is not finite, or not positive")
    return Similarity(scale * rotation, scale * offset).inverse()


def _named(camera: Camera) -> dict[str, Any]:
    """Returns intrinsics as nerfstudio names them: the inverse of named_camera."""
    kind, values = coefficients(camera)
    if kind == SPHERICAL_KIND:  # nerfstudio wants the focal length, but does not use it
        values = {"fx": camera.height, "fy": camera.height, "cx": camera.width / 2, "cy": camera.height / 2}
    names = {"fx": "fl_x", "fy": "fl_y"}
    size = {"w": camera.width, "h": camera.height}
    return {"camera_model": MODELS[kind], **size, **{names.get(name, name): value for name, value in values.items()}}


def _rows(rotation: ArrayLike, vector: ArrayLike) -> list[list[float]]:
    """Returns the rows of a 3x4 matrix."""
    rows: list[list[float]] = np.column_stack([rotation, vector]).tolist()
    return rows
