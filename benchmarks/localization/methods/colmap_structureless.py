"""COLMAP 4's structure-less registration: pycolmap's incremental mapping with the database images' frames fixed, one
query at a time. It uses all pairs, not K. The whole call is timed, including reading.
"""

import pathlib
import shutil
import tempfile
import time

import pycolmap

from benchmarks.localization.colmap_files import build_model, copy_database
from benchmarks.localization.methods import MethodOptions, Result
from benchmarks.localization.scenes import Scene
from colmap_lazyloc.poses import Pose


def localize(scene: Scene, query_names: list[str], options: MethodOptions) -> dict[str, Result]:
    pycolmap.logging.minloglevel = pycolmap.logging.Level.FATAL.value
    options.work_path.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=options.work_path) as folder:
        return {name: _localize_one(scene, name, options.seed, pathlib.Path(folder)) for name in query_names}


def _localize_one(scene: Scene, query_name: str, seed: int, work_path: pathlib.Path) -> Result:
    database_names = scene.database_names(query_name)
    database_path, model_path, output_path = (work_path / name for name in ("database.db", "model", "output"))
    for path in (model_path, output_path):
        shutil.rmtree(path, ignore_errors=True)
        path.mkdir()
    image_ids = copy_database(scene, database_path, [*database_names, query_name])
    build_model(scene, {name: image_ids[name] for name in database_names}).write(model_path)

    start = time.perf_counter()
    models = pycolmap.incremental_mapping(
        database_path, scene.path / "images", output_path, _mapping_options(seed), input_path=model_path
    )
    seconds = time.perf_counter() - start
    for model in models.values():
        image = model.find_image_with_name(query_name)
        if image is not None and image.has_pose:
            return Result(Pose.of(image.cam_from_world()), seconds)
    return Result.lost(seconds, "NOT_REGISTERED")


def _mapping_options(seed: int) -> pycolmap.IncrementalPipelineOptions:
    options = pycolmap.IncrementalPipelineOptions()
    options.structure_less_registration_only = True
    options.fix_existing_frames = True
    options.multiple_models = False
    options.extract_colors = False
    options.num_threads = 1
    options.random_seed = seed
    # Keep the intrinsics constant, because they are known.
    options.ba_refine_focal_length = options.ba_refine_principal_point = options.ba_refine_extra_params = False
    options.mapper.abs_pose_refine_focal_length = options.mapper.abs_pose_refine_extra_params = False
    return options
