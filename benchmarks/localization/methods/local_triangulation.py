"""Local triangulation: pycolmap's robust triangulation makes a point for each query keypoint, from the matched database
images; pycolmap's absolute pose follows. Only reading is not timed.
"""

import math

import numpy as np
import pycolmap

from benchmarks.localization.matches import QueryMatches
from benchmarks.localization.methods.structure_based import absolute_pose
from benchmarks.localization.scenes import Scene
from colmap_lazyloc.model import Camera
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.pycolmap_types import to_pycolmap_camera, to_rigid3d

MAX_TRIANGULATION_ERROR_PX = 4.0
MIN_TRIANGULATION_ANGLE_DEG = 1.5


def estimate_pose(scene: Scene, camera: Camera, matches: QueryMatches, seed: int) -> Pose | None:
    points2d, points3d = triangulate_query_keypoints(scene, matches, seed)
    return absolute_pose(points2d, points3d, camera, seed)


def triangulate_query_keypoints(scene: Scene, matches: QueryMatches, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns the query's 2D-3D matches: n x 2 keypoints in pixels, n x 3 points."""
    tracks = {}  # query keypoint -> {database image: its keypoint}; the first match of an image counts
    for pair in matches.pairs:
        for query_idx, database_idx in zip(pair.query_idxs.tolist(), pair.database_idxs.tolist()):
            tracks.setdefault(query_idx, {}).setdefault(pair.database_name, database_idx)
    names = [pair.database_name for pair in matches.pairs]
    cams_from_world = {name: to_rigid3d(scene.pose(name)) for name in names}
    cameras = {name: to_pycolmap_camera(scene.camera(name)) for name in names}

    options = pycolmap.EstimateTriangulationOptions()
    options.residual_type = pycolmap.TriangulationResidualType.REPROJECTION_ERROR
    options.min_tri_angle = math.radians(MIN_TRIANGULATION_ANGLE_DEG)
    options.ransac.max_error = MAX_TRIANGULATION_ERROR_PX
    options.ransac.random_seed = seed
    points2d, points3d = [], []
    for query_idx, track in sorted(tracks.items()):
        if len(track) < 2:
            continue
        observations = np.array([matches.database_points[name][idx] for name, idx in track.items()])
        answer = pycolmap.estimate_triangulation(
            observations, [cams_from_world[name] for name in track], [cameras[name] for name in track], options
        )
        if answer:
            points2d.append(matches.query_points[query_idx])
            points3d.append(answer["xyz"])
    return np.array(points2d).reshape(-1, 2), np.array(points3d).reshape(-1, 3)
