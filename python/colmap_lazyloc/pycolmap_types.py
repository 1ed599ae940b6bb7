"""Converts cameras, poses and images to pycolmap's types. Those of pycolmap are read by `of` of our types."""

from collections.abc import Iterable

import numpy as np
import pycolmap

from colmap_lazyloc.array_types import Floats
from colmap_lazyloc.model import Camera, Image
from colmap_lazyloc.poses import Pose


def to_pycolmap_camera(camera: Camera, camera_id: int = 1) -> pycolmap.Camera:
    return pycolmap.Camera(
        camera_id=camera_id, model=camera.model, width=camera.width, height=camera.height, params=list(camera.params)
    )


def image_from_cam(camera: Camera, points_in_cam: Floats) -> Floats:
    """Projects points, n x 3; returns pixels, n x 2, and NaN for points that the camera cannot see."""
    return np.asarray(to_pycolmap_camera(camera).img_from_cam(points_in_cam), float)


def to_rigid3d(pose: Pose) -> pycolmap.Rigid3d:
    # Normalize the quaternion, because pycolmap does not.
    return pycolmap.Rigid3d(pycolmap.Rotation3d(np.roll(pose.qvec / np.linalg.norm(pose.qvec), -1)), pose.tvec)


def write_images(database: pycolmap.Database, cameras: dict[int, Camera], images: Iterable[Image]) -> None:
    """Writes cameras and images into an empty database: a rig for each camera, a frame for each image."""
    for camera_id, camera in cameras.items():
        written = to_pycolmap_camera(camera, camera_id)
        database.write_camera(written, use_camera_id=True)
        rig = pycolmap.Rig(rig_id=camera_id)
        rig.add_ref_sensor(written.sensor_id)
        database.write_rig(rig, use_rig_id=True)
    for image in images:
        image_written = pycolmap.Image(name=image.name, camera_id=image.camera_id, image_id=image.image_id)
        database.write_image(image_written, use_image_id=True)
        frame = pycolmap.Frame(frame_id=image.image_id, rig_id=image.camera_id)
        frame.add_data_id(image_written.data_id)
        database.write_frame(frame, use_frame_id=True)
