"""Scenes whose database poses are not exact: the paper's experiment on noise."""

import dataclasses
import pathlib
import zlib

import numpy as np
from scipy.spatial.transform import Rotation

from geometry import Pose
from scenes import Scene


def add_database_noise(scene: Scene, rotation_deg: float, position_cm: float, seed: int, path: pathlib.Path) -> Scene:
    """Each pose is turned by `rotation_deg` about a random axis of the camera and moved by `position_cm` in a random
    direction; errors are still measured against the true poses. The noise of an image depends on its name and the
    seed alone. The model that the program reads is written into `path`.
    """
    images = {}
    for name, image in scene.images.items():
        if image.cam_from_world is not None:
            rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
            turn = Rotation.from_rotvec(np.radians(rotation_deg) * _random_direction(rng)).as_matrix()
            rotation = turn @ image.cam_from_world.rotation
            centre = image.cam_from_world.cam_in_world() + position_cm / 100 * _random_direction(rng)
            pose = Pose(rotation, -rotation @ centre)
            values = " ".join(f"{value:.17g}" for value in [*pose.qvec(), *pose.translation])
            line = f"{image.line.split(maxsplit=1)[0]} {values} {image.camera_id} {name}"
            image = dataclasses.replace(image, cam_from_world=pose, line=line)
        images[name] = image
    path.mkdir(parents=True, exist_ok=True)
    (path / "images.txt").write_text("".join(f"{image.line}\n\n" for image in images.values() if image.line))
    (path / "cameras.txt").write_bytes((scene.model_path / "cameras.txt").read_bytes())
    (path / "points3D.txt").write_text("")
    return dataclasses.replace(scene, images=images, true_images=scene.images, noisy_model_path=path)


def _random_direction(rng) -> np.ndarray:
    direction = rng.normal(size=3)
    return direction / np.linalg.norm(direction)
