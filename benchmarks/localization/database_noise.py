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
            turn = Rotation.from_rotvec(np.radians(rotation_deg) * _random_direction(rng)).as_matrix()
            centre = image.cam_from_world.cam_in_world + position_cm / 100 * _random_direction(rng)
            pose = Pose.from_centre(turn @ image.cam_from_world.rotation, centre)
            image = dataclasses.replace(image, cam_from_world=pose)
        images[name] = image
    write_model(path, scene.cameras, [image for image in images.values() if image.cam_from_world is not None])
    return dataclasses.replace(scene, images=images, true_images=scene.images, noisy_model_path=path)


def _random_direction(rng) -> np.ndarray:
    direction = rng.normal(size=3)
    return direction / np.linalg.norm(direction)
