"""Makes synthetic scenes of a stereo camera that drives straight ahead. The true poses are known exactly.

A scene states wrong poses, if wanted, in two ways: the calibration of the rig is off (in the rig configuration, or in
the database as well), or the database poses are (frames moved as a whole, or each image by itself).
"""

import dataclasses
import itertools
import json
import pathlib

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.localization.scenes import Protocol, Scene
from colmap_lazyloc.model import Image
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.testing import synthetic

PREFIXES = ("left/", "right/")
NUM_FRAMES, DISTANCE_OF_FRAMES, BASELINE = 40, 1.0, 0.54
FOCAL_LENGTH_PX, MEDIAN_DEPTH, MAX_DEPTH = 700.0, 15.0, 45.0
KEYPOINT_NOISE_PX = 0.5
MAX_NUM_FRAMES_BETWEEN = 6  # images further apart are not matched


@dataclasses.dataclass(frozen=True)
class Errors:
    """What is wrong in the stated poses. Pixels mean the displacement of keypoints by the rotation, and by the
    position.
    """

    calibration_deg: float = 0  # rotation of the right camera about a random axis
    baseline_ratio: float = 0  # error of the baseline's length
    is_in_database: bool = True  # True if the database poses have the error of the calibration too
    frames_px: float = 0  # error of each database frame
    images_px: float = 0  # error of each database image


CASES = {
    "exact": Errors(),
    "calibration off by 0.02°, 0.1 %": Errors(0.02, 0.001),
    "calibration off by 0.05°, 0.5 %": Errors(0.05, 0.005),
    "query calibration off by 0.02°, 0.1 %": Errors(0.02, 0.001, is_in_database=False),
    "query calibration off by 0.05°, 0.5 %": Errors(0.05, 0.005, is_in_database=False),
    "database frames off by 0.3 px": Errors(frames_px=0.3),
    "database frames off by 1 px": Errors(frames_px=1),
    "database images off by 0.3 px": Errors(images_px=0.3),
    "database images off by 1 px": Errors(images_px=1),
    "frames off by 0.3 px, calibration by 0.02°, 0.1 %": Errors(0.02, 0.001, frames_px=0.3),
}


def make_scene(path: pathlib.Path, errors: Errors, seed: int) -> Scene:
    """Writes the database and the rig configuration of a scene. Every third frame should be in the database."""
    rng = np.random.default_rng(seed)
    path.mkdir(parents=True)
    right_from_left = Pose.from_matrix(np.eye(3), [-BASELINE, 0, 0])
    made = _observe(_street(rng), _drive(rng), right_from_left, rng)
    synthetic.write_database(path / "database.db", made)
    stated_right_from_left = _disturbed_calibration(right_from_left, errors, rng)
    _write_rig_config(path / "rig_config.json", stated_right_from_left)
    true_images = {image.name: image for image in synthetic.stored_images(made, sorted(made.images))}
    stated_offset = stated_right_from_left if errors.is_in_database else right_from_left
    stated_images = _stated(true_images, stated_offset, errors, rng)
    cameras = {camera.camera_id: camera.intrinsics() for camera in made.cameras.values()}
    candidates = tuple(sorted(true_images))
    return Scene(path.name, path, Protocol(), cameras, stated_images, candidates, true_images=true_images)


def _street(rng: np.random.Generator) -> np.ndarray:
    """Returns points of two rows of houses and of the road."""
    length = NUM_FRAMES * DISTANCE_OF_FRAMES + MAX_DEPTH
    houses = np.stack([rng.uniform(6, 14, 1600), rng.uniform(-6, 1.6, 1600), rng.uniform(0, length, 1600)], axis=1)
    houses[::2, 0] *= -1
    road = np.stack([rng.uniform(-5, 5, 400), np.full(400, 1.6), rng.uniform(0, length, 400)], axis=1)
    return np.concatenate([houses, road])


