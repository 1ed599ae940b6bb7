"""Generalized relative pose of PoseLib: the query is one camera, the database images are a rig whose frame is the
world; all verified matches of all pairs, LO-RANSAC and refinement. The seconds leave out reading.
"""

import poselib

from geometry import Pose
from matches import QueryMatches
from methods import MethodOptions, Result
from methods.match_based import localize_by
from scenes import Camera, Scene

MAX_ERROR_PX = 4.0
MIN_NUM_MATCHES = 6  # of the minimal solver


def localize(scene: Scene, query_names: list[str], options: MethodOptions) -> dict[str, Result]:
    return localize_by(_generalized_relative_pose, scene, query_names, options)


def _generalized_relative_pose(scene: Scene, camera: Camera, matches: QueryMatches, seed: int) -> Pose | None:
    if sum(len(pair.query_idxs) for pair in matches.pairs) < MIN_NUM_MATCHES:
        return None
    names = [pair.database_name for pair in matches.pairs]
    world_from_query, _ = poselib.estimate_generalized_relative_pose(
        _query_database_matches(matches), [poselib.CameraPose()], [poselib_camera(camera)],
        [poselib_pose(scene.pose(name)) for name in names], [poselib_camera(scene.camera(name)) for name in names],
        {"max_epipolar_error": MAX_ERROR_PX, "seed": seed})
    rotation = world_from_query.R.T
    return Pose(rotation, -rotation @ world_from_query.t)


def _query_database_matches(matches: QueryMatches) -> list:
    """Camera 0 of the first rig is the query, camera i of the second one the i-th pair's database image."""
    all_matches = []
    for i, pair in enumerate(matches.pairs):
        pairwise = poselib.PairwiseMatches()
        pairwise.cam_id1, pairwise.cam_id2 = 0, i
        pairwise.x1 = matches.query_points[pair.query_idxs]
        pairwise.x2 = matches.database_points[pair.database_name][pair.database_idxs]
        all_matches.append(pairwise)
    return all_matches


def poselib_camera(camera: Camera) -> dict:
    return {"model": camera.model, "width": camera.width, "height": camera.height, "params": list(camera.params)}


def poselib_pose(pose: Pose) -> poselib.CameraPose:
    camera_pose = poselib.CameraPose()
    camera_pose.q, camera_pose.t = pose.qvec(), pose.translation
    return camera_pose
