"""Converts cameras, poses and images to and from pycolmap's types."""

from collections.abc import Iterable

import numpy as np
import pycolmap

from colmap_lazyloc.model import Camera, Image
from colmap_lazyloc.poses import Pose


def to_pycolmap_camera(camera: Camera, camera_id: int = 1) -> pycolmap.Camera:
    return pycolmap.Camera(
        camera_id=camera_id, model=camera.model, width=camera.width, height=camera.height, params=list(camera.params)
    )


def image_from_cam(camera: Camera, points_in_cam: np.ndarray) -> np.ndarray:
    """Projects points, n x 3; returns pixels, n x 2, and NaN for points that the camera cannot see."""
    return to_pycolmap_camera(camera).img_from_cam(points_in_cam)


def to_rigid3d(pose: Pose) -> pycolmap.Rigid3d:
    # Normalize the quaternion, because pycolmap does not.
    return pycolmap.Rigid3d(pycolmap.Rotation3d(np.roll(pose.qvec / np.linalg.norm(pose.qvec), -1)), pose.tvec)


def to_pose(cam_from_world: pycolmap.Rigid3d) -> Pose:
    return Pose(np.roll(cam_from_world.rotation.quat, 1), np.array(cam_from_world.translation))


def write_images(database: pycolmap.Database, cameras: dict[int, Camera], images: Iterable[Image]):
    """Writes cameras and images into an empty database: a rig for each camera, a frame for each image."""
    for camera_id, camera in cameras.items():
        written = to_pycolmap_camera(camera, camera_id)
        database.write_camera(written, use_camera_id=True)
        rig = pycolmap.Rig(rig_id=camera_id)
        rig.add_ref_sensor(written.sensor_id)
        database.write_rig(rig, use_rig_id=True)
    for image in images:
        written = pycolmap.Image(name=image.name, camera_id=image.camera_id, image_id=image.image_id)
        database.write_image(written, use_image_id=True)
        frame = pycolmap.Frame(frame_id=image.image_id, rig_id=image.camera_id)
        frame.add_data_id(written.data_id)
        database.write_frame(frame, use_frame_id=True)
