"""The courtyard that `lazyloc demo` renders, with exact poses:

DATA/images/{database,query}/*.jpg
DATA/database_model/{cameras,images}.txt
DATA/queries_with_intrinsics.txt, ground_truth/poses.txt    `name qw qx qy qz tx ty tz`
"""

import pathlib

from benchmarks.localization.datasets.formats import read_query_list, read_source_images
from benchmarks.localization.datasets.scene_source import Options, SceneSource, SourceImage, require
from colmap_lazyloc.poses import read_poses

BY_HAND = "lazyloc demo --output_path DATA makes the scene"


def scene_names(data_path: pathlib.Path) -> list[str]:
    return ["demo"] if (data_path / "database_model").exists() else []


def read_scene(data_path: pathlib.Path, name: str, options: Options) -> SceneSource:
    images = read_source_images(require(data_path / "database_model", BY_HAND))
    poses_path = require(data_path / "ground_truth" / "poses.txt", BY_HAND)
    poses = read_poses(poses_path)
    cameras = read_query_list(require(data_path / "queries_with_intrinsics.txt", BY_HAND))
    queries = {
        query: SourceImage(camera, poses[query]) for query, camera in list(cameras.items())[:: options.image_step]
    }
    return SceneSource(name, data_path / "images", {**images, **queries}, tuple(queries))
