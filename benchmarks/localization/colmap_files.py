"""Makes copies of a scene's database, and models of its posed images, for pycolmap's methods.

The methods get copies, because pycolmap opens databases for writing.
"""

import contextlib
import pathlib
import shutil

import pycolmap

from benchmarks.localization.scenes import Scene
from colmap_lazyloc.database import connect, remove_images
from colmap_lazyloc.pycolmap_types import to_pycolmap_camera, to_rigid3d


def copy_database(scene: Scene, path: pathlib.Path, image_names: list[str] | None = None) -> dict[str, int]:
    """Copies the database, or only the named images of it; returns the image ids by name.

    The copy has no rigs: the given poses do not change, so they are not needed, and a rig that lacks an image cannot
    be loaded.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(scene.database_path, path)
    with contextlib.closing(connect(path, "rw")) as connection, connection:
        ids = dict(connection.execute("SELECT name, image_id FROM images"))
        kept = {name: ids[name] for name in image_names or ids}
        remove_images(connection, set(ids.values()) - set(kept.values()))
        tables = {row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        for table in ("frame_data", "frames", "rig_sensors", "rigs"):
            if table in tables:
                connection.execute(f"DELETE FROM {table}")
    return kept


def build_model(scene: Scene, image_ids: dict[str, int]) -> pycolmap.Reconstruction:
    """Makes a model of the named posed images, without points; every image is a frame of its own."""
    model = pycolmap.Reconstruction()
    camera_ids = sorted({scene.images[name].camera_id for name in image_ids})
    for camera_id in camera_ids:
        model.add_camera_with_trivial_rig(to_pycolmap_camera(scene.cameras[camera_id], camera_id))
    for name, image_id in sorted(image_ids.items(), key=lambda item: item[1]):
        image = pycolmap.Image(name=name, camera_id=scene.images[name].camera_id, image_id=image_id)
        model.add_image_with_trivial_frame(image, to_rigid3d(scene.pose(name)))
    return model
