"""Hybrid pose of PoseLib: 2D-3D matches from local triangulation together with the 2D-2D matches of all pairs. Only
reading is not timed.

No samples are drawn here, because PoseLib 2.0.5 draws them from the 2D-3D and 2D-2D matches together but looks them up
in the 2D-3D matches only, so that it reads beyond their end and crashes. Instead, PoseLib's hybrid refinement starts
from the pose of local triangulation.
"""

import poselib

from benchmarks.localization.matches import QueryMatches
from benchmarks.localization.methods.local_triangulation import triangulate_query_keypoints
from benchmarks.localization.methods.poselib_generalized import (
    from_poselib,
    poselib_camera,
    poselib_matches,
    poselib_pose,
)
from benchmarks.localization.methods.structure_based import absolute_pose
from benchmarks.localization.scenes import Scene
from colmap_lazyloc.model import Camera
from colmap_lazyloc.poses import Pose

MAX_REPROJECTION_ERROR_PX = 8.0
MAX_EPIPOLAR_ERROR_PX = 4.0


def estimate_pose(scene: Scene, camera: Camera, matches: QueryMatches, seed: int) -> Pose | None:
    points2d, points3d = triangulate_query_keypoints(scene, matches, seed)
    start_pose = absolute_pose(points2d, points3d, camera, seed)
    if start_pose is None:
        return None
    names = [pair.database_name for pair in matches.pairs]
    ransac_options = {
        "max_reproj_error": MAX_REPROJECTION_ERROR_PX,
        "max_epipolar_error": MAX_EPIPOLAR_ERROR_PX,
        "min_iterations": 0,
        "max_iterations": 0,
        "seed": seed,
    }
    query_from_world, _ = poselib.estimate_hybrid_pose(
        points2d,
        points3d,
        poselib_matches(matches, query_first=False),
        poselib_camera(camera),
        [poselib_pose(scene.pose(name)) for name in names],
        [poselib_camera(scene.camera(name)) for name in names],
        ransac_options,
        {},
        poselib_pose(start_pose),
    )
    return from_poselib(query_from_world)
