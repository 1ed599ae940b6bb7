"""Localization against a 3D map made for each query. COLMAP triangulates the verified matches between the query's K
database images with their poses fixed; the rest is as in structure_based. The seconds include making the map, with
reading of the K images' part of the database, and the pose.
"""

import pathlib
import tempfile
import time

import pycolmap

from benchmarks.localization.colmap_files import copy_database
from benchmarks.localization.matches import MatchDatabase, QueryMatches
from benchmarks.localization.methods import MethodOptions, Result
from benchmarks.localization.methods.structure_based import (
    absolute_pose,
    match_to_map,
    points3d_of_keypoints,
    triangulate_map,
)
from benchmarks.localization.scenes import Scene


def localize(scene: Scene, query_names: list[str], options: MethodOptions) -> dict[str, Result]:
    pycolmap.logging.minloglevel = pycolmap.logging.Level.WARNING.value
    options.work_path.mkdir(parents=True, exist_ok=True)
    results = {}
    with MatchDatabase(scene.database_path) as database, tempfile.TemporaryDirectory(dir=options.work_path) as folder:
        for name in query_names:
            matches = database.query_matches(scene, name, options.num_retrieved)
            results[name] = _localize_one(scene, name, matches, options.seed, pathlib.Path(folder))
    return results


def _localize_one(scene: Scene, query_name: str, matches: QueryMatches, seed: int, work_path: pathlib.Path) -> Result:
    names = [pair.database_name for pair in matches.pairs]
    if not names:
        return Result.lost(0.0, "NO_PAIRS")
    database_path = work_path / "database.db"
    image_ids = copy_database(scene, database_path, [*names, query_name])  # with the query: see structure_based
    start = time.perf_counter()
    model = triangulate_map(scene, database_path, {name: image_ids[name] for name in names}, seed, work_path)
    points2d, points3d = match_to_map(matches, points3d_of_keypoints(model))
    pose = absolute_pose(points2d, points3d, scene.camera(query_name), seed)
    seconds = time.perf_counter() - start
    return Result(pose, seconds) if pose else Result.lost(seconds)
