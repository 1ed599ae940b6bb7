"""The courtyard that scripts/make_demo_scene.py renders, with exact poses:

    DATA/images/{database,query}/*.jpg
    DATA/database_model/{cameras,images}.txt
    DATA/queries_with_intrinsics.txt, ground_truth/poses.txt    `name qw qx qy qz tx ty tz`
"""

import pathlib

from datasets.formats import lines_of, read_model, read_query_list
from datasets.scene_source import Options, SceneSource, SourceImage, numbers, require
from geometry import Pose

BY_HAND = "scripts/make_demo_scene.py --output_path DATA makes the scene"


def scene_names(data_path: pathlib.Path) -> list[str]:
    return ["demo"] if (data_path / "database_model").exists() else []


def read_scene(data_path: pathlib.Path, name: str, options: Options) -> SceneSource:
    images = read_model(require(data_path / "database_model", BY_HAND))
    poses_path = require(data_path / "ground_truth" / "poses.txt", BY_HAND)
    poses = {}
    for line in lines_of(poses_path):
        query, *values = line.rsplit(maxsplit=7)
        values = numbers(poses_path, " ".join(values), 7)
        poses[query] = Pose.from_qvec_tvec(values[:4], values[4:])
    cameras = read_query_list(require(data_path / "queries_with_intrinsics.txt", BY_HAND))
    queries = {query: SourceImage(camera, poses[query])
               for query, camera in list(cameras.items())[:: options.image_step]}
    return SceneSource(name, data_path / "images", {**images, **queries}, tuple(queries))
