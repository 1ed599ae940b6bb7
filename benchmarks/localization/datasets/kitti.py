"""KITTI odometry (Geiger et al. 2012), in the layout of its archives (grey images, calibration, ground truth):

    DATA/sequences/04/image_0/000000.png, image_1/000000.png    rectified stereo pairs
    DATA/sequences/04/calib.txt                                 `P0: ` and 12 numbers: K [I | t] of each camera
    DATA/poses/04.txt                                           12 numbers per frame: 3x4 world_from_cam0

Database: both images of every third frame; queries: the left images of the other frames. A query is paired with the
database images that are at most 10 frames away, because the order of the frames in a video is known.
"""

import pathlib

import numpy as np

from benchmarks.localization.datasets.formats import image_size, pose_of_matrix
from benchmarks.localization.datasets.scene_source import Options, SceneSource, SourceImage, require
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.text_files import parse_numbers

DATABASE_STEP = 3
MAX_FRAME_DISTANCE = 10
BY_HAND = (
    "KITTI odometry is at https://www.cvlibs.net/datasets/kitti/eval_odometry.php (CC BY-NC-SA 3.0, by e-mail): "
    "unpack grey images, calibration files and ground truth poses"
)


def scene_names(data_path: pathlib.Path) -> list[str]:
    return sorted(
        path.parent.name
        for path in (data_path / "sequences").glob("*/calib.txt")
        if (data_path / "poses" / f"{path.parent.name}.txt").exists()
    )


def read_scene(data_path: pathlib.Path, name: str, options: Options) -> SceneSource:
    sequence_path = require(data_path / "sequences" / name, BY_HAND)
    left_from_world = read_poses(require(data_path / "poses" / f"{name}.txt", BY_HAND))
    width, height = image_size(sequence_path / "image_0" / "000000.png")
    cameras = {}
    for side, projection in read_calibration(require(sequence_path / "calib.txt", BY_HAND)).items():
        cameras[side] = _camera(projection, width, height), np.linalg.solve(projection[:, :3], projection[:, 3])

    images, queries, database = {}, {}, {}
    for frame, pose in enumerate(left_from_world):
        is_database = frame % DATABASE_STEP == 0
        if not is_database and frame % options.image_step != 0:
            continue
        for side in ("image_0", "image_1") if is_database else ("image_0",):
            image_name = f"{side}/{frame:06d}.png"
            camera, cam_from_left = cameras[side]
            images[image_name] = SourceImage(camera, Pose(pose.qvec, pose.tvec + cam_from_left))
            (database if is_database else queries)[image_name] = frame
    pairs = tuple(
        (query, other)
        for query, frame in queries.items()
        for other, other_frame in database.items()
        if abs(frame - other_frame) <= MAX_FRAME_DISTANCE
    )
    return SceneSource(name, sequence_path, images, tuple(queries), pairs)


def read_poses(path: pathlib.Path) -> list[Pose]:
    """Reads cam_from_world of the left camera, frame by frame."""
    lines = (line for line in path.read_text().splitlines() if line.strip())
    return [pose_of_matrix(np.array(parse_numbers(path, line, 12)).reshape(3, 4)) for line in lines]


def read_calibration(path: pathlib.Path) -> dict[str, np.ndarray]:
    """Reads the 3x4 projection matrices of the two grey cameras, by the folder of their images."""
    projections = {}
    for line in path.read_text().splitlines():
        key, _, values = line.partition(":")
        if key in ("P0", "P1"):
            projections[f"image_{key[1]}"] = np.array(parse_numbers(path, values, 12)).reshape(3, 4)
    if len(projections) != 2:
        raise InputError(f"{path}: expected the lines P0 and P1")
    return projections


def _camera(projection: np.ndarray, width: int, height: int) -> Camera:
    # Shift the principal point, because the centre of KITTI's first pixel is (0, 0) and that of COLMAP's is (0.5, 0.5).
    fx, fy, cx, cy = projection[0, 0], projection[1, 1], projection[0, 2] + 0.5, projection[1, 2] + 0.5
    return Camera("PINHOLE", width, height, (float(fx), float(fy), float(cx), float(cy)))
