"""Reads cameras in JSON: of Record3D, Polycam and 3D Gaussian Splatting."""

import functools
import pathlib
from typing import Any

import numpy as np

from colmap_lazyloc.pose_formats.cameras import CAMERA_NAMES, brown_camera, named_camera
from colmap_lazyloc.pose_formats.posed_images import Source
from colmap_lazyloc.pose_formats.raw_poses import RawPose, RawPoses, each, matrix_parts
from colmap_lazyloc.pose_formats.text import numbers, read_json, report_unused, simple_name, words_of

# Keys that are read, and those of depth maps, times and qualities of photos.
RECORD3D = words_of("w h k fps poses perframeintrinsiccoeffs frametimestamps initpose cameratype dw dh")
POLYCAM = CAMERA_NAMES | words_of("width height timestamp blurscore centerdepth manualkeyframe neighbors")
SPLATTING = CAMERA_NAMES | words_of("id imgname width height position rotation")


def parse_record3d(source: Source) -> RawPoses:
    """Reads metadata.json of Record3D: quaternions and positions of the frames; a matrix K by columns."""
    data = read_json(source.path)
    report_unused(source.path, [data], RECORD3D)
    size = round(float(data["w"])), round(float(data["h"]))
    k = np.reshape(numbers(data["K"], 9), (3, 3)).T
    of_all = [k[0, 0], k[1, 1], k[0, 2], k[1, 2]]
    of_frames = data.get("perFrameIntrinsicCoeffs") or [of_all] * len(data["poses"])

    def parse_pose(index: int) -> RawPose:
        values = numbers(data["poses"][index], 7)
        fx, fy, cx, cy = numbers(of_frames[index], 4)
        return RawPose(values[:4], values[4:], frame=index, camera=brown_camera(size, (fx, fy), (cx, cy)))

    return RawPoses(each(range(len(data["poses"])), parse_pose))


def parse_polycam(source: Source) -> RawPoses:
    """Reads a folder of keyframes, which have the names of their photos."""
    given = []

    def parse_keyframe(path: pathlib.Path) -> RawPose:
        values = {simple_name(name): value for name, value in read_json(path).items()}
        matrix = [values.pop(f"t{row}{column}") for row in range(3) for column in range(4)]
        given.append(values)
        return RawPose(*matrix_parts(matrix), path.stem, camera=functools.partial(named_camera, values))

    poses = each(sorted(source.path.glob("*.json")), parse_keyframe, lambda path: path.name)
    report_unused(source.path, given, POLYCAM)
    return RawPoses(poses)


def parse_splatting(source: Source) -> RawPoses:
    """Reads cameras.json of 3D Gaussian Splatting."""

    def parse_camera(values: dict[str, Any]) -> RawPose:
        camera = functools.partial(named_camera, {simple_name(name): value for name, value in values.items()})
        return RawPose(values["rotation"], values["position"], str(values["img_name"]), camera=camera)

    cameras = read_json(source.path)
    poses = each(cameras, parse_camera)
    report_unused(source.path, cameras, SPLATTING)
    return RawPoses(poses)
