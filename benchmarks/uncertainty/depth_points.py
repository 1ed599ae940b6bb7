"""Depths of keypoints that pairs of posed images triangulate, from the verified matches of a COLMAP database."""

import contextlib
import sqlite3

import numpy as np
import pycolmap

from colmap_lazyloc.pycolmap_types import to_pycolmap_camera

MAX_PAIR = 2147483647
MIN_NUM_MATCHES = 30
MIN_ANGLE_RAD = np.radians(3)


def triangulated_depths(database_path, model) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Returns (pixels, depths) by image; of several pairs that see a keypoint, that with the largest angle counts."""
    with contextlib.closing(sqlite3.connect(f"file:{database_path}?mode=ro", uri=True)) as connection:
        rows = connection.execute("SELECT image_id, name, rows, cols, data FROM keypoints JOIN images USING (image_id)")
        keypoints, name_of = {}, {}
        for image_id, name, num, cols, data in rows:
            if name in model.images and num > 0:
                name_of[image_id] = name
                keypoints[image_id] = np.frombuffer(data, np.float32).reshape(num, cols)[:, :2].astype(float)
        rays = {image_id: _world_rays(model, name_of[image_id], xy) for image_id, xy in keypoints.items()}
        best = {image_id: np.zeros((len(xy), 2)) for image_id, xy in keypoints.items()}  # angle, depth
        query = f"SELECT pair_id, rows, data FROM two_view_geometries WHERE rows >= {MIN_NUM_MATCHES}"
        for pair_id, num, data in connection.execute(query):
            ids = divmod(pair_id, MAX_PAIR)
            if not all(image_id in rays for image_id in ids):
                continue
            matches = np.frombuffer(data, np.uint32).reshape(num, 2)
            for own, other in ((0, 1), (1, 0)):
                _triangulate(model, name_of, rays, best, [(ids[k], matches[:, k]) for k in (own, other)])
    depths = {}
    for image_id, found in best.items():
        is_known = found[:, 1] > 0
        depths[name_of[image_id]] = np.floor(keypoints[image_id][is_known]).astype(int), found[is_known, 1]
    return depths


def _world_rays(model, name, xy):
    image = model.images[name]
    camera: pycolmap.Camera = to_pycolmap_camera(model.cameras[image.camera_id], image.camera_id)
    rays = np.column_stack([camera.cam_from_img(xy), np.ones(len(xy))])
    return (rays / np.linalg.norm(rays, axis=1, keepdims=True)) @ image.cam_from_world.rotation


def _triangulate(model, name_of, rays, best, sides):
    (own, own_points), (other, other_points) = sides
    poses = [model.images[name_of[image_id]].cam_from_world for image_id in (own, other)]
    a, b = rays[own][own_points], rays[other][other_points]
    normal = np.cross(a, b)
    squared = np.sum(normal**2, axis=1)
    baseline = poses[1].cam_in_world - poses[0].cam_in_world
    distance = np.sum(np.cross(baseline, b) * normal, axis=1) / np.maximum(squared, 1e-12)
    points = poses[0].cam_in_world + distance[:, None] * a
    angle, depth = np.arcsin(np.sqrt(np.minimum(squared, 1))), poses[0](points)[:, 2]
    is_better = (
        (angle > MIN_ANGLE_RAD) & (depth > 0) & (poses[1](points)[:, 2] > 0) & (angle > best[own][own_points, 0])
    )
    best[own][own_points[is_better]] = np.column_stack([angle, depth])[is_better]
