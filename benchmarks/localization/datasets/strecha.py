"""Strecha et al. 2008 (fountain-P11, Herz-Jesu-P25, castle-P19, ...), in the layout of its archives:

    DATA/fountain-P11/images/0000.jpg
    DATA/fountain-P11/gt_dense_cameras/0000.jpg.camera    26 numbers: K (3x3), 3 zeros, R (3x3), centre, width, height

R is world_from_cam. Each image is localized against all others (leave-one-out).
"""

import pathlib

import numpy as np

from benchmarks.localization.datasets.formats import pose_of_matrix
from benchmarks.localization.datasets.scene_source import Options, SceneSource, SourceImage
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.text_files import parse_numbers

BY_HAND = (
    "the images and gt_dense_cameras of Strecha et al. 2008 are no longer at EPFL; put a copy into "
    "SCENE/images and SCENE/gt_dense_cameras"
)


def scene_names(data_path: pathlib.Path) -> list[str]:
    return sorted(path.parent.name for path in data_path.glob("*/gt_dense_cameras"))


def read_scene(data_path: pathlib.Path, name: str, options: Options) -> SceneSource:
    scene_path = data_path / name
    paths = sorted((scene_path / "gt_dense_cameras").glob("*.camera"))[:: options.image_step]
    if not paths:
        raise InputError(f"{scene_path / 'gt_dense_cameras'} holds no *.camera: {BY_HAND}")
    images = {path.name.removesuffix(".camera"): read_camera(path) for path in paths}
    return SceneSource(name, scene_path / "images", images, tuple(images), leave_one_out=True)


def read_camera(path: pathlib.Path) -> SourceImage:
    values = np.array(parse_numbers(path, path.read_text(), 26))
    k, world_from_cam_rotation, cam_in_world = values[:9].reshape(3, 3), values[12:21].reshape(3, 3), values[21:24]
    # Shift the principal point, because the centre of the first pixel is (0, 0) here and (0.5, 0.5) in COLMAP.
    params = (k[0, 0], k[1, 1], k[0, 2] + 0.5, k[1, 2] + 0.5)
    camera = Camera("PINHOLE", int(values[24]), int(values[25]), tuple(map(float, params)))
    return SourceImage(camera, pose_of_matrix(np.column_stack([world_from_cam_rotation, cam_in_world])))
