"""Aachen Day-Night v1.0 and v1.1 (Sattler et al. 2018, Zhang et al. 2021), as visuallocalization.net distributes them:

    DATA/images_upright/db/1.jpg, query/{day,night}/PHONE/NAME.jpg
    DATA/queries/{day,night}_time_queries_with_intrinsics.txt        `name MODEL width height params...`
    DATA/3D-models/aachen_cvpr2018_db.nvm, database_intrinsics.txt   v1.0
    DATA/3D-models/aachen_v_1_1/{cameras,images,points3D}.bin        v1.1

The queries' poses are not public, so the run writes the file to submit to visuallocalization.net. If hloc's folder
`pairs` is in DATA, its pairs of queries and, for the map, of database images are used:

    DATA/pairs/aachen/pairs-{query-netvlad50,db-covis20}.txt         v1.0
    DATA/pairs/aachen_v1.1/pairs-{query-netvlad50,db-covis20}.txt    v1.1
"""

import pathlib

from benchmarks.localization.datasets.formats import read_nvm, read_query_list, read_source_images
from benchmarks.localization.datasets.scene_source import Options, SceneSource, SourceImage, require
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.pairs import read_pairs

V1_0, V1_1 = "aachen", "aachen_v1.1"
BY_HAND = (
    "Aachen Day-Night is at https://data.ciirc.cvut.cz/public/projects/2020VisualLocalization/Aachen-Day-Night/ "
    "(its terms are at https://www.visuallocalization.net/datasets/)"
)


def scene_names(data_path: pathlib.Path) -> list[str]:
    found = {V1_0: "aachen_cvpr2018_db.nvm", V1_1: "aachen_v_1_1"}
    return [name for name, model in found.items() if (data_path / "3D-models" / model).exists()]


def read_scene(data_path: pathlib.Path, name: str, options: Options) -> SceneSource:
    read = {V1_0: _read_v1_0, V1_1: _read_v1_1}[name]
    database = read(data_path / "3D-models")
    query_paths = sorted((data_path / "queries").glob("*_time_queries_with_intrinsics.txt"))
    if not query_paths:
        raise InputError(f"{data_path / 'queries'} holds no *_time_queries_with_intrinsics.txt: {BY_HAND}")
    queries = {
        query: SourceImage(camera, None)
        for path in query_paths
        for query, camera in list(read_query_list(path).items())[:: options.image_step]
    }
    pairs_paths = [data_path / "pairs" / name / f"pairs-{kind}.txt" for kind in ("query-netvlad50", "db-covis20")]
    pairs = tuple(pair for path in pairs_paths if path.exists() for pair in read_pairs(path))
    image_path = require(data_path / "images_upright", BY_HAND)
    return SceneSource(name, image_path, {**database, **queries}, tuple(queries), pairs or None)


def _read_v1_0(models_path: pathlib.Path) -> dict[str, SourceImage]:
    cameras = read_query_list(require(models_path / "database_intrinsics.txt", BY_HAND))
    nvm_path = require(models_path / "aachen_cvpr2018_db.nvm", BY_HAND)
    images = {}
    for name, nvm_camera in read_nvm(nvm_path).items():
        if name not in cameras:
            raise InputError(f"{models_path / 'database_intrinsics.txt'}: has no camera of {name}")
        images[name] = SourceImage(cameras[name], nvm_camera.cam_from_world)
    return images


def _read_v1_1(models_path: pathlib.Path) -> dict[str, SourceImage]:
    return read_source_images(require(models_path / "aachen_v_1_1", BY_HAND))
