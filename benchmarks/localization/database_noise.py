"""Adds noise to the database poses of a scene, as in the paper's experiment on noise."""

import dataclasses
import pathlib
import zlib

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.localization.scenes import Scene
from colmap_lazyloc.model import write_model
from colmap_lazyloc.poses import Pose


def add_database_noise(scene: Scene, rotation_deg: float, position_cm: float, seed: int, path: pathlib.Path) -> Scene:
    """Turns each pose by `rotation_deg` about a random axis of the camera and moves it by `position_cm` in a random
    direction. Errors are still measured against the true poses. The noise of an image depends only on its name and the
    seed. The noisy model, which the program reads, is written to `path`.
    """
    images = {}
    for name, image in scene.images.items():
        if image.cam_from_world is not None:
            rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
            pose = noisy_pose(image.cam_from_world, rotation_deg, position_cm / 100, rng)
            image = dataclasses.replace(image, cam_from_world=pose)
        images[name] = image
    write_model(path, scene.cameras, [image for image in images.values() if image.cam_from_world is not None])
    return dataclasses.replace(scene, images=images, true_images=scene.images, noisy_model_path=path)


def noisy_pose(pose: Pose, rotation_deg: float, length: float, rng) -> Pose:
    """Returns the pose turned and moved by exactly these amounts; `length` is in the unit of the world."""
    turn = Rotation.from_rotvec(np.radians(rotation_deg) * _random_direction(rng)).as_matrix()
    return Pose.from_centre(turn @ pose.rotation, pose.cam_in_world + length * _random_direction(rng))


def _random_direction(rng) -> np.ndarray:
    direction = rng.normal(size=3)
    return direction / np.linalg.norm(direction)
