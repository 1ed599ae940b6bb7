"""Writes databases of synthetic scenes with pycolmap 4.

This is a separate module, because importing pycolmap takes a second.
"""

import pathlib

import pycolmap

from colmap_lazyloc.pycolmap_types import write_images
from colmap_lazyloc.testing import synthetic
from colmap_lazyloc.text_files import Path


def write_pycolmap_database(path: Path, scene: synthetic.Scene, geometry: str | None = "pose") -> pathlib.Path:
    """Writes a database with pycolmap 4: its schema, one rig per camera, one frame per image."""
    with pycolmap.Database.open(str(path)) as database:
        write_images(
            database,
            {camera.camera_id: camera.intrinsics() for camera in scene.cameras.values()},
            synthetic.stored_images(scene, scene.images),
        )
        for image in scene.images.values():
            database.write_keypoints(image.image_id, image.keypoints)
        for (name1, name2), pair in scene.pairs.items():
            id1, id2 = scene.images[name1].image_id, scene.images[name2].image_id
            database.write_matches(id1, id2, pair.matches)
            if geometry is not None:
                database.write_two_view_geometry(id1, id2, _pycolmap_geometry(pair, geometry))
    return pathlib.Path(path)


def _pycolmap_geometry(pair: synthetic.Pair, geometry: str) -> pycolmap.TwoViewGeometry:
    written = pycolmap.TwoViewGeometry()
    written.config = pycolmap.TwoViewGeometryConfiguration(pair.config)
    written.E = pair.essential_matrix()
    written.inlier_matches = pair.inlier_matches
    if geometry == "pose":
        written.cam2_from_cam1 = pycolmap.Rigid3d(pycolmap.Rotation3d(pair.rotation.as_quat()), pair.direction)
    return written
