"""Writes a bag of ROS 2: for each photo a geometry_msgs/PoseWithCovarianceStamped and its transform in /tf.

Both are the pose of the camera in the frame "map", the model's world, with the axes of an optical frame of ROS
(REP 103): x right, y down, z forward, as COLMAP's. Needs rosbags, and no ROS.
"""

import pathlib
from collections.abc import Mapping
from decimal import Decimal
from typing import Any, Literal

import numpy as np

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.pose_formats.naming import times_of
from colmap_lazyloc.pose_formats.raw_poses import RawPose, RawPoses
from colmap_lazyloc.pose_formats.trajectories import warn_of_numbers

BAG = "localized"  # the name of its file
FILES = rf"{BAG}\.db3|metadata\.yaml"
MAP, CAMERA = "map", "camera_optical_frame"
TOPIC = "/localized_pose"
POSE, TRANSFORMS = "geometry_msgs/msg/PoseWithCovarianceStamped", "tf2_msgs/msg/TFMessage"
VERSION: Literal[8] = 8  # of the description of a bag
SECOND = 1_000_000_000  # in nanoseconds
MAX_SECONDS = (1 << 31) - 1  # of ROS' Time


def write(path: pathlib.Path, raw: RawPoses) -> None:
    """Writes the folder of a bag, with the messages in the order of their times."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    poses = {pose.name or "": pose for pose in raw.written}
    store = get_typestore(Stores.ROS2_HUMBLE)
    path.mkdir()
    with Writer(path / BAG, version=VERSION) as bag:
        of_poses = bag.add_connection(TOPIC, POSE, typestore=store)
        of_transforms = bag.add_connection("/tf", TRANSFORMS, typestore=store)
        for time, name in stamps(poses):
            pose, transforms = _messages(poses[name], time, store.types)
            bag.write(of_poses, time, store.serialize_cdr(pose, POSE))
            bag.write(of_transforms, time, store.serialize_cdr(transforms, TRANSFORMS))
    # A bag has the name of its folder, which is another one until all is written.
    for file in (path / BAG).iterdir():
        file.rename(path / file.name)
    (path / BAG).rmdir()


def stamps(names: Mapping[str, object]) -> list[tuple[int, str]]:
    """Returns (nanoseconds, name) by time. The times in names are seconds, or if these are too many for ROS,
    milliseconds, microseconds or nanoseconds."""
    times = times_of(names)
    warn_of_numbers(times)
    numbers = [(Decimal(text), name) for text, name in times]
    factor = next((f for f in (SECOND, 1_000_000, 1_000, 1) if numbers[-1][0] * f <= MAX_SECONDS * SECOND), None)
    if factor is None:
        raise InputError(f"photo '{numbers[-1][1]}': its number is no time that ROS can hold")
    return [(int(number * factor), name) for number, name in numbers]


def _messages(pose: RawPose, time: int, types: Mapping[str, Any]) -> tuple[Any, Any]:
    """Returns the message of a pose, and that of its transform."""

    def make(name: str, *values: Any) -> Any:
        return types[name](*values)

    header = make("std_msgs/msg/Header", make("builtin_interfaces/msg/Time", time // SECOND, time % SECOND), MAP)
    turn = make("geometry_msgs/msg/Quaternion", *map(float, pose.rotation))
    place = [float(number) for number in pose.vector]
    at = make("geometry_msgs/msg/Pose", make("geometry_msgs/msg/Point", *place), turn)
    assert pose.result is not None
    # In the order of ROS: position, then rotation about the fixed axes of the map.
    covariance = np.ravel(np.array(pose.result["pose_covariance_in_map"], np.float64))
    with_covariance = make("geometry_msgs/msg/PoseWithCovariance", at, covariance)
    transform = make("geometry_msgs/msg/Transform", make("geometry_msgs/msg/Vector3", *place), turn)
    stamped = make("geometry_msgs/msg/TransformStamped", header, CAMERA, transform)
    return make(POSE, header, with_covariance), make(TRANSFORMS, [stamped])