def _drive(rng: np.random.Generator) -> list[Pose]:
    poses = []
    for i in range(NUM_FRAMES):
        rotation = Rotation.from_rotvec(np.radians([0.3, 1.0, 0.3]) * rng.standard_normal(3)).as_matrix()
        poses.append(Pose.from_centre(rotation, np.array([0, 0, i * DISTANCE_OF_FRAMES]) + 0.05 * rng.normal(size=3)))
    return poses


def _right_pose(right_from_left: Pose, left_pose: Pose) -> Pose:
    tvec = right_from_left.rotation @ left_pose.tvec + right_from_left.tvec
    return Pose.from_matrix(right_from_left.rotation @ left_pose.rotation, tvec)


def _observe(points, left_poses, right_from_left, rng) -> synthetic.Scene:
    scene = synthetic.Scene({}, {}, {}, [])
    for camera_id in (1, 2):
        scene.cameras[camera_id] = synthetic.Camera(camera_id, "PINHOLE", 1226, 370, [FOCAL_LENGTH_PX] * 2 + [613, 185])
    for i, left_pose in enumerate(left_poses):
        for prefix, camera_id, pose in zip(
            PREFIXES, (1, 2), (left_pose, _right_pose(right_from_left, left_pose)), strict=True
        ):
            depths = pose(points)[:, 2]
            near = np.where(((depths > 2) & (depths < MAX_DEPTH))[:, None], points, np.nan)
            keypoints, owners = synthetic.observe(
                scene.cameras[camera_id], pose, near, KEYPOINT_NOISE_PX, visible_ratio=0.6, rng=rng
            )
            name = f"{prefix}{i:06d}.png"
            scene.images[name] = synthetic.Image(name, len(scene.images) + 1, camera_id, pose, keypoints, owners)
    for image1, image2 in itertools.combinations(scene.images.values(), 2):
        if abs(image1.image_id - image2.image_id) < 2 * (MAX_NUM_FRAMES_BETWEEN + 1):
            scene.pairs[image1.name, image2.name] = synthetic.match(image1, image2, 0, rng)
    return scene


def _noise(stddev_px: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    stddev_rad = stddev_px / FOCAL_LENGTH_PX
    return stddev_rad * rng.standard_normal(3), MEDIAN_DEPTH * stddev_rad * rng.standard_normal(3)


def _moved(pose: Pose, rotvec: np.ndarray, displacement: np.ndarray) -> Pose:
    return Pose.from_centre(Rotation.from_rotvec(rotvec).as_matrix() @ pose.rotation, pose.cam_in_world + displacement)


def _disturbed_calibration(right_from_left: Pose, errors: Errors, rng: np.random.Generator) -> Pose:
    axis, sign = rng.standard_normal(3), rng.choice([-1, 1])
    rotvec = np.radians(errors.calibration_deg) * axis / np.linalg.norm(axis)
    return _moved(right_from_left, rotvec, sign * errors.baseline_ratio * right_from_left.cam_in_world)


def _write_rig_config(path: pathlib.Path, right_from_left: Pose):
    qvec = Rotation.from_matrix(right_from_left.rotation).as_quat(scalar_first=True)
    offset = {"cam_from_rig_rotation": qvec.tolist(), "cam_from_rig_translation": right_from_left.tvec.tolist()}
    cameras = [{"image_prefix": PREFIXES[0], "ref_sensor": True}, {"image_prefix": PREFIXES[1], **offset}]
    path.write_text(json.dumps([{"cameras": cameras}]))


def _stated(true_images: dict[str, Image], right_from_left: Pose, errors: Errors, rng) -> dict[str, Image]:
    stated = {}
    for name in sorted(name for name in true_images if name.startswith(PREFIXES[0])):
        left_pose = _moved(true_images[name].cam_from_world, *_noise(errors.frames_px, rng))
        for image_name, pose in ((name, left_pose), (name.replace(*PREFIXES), _right_pose(right_from_left, left_pose))):
            given = _moved(pose, *_noise(errors.images_px, rng))
            stated[image_name] = dataclasses.replace(true_images[image_name], cam_from_world=given)
    return stated
