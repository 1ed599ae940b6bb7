"""Reads and writes GeoPose 1.0 of OGC, Basic-Quaternion and Basic-YPR: a folder with a JSON file for each photo.

The camera's axes are x forward, y left, z up, as yaw, pitch and roll about z, y and x suggest: the standard leaves them
open. At yaw, pitch and roll 0, the camera looks east.
"""

import json
import pathlib
from typing import Any

from colmap_lazyloc.pose_formats.frames import GEOGRAPHIC, Frame
from colmap_lazyloc.pose_formats.naming import files_by_name, inside
from colmap_lazyloc.pose_formats.posed_images import Source
from colmap_lazyloc.pose_formats.raw_poses import RawPose, RawPoses, each
from colmap_lazyloc.pose_formats.text import read_json, report_unused

QUATERNION = ("quaternion", ("x", "y", "z", "w"))
ANGLES = ("angles", ("yaw", "pitch", "roll"))
POSITION = ("lon", "lat", "h")
ENDING = ".json"

Rotation = tuple[str, tuple[str, ...]]  # the name of an object, and those of its numbers


def parse(source: Source, rotation: Rotation) -> RawPoses:
    """Reads a folder of poses, or one; the names of photos are those of the files without their endings."""

    given = []

    def parse_file(file: tuple[str, pathlib.Path]) -> RawPose:
        name, path = file
        values: dict[str, Any] = read_json(path)
        given.append(values)
        turn = [float(values[rotation[0]][name]) for name in rotation[1]]
        position = [float(values["position"][name]) for name in POSITION]
        return RawPose(turn, position, name)

    poses = each(files_by_name(source.path, ENDING), parse_file, lambda file: file[1].name)
    report_unused(source.path, given, {"position", rotation[0], "validtime"})
    return RawPoses(poses, Frame(GEOGRAPHIC))


def write(path: pathlib.Path, raw: RawPoses, rotation: Rotation) -> None:
    """Writes a folder of poses."""
    for pose in raw.written:
        longitude, latitude, height = map(float, pose.vector)
        content = {
            "position": {"lat": latitude, "lon": longitude, "h": height},
            rotation[0]: dict(zip(rotation[1], map(float, pose.rotation))),
        }
        file = inside(path, (pose.name or "") + ENDING)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(content, indent=2) + "\n")
