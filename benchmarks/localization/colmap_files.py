"""Copies of a scene's database and models of its posed images, for the methods that are pycolmap's.

pycolmap opens databases for writing, so it is given copies alone.
"""

import pathlib
import shutil
import sqlite3

import pycolmap

from geometry import Pose
from matches import MAX_NUM_IMAGES
from scenes import Camera, Scene


def pycolmap_camera(camera: Camera, camera_id: int = 1) -> pycolmap.Camera:
    return pycolmap.Camera(camera_id=camera_id, model=camera.model, width=camera.width, height=camera.height,
                           params=list(camera.params))


def pycolmap_rigid3d(pose: Pose) -> pycolmap.Rigid3d:
    return pycolmap.Rigid3d(pycolmap.Rotation3d(pose.rotation), pose.translation)


def copy_database(scene: Scene, path: pathlib.Path, image_names: list[str] | None = None) -> dict[str, int]:
    """A copy, with these images alone if names are given; returns the ids of its images.

    Without rigs: the poses are given and stay as they are, and a rig of which an image is missing cannot be loaded.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(scene.database_path, path)
    with sqlite3.connect(path) as connection:
        ids = dict(connection.execute("SELECT name, image_id FROM images"))
        image_ids = {name: ids[name] for name in image_names or ids}
        connection.execute("CREATE TEMP TABLE kept (image_id INTEGER PRIMARY KEY)")
        connection.executemany("INSERT INTO kept VALUES (?)", [(image_id,) for image_id in image_ids.values()])
        tables = {row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        for table in ("matches", "two_view_geometries"):
            connection.execute(f"DELETE FROM {table} WHERE pair_id / {MAX_NUM_IMAGES} NOT IN kept "
                               f"OR pair_id % {MAX_NUM_IMAGES} NOT IN kept")
        for table in ("keypoints", "descriptors", "images"):
            connection.execute(f"DELETE FROM {table} WHERE image_id NOT IN kept")
        for table in ("frame_data", "frames", "rig_sensors", "rigs"):
            if table in tables:
                connection.execute(f"DELETE FROM {table}")
    connection.close()
    return image_ids


def build_model(scene: Scene, image_ids: dict[str, int]) -> pycolmap.Reconstruction:
    """The scene's posed images of these names, without points; every image is a frame of its own."""
    model = pycolmap.Reconstruction()
    camera_ids = sorted({scene.images[name].camera_id for name in image_ids})
    for camera_id in camera_ids:
        model.add_camera_with_trivial_rig(pycolmap_camera(scene.cameras[camera_id], camera_id))
    for name, image_id in sorted(image_ids.items(), key=lambda item: item[1]):
        image = pycolmap.Image(name=name, camera_id=scene.images[name].camera_id, image_id=image_id)
        model.add_image_with_trivial_frame(image, pycolmap_rigid3d(scene.pose(name)))
    return model
