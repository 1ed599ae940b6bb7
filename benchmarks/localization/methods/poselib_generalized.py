"""Generalized relative pose of PoseLib: the query is one camera, and the database images are a rig whose frame is the
world. It uses all verified matches of all pairs, LO-RANSAC and refinement. Reading is not timed.
"""

import numpy as np
import poselib

from benchmarks.localization.matches import QueryMatches
from benchmarks.localization.scenes import Scene
from colmap_lazyloc.model import Camera
from colmap_lazyloc.poses import Pose

MAX_ERROR_PX = 4.0
MIN_NUM_MATCHES = 6  # the minimal solver needs this many


def estimate_pose(scene: Scene, camera: Camera, matches: QueryMatches, seed: int) -> Pose | None:
    if sum(len(pair.query_idxs) for pair in matches.pairs) < MIN_NUM_MATCHES:
        return None
    names = [pair.database_name for pair in matches.pairs]
    world_from_query, _ = poselib.estimate_generalized_relative_pose(
        poselib_matches(matches, query_first=True),
        [poselib.CameraPose()],
        [poselib_camera(camera)],
        [poselib_pose(scene.pose(name)) for name in names],
        [poselib_camera(scene.camera(name)) for name in names],
        {"max_epipolar_error": MAX_ERROR_PX, "seed": seed},
    )
    return Pose.from_centre(world_from_query.R.T, world_from_query.t)


def poselib_matches(matches: QueryMatches, query_first: bool) -> list:
    """Converts matches: camera 0 of one rig is the query; camera i of the other is the i-th pair's database image."""
    all_matches = []
    for i, pair in enumerate(matches.pairs):
        query = 0, matches.query_points[pair.query_idxs]
        other = i, matches.database_points[pair.database_name][pair.database_idxs]
        first, second = (query, other) if query_first else (other, query)
        pairwise = poselib.PairwiseMatches()
        (pairwise.cam_id1, pairwise.x1), (pairwise.cam_id2, pairwise.x2) = first, second
        all_matches.append(pairwise)
    return all_matches


def poselib_camera(camera: Camera) -> dict:
    return {"model": camera.model, "width": camera.width, "height": camera.height, "params": list(camera.params)}


def poselib_pose(pose: Pose) -> poselib.CameraPose:
    camera_pose = poselib.CameraPose()
    camera_pose.q, camera_pose.t = pose.qvec / np.linalg.norm(pose.qvec), pose.tvec
    return camera_pose


def from_poselib(camera_pose: poselib.CameraPose) -> Pose:
    return Pose(np.array(camera_pose.q), np.array(camera_pose.t))
