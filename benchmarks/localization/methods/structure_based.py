"""Localization against a 3D map. COLMAP triangulates the verified matches of the database images with their poses
fixed; the query's matches give 2D-3D matches for COLMAP's absolute pose. Making the map and reading are not timed.
"""

import pathlib
import time

import numpy as np
import pycolmap

from benchmarks.localization.colmap_files import build_model, copy_database
from benchmarks.localization.matches import MatchDatabase, QueryMatches
from benchmarks.localization.methods import MethodOptions, Result
from benchmarks.localization.scenes import Camera, Scene
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.pycolmap_types import to_pycolmap_camera

MAX_ERROR_PX = 8.0


def localize(scene: Scene, query_names: list[str], options: MethodOptions) -> dict[str, Result]:
    pycolmap.logging.minloglevel = pycolmap.logging.Level.WARNING.value
    results = {}
    with MatchDatabase(scene.database_path) as database:
        maps = _MapStore(scene, options)
        for name in query_names:
            points3d_of_keypoints = maps.points3d_of_keypoints(name)
            matches = database.query_matches(scene, name, options.num_retrieved)
            start = time.perf_counter()
            points2d, points3d = match_to_map(matches, points3d_of_keypoints)
            pose = absolute_pose(points2d, points3d, scene.camera(name), options.seed)
            seconds = time.perf_counter() - start
            results[name] = Result(pose, seconds) if pose else Result.lost(seconds)
    return results


def match_to_map(matches: QueryMatches, points3d_of_keypoints: dict) -> tuple[np.ndarray, np.ndarray]:
    """Returns the distinct 2D-3D matches: n x 2 query keypoints in pixels, n x 3 points of the map."""
    links = {}
    for pair in matches.pairs:
        point_ids, points = points3d_of_keypoints[pair.database_name]
        for query_idx, database_idx in zip(pair.query_idxs, pair.database_idxs):
            if point_ids[database_idx] >= 0:
                links[query_idx, point_ids[database_idx]] = points[database_idx]
    query_idxs = np.array([query_idx for query_idx, _ in links], dtype=np.int64)
    return matches.query_points[query_idxs], np.array(list(links.values())).reshape(-1, 3)


def absolute_pose(points2d: np.ndarray, points3d: np.ndarray, camera: Camera, seed: int) -> Pose | None:
    if len(points2d) < 3:
        return None
    options = pycolmap.AbsolutePoseEstimationOptions()
    options.ransac.max_error = MAX_ERROR_PX
    options.ransac.random_seed = seed
    answer = pycolmap.estimate_and_refine_absolute_pose(points2d, points3d, to_pycolmap_camera(camera), options)
    return Pose.of(answer["cam_from_world"]) if answer else None


class _MapStore:
    """The triangulated maps, kept in the method's folder; the last one stays in memory."""

    def __init__(self, scene: Scene, options: MethodOptions):
        self._scene = scene
        self._options = options
        self._key = None
        self._points3d_of_keypoints = None

    def points3d_of_keypoints(self, query_name: str) -> dict:
        key = self._scene.database_key(query_name)
        if key != self._key:
            path = self._options.work_path / key
            if not (path / "points3D.bin").exists():
                self._triangulate(query_name, path)
            self._points3d_of_keypoints = points3d_of_keypoints(pycolmap.Reconstruction(path))
            self._key = key
        return self._points3d_of_keypoints

    def _triangulate(self, query_name: str, path: pathlib.Path):
        database_path = path / "database.db"
        # Keep all images, also the query, as if `colmap point_triangulator` ran on the database. By default COLMAP
        # drops points that only two images match; this way it keeps those that the query matches too, so the map is
        # better. The query adds no observation to the map, because it has no pose.
        image_ids = copy_database(self._scene, database_path)
        database_image_ids = {name: image_ids[name] for name in self._scene.database_names(query_name)}
        triangulate_map(self._scene, database_path, database_image_ids, self._options.seed, path)
        database_path.unlink()


def triangulate_map(
    scene: Scene, database_path: pathlib.Path, image_ids: dict[str, int], seed: int, output_path: pathlib.Path
) -> pycolmap.Reconstruction:
    """Triangulates the verified matches of the images with their poses fixed."""
    options = pycolmap.IncrementalPipelineOptions()
    options.extract_colors = False
    options.num_threads = 1
    options.random_seed = seed
    return pycolmap.triangulate_points(
        build_model(scene, image_ids), database_path, scene.path / "images", output_path, options=options
    )


def points3d_of_keypoints(model: pycolmap.Reconstruction) -> dict:
    """Returns the point id (or -1) and the point of each keypoint, by image name."""
    points3d = {}
    for image in model.images.values():
        point_ids = np.full(len(image.points2D), -1, dtype=np.int64)
        points = np.full((len(image.points2D), 3), np.nan)
        for idx, point2d in enumerate(image.points2D):
            if point2d.has_point3D():
                point_ids[idx] = point2d.point3D_id
                points[idx] = model.points3D[point2d.point3D_id].xyz
        points3d[image.name] = (point_ids, points)
    return points3d
