"""Hybrid pose of PoseLib: 2D-3D matches from local triangulation next to the 2D-2D matches of all pairs. The seconds
leave out reading alone.

PoseLib 2.0.5 draws its samples from 2D-3D and 2D-2D matches together but looks them up in the 2D-3D ones (it reads
beyond their end and crashes). So no samples are drawn here: the start is the pose of local triangulation, what remains
is PoseLib's hybrid refinement.
"""

import poselib
import pycolmap

from geometry import Pose
from matches import QueryMatches
from methods import MethodOptions, Result
from methods.local_triangulation import triangulate_query_keypoints
from methods.match_based import localize_by
from methods.poselib_generalized import poselib_camera, poselib_pose
from methods.structure_based import absolute_pose
from scenes import Camera, Scene

MAX_REPROJECTION_ERROR_PX = 8.0
MAX_EPIPOLAR_ERROR_PX = 4.0


def localize(scene: Scene, query_names: list[str], options: MethodOptions) -> dict[str, Result]:
    pycolmap.logging.minloglevel = pycolmap.logging.Level.WARNING.value
    return localize_by(_hybrid_pose, scene, query_names, options)


def _hybrid_pose(scene: Scene, camera: Camera, matches: QueryMatches, seed: int) -> Pose | None:
    points2d, points3d = triangulate_query_keypoints(scene, matches, seed)
    start_pose = absolute_pose(points2d, points3d, camera, seed)
    if start_pose is None:
        return None
    names = [pair.database_name for pair in matches.pairs]
    ransac_options = {"max_reproj_error": MAX_REPROJECTION_ERROR_PX, "max_epipolar_error": MAX_EPIPOLAR_ERROR_PX,
                      "min_iterations": 0, "max_iterations": 0, "seed": seed}
    query_from_world, _ = poselib.estimate_hybrid_pose(
        points2d, points3d, _map_query_matches(matches), poselib_camera(camera),
        [poselib_pose(scene.pose(name)) for name in names], [poselib_camera(scene.camera(name)) for name in names],
        ransac_options, {}, poselib_pose(start_pose))
    return Pose(query_from_world.R, query_from_world.t)


def _map_query_matches(matches: QueryMatches) -> list:
    """Here the database image comes first and the query second."""
    all_matches = []
    for i, pair in enumerate(matches.pairs):
        pairwise = poselib.PairwiseMatches()
        pairwise.cam_id1, pairwise.cam_id2 = i, 0
        pairwise.x1 = matches.database_points[pair.database_name][pair.database_idxs]
        pairwise.x2 = matches.query_points[pair.query_idxs]
        all_matches.append(pairwise)
    return all_matches
