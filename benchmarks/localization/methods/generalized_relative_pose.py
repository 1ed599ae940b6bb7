"""Generalized relative pose of pycolmap: the query is one camera, and the database images are a rig whose frame is the
world. It uses all verified matches of all pairs, and RANSAC without refinement. Reading is not timed.
"""

import numpy as np
import pycolmap

from benchmarks.localization.matches import QueryMatches
from benchmarks.localization.scenes import Scene
from colmap_lazyloc.model import Camera
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.pycolmap_types import to_pycolmap_camera, to_rigid3d

MAX_ERROR_PX = 4.0


def estimate_pose(scene: Scene, camera: Camera, matches: QueryMatches, seed: int) -> Pose | None:
    if not matches.pairs:
        return None
    # Camera 0 is the query, alone in its rig; the others are the database images.
    names = [pair.database_name for pair in matches.pairs]
    cams_from_rig = [pycolmap.Rigid3d()] + [to_rigid3d(scene.pose(name)) for name in names]
    cameras = [to_pycolmap_camera(camera)] + [to_pycolmap_camera(scene.camera(name)) for name in names]
    query_points = np.concatenate([matches.query_points[pair.query_idxs] for pair in matches.pairs])
    database_points = np.concatenate(
        [matches.database_points[pair.database_name][pair.database_idxs] for pair in matches.pairs]
    )
    camera_idxs = np.repeat(np.arange(1, len(cameras)), [len(pair.query_idxs) for pair in matches.pairs])
    options = pycolmap.RANSACOptions()
    options.max_error = MAX_ERROR_PX
    options.random_seed = seed
    answer = pycolmap.estimate_generalized_relative_pose(
        query_points, database_points, [0] * len(query_points), camera_idxs.tolist(), cams_from_rig, cameras, options
    )
    # One database image gives the key pano2_from_pano1, a pose without scale.
    has_scale = answer is not None and "rig2_from_rig1" in answer
    return Pose.of(answer["rig2_from_rig1"].inverse()) if has_scale else None
