"""RANSAC over pairs of relative poses (Zhou et al., To Learn or Not to Learn: Visual Localization from Essential
Matrices, ICRA 2020). The relative poses of two database images give the query's position, as the point nearest to
two lines, and two rotations. The hypothesis with which most database images agree wins; the pose is then computed again
from these images. All K (K - 1) hypotheses of K pairs are tried. The relative poses come from pycolmap's calibrated
two-view geometry. Only reading is not timed.
"""

import itertools

import numpy as np
import pycolmap
from scipy.spatial.transform import Rotation

from benchmarks.localization.matches import QueryMatches
from benchmarks.localization.scenes import Scene
from colmap_lazyloc.model import Camera
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.pycolmap_types import to_pycolmap_camera

MAX_DIRECTION_ERROR_DEG = 5.0  # maximum error of a database image that agrees
MIN_SINE_OF_LINES = 1e-3  # minimum sine of the angle between two lines that are intersected


def estimate_pose(scene: Scene, camera: Camera, matches: QueryMatches, seed: int) -> Pose | None:
    rotations, centres, directions = [], [], []
    for pair in matches.pairs:
        query_from_database = _relative_pose(scene, camera, matches, pair, seed)
        if query_from_database is None:
            continue
        database_pose = scene.pose(pair.database_name)
        rotation = query_from_database.rotation.matrix() @ database_pose.rotation
        rotations.append(rotation)
        centres.append(database_pose.cam_in_world)
        direction = -rotation.T @ query_from_database.translation  # from the database image to the query, in the world
        directions.append(direction / np.linalg.norm(direction))
    if len(rotations) < 2:
        return None
    return best_pose(np.array(rotations), np.array(centres), np.array(directions))


def _relative_pose(scene, camera, matches, pair, seed):
    options = pycolmap.TwoViewGeometryOptions()
    options.compute_relative_pose = True
    options.ransac.random_seed = seed
    points = np.arange(len(pair.query_idxs), dtype=np.uint32)
    geometry = pycolmap.estimate_calibrated_two_view_geometry(
        to_pycolmap_camera(scene.camera(pair.database_name)),
        matches.database_points[pair.database_name][pair.database_idxs],
        to_pycolmap_camera(camera),
        matches.query_points[pair.query_idxs],
        np.stack([points, points], axis=1),
        options,
    )
    query_from_database = geometry.cam2_from_cam1
    if query_from_database is None or not np.linalg.norm(query_from_database.translation) > 0:
        return None
    return query_from_database


def best_pose(rotations: np.ndarray, centres: np.ndarray, directions: np.ndarray) -> Pose | None:
    """Returns the pose with which most database images agree; among equals, that with the smallest sum of angles.

    rotations: n x 3 x 3, the query's rotation according to each database image; centres: n x 3, projection centres of
    the database images; directions: n x 3, in the world, from these to the query.
    """
    best = (0, 0.0), None
    for i, j in itertools.permutations(range(len(rotations)), 2):
        if np.linalg.norm(np.cross(directions[i], directions[j])) < MIN_SINE_OF_LINES:
            continue
        rotation, centre = rotations[i], _nearest_point(centres[[i, j]], directions[[i, j]])
        agrees, score = _agreement(rotation, centre, rotations, centres, directions)
        if score > best[0]:
            best = score, agrees
    if best[1] is None:
        return None
    agrees = best[1]
    rotation = Rotation.from_matrix(rotations[agrees]).mean().as_matrix()
    return Pose.from_centre(rotation, _nearest_point(centres[agrees], directions[agrees]))


def _agreement(rotation, centre, rotations, centres, directions):
    """Returns which database images agree with the pose, and a score that is larger for a better pose.

    An image agrees if its direction to the query is right. Both directions are rotated to the query's frame, the true
    one by `rotation`, the other by the image's own estimate.
    """
    seen = centre - centres
    seen = (seen / np.linalg.norm(seen, axis=1, keepdims=True)) @ rotation.T
    stated = np.einsum("nij,nj->ni", rotations, directions)
    angles_deg = np.degrees(np.arccos(np.clip(np.sum(seen * stated, axis=1), -1, 1)))
    agrees = angles_deg <= MAX_DIRECTION_ERROR_DEG
    return agrees, (int(agrees.sum()), -float(angles_deg[agrees].sum()))


def _nearest_point(centres, directions) -> np.ndarray:
    """Returns the point nearest to the lines, in the least-squares sense."""
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    return np.linalg.lstsq(across.sum(axis=0), np.einsum("nij,nj->i", across, centres), rcond=None)[0]
