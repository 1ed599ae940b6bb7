"""Generalized relative pose of pycolmap: the query is one camera, the database images are a rig whose frame is the
world; all verified matches of all pairs, RANSAC alone. The seconds leave out reading.
"""

import numpy as np
import pycolmap

from colmap_files import pycolmap_camera, pycolmap_rigid3d
from geometry import Pose
from matches import QueryMatches
from methods import MethodOptions, Result
from methods.match_based import localize_by
from scenes import Camera, Scene

MAX_ERROR_PX = 4.0


def localize(scene: Scene, query_names: list[str], options: MethodOptions) -> dict[str, Result]:
    pycolmap.logging.minloglevel = pycolmap.logging.Level.WARNING.value
    return localize_by(_generalized_relative_pose, scene, query_names, options)


def _generalized_relative_pose(scene: Scene, camera: Camera, matches: QueryMatches, seed: int) -> Pose | None:
    if not matches.pairs:
        return None
    # Camera 0 is the query, alone in its rig; the others are the database images.
    names = [pair.database_name for pair in matches.pairs]
    cams_from_rig = [pycolmap.Rigid3d()] + [pycolmap_rigid3d(scene.pose(name)) for name in names]
    cameras = [pycolmap_camera(camera)] + [pycolmap_camera(scene.camera(name)) for name in names]
    query_points = np.concatenate([matches.query_points[pair.query_idxs] for pair in matches.pairs])
    database_points = np.concatenate(
        [matches.database_points[pair.database_name][pair.database_idxs] for pair in matches.pairs])
    camera_idxs = np.repeat(np.arange(1, len(cameras)), [len(pair.query_idxs) for pair in matches.pairs])
    options = pycolmap.RANSACOptions()
    options.max_error = MAX_ERROR_PX
    options.random_seed = seed
    answer = pycolmap.estimate_generalized_relative_pose(query_points, database_points, [0] * len(query_points),
                                                         camera_idxs.tolist(), cams_from_rig, cameras, options)
    return Pose.from_rigid3d(answer["rig2_from_rig1"].inverse()) if answer else None
