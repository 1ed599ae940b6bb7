"""Reads transforms.json of nerfstudio, instant-ngp and Polycam."""

import functools
from typing import Any

from colmap_lazyloc.pose_formats.cameras import named_camera, size_of
from colmap_lazyloc.pose_formats.posed_images import Source
from colmap_lazyloc.pose_formats.raw_poses import RawPose, RawPoses, each, matrix_parts
from colmap_lazyloc.pose_formats.text import read_json, simple_name


def parse(source: Source) -> RawPoses:
    data = read_json(source.path)

    def parse_frame(frame: dict[str, Any]) -> RawPose:
        # Intrinsics stand in the frame or next to the frames.
        values = {simple_name(name): value for name, value in {**data, **frame}.items()}
        size = size_of(values)
        camera = functools.partial(named_camera, values)
        if size is not None and source.camera is None:
            return RawPose(*matrix_parts(frame["transform_matrix"]), str(frame["file_path"]), camera=camera(size))
        return RawPose(*matrix_parts(frame["transform_matrix"]), str(frame["file_path"]), camera=camera)

    return RawPoses(each(data["frames"], parse_frame))
