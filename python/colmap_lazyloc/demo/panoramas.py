"""Renders a walk with a 360° camera through the demo's courtyard, later panoramas, and photos of a phone.

Writes below the output folder:
  walk/NAME.jpg, poses.csv     equirectangular panoramas, and their poses
  new/NAME.jpg                 later panoramas, the queries
  truth.txt                    `name qw qx qy qz tx ty tz` of the later panoramas, cam_from_world
  photos/NAME.jpg, camera.txt  photos of a phone, and their `MODEL width height params...`
  photos_truth.txt             their poses
"""

import csv
import pathlib

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.demo.renderer import RayGrid, Rectangle, render
from colmap_lazyloc.demo.scene import View, build_scene, photograph, sky, upright_pose, write_images
from colmap_lazyloc.model import Camera
from colmap_lazyloc.panoramas import rotation_of_angles
from colmap_lazyloc.poses import Pose, write_poses

WIDTH = 1280
RENDERED = Camera("PINHOLE", 480, 480, (230.0, 230.0, 240.0, 240.0))  # of a face: finer and wider than a panorama needs
CUBE = ((0, 0), (90, 0), (180, 0), (270, 0), (0, 90), (0, -90))  # degrees to the right and upwards
PHONE = Camera("SIMPLE_RADIAL", 640, 480, (520.0, 320.0, 240.0, -0.03))
WALK = ((-4.4, -2.6), (-1.8, -3.2), (1.0, -3.0), (3.8, -2.6), (4.6, 0.2), (2.2, 1.8), (-1.0, 2.2), (-3.8, 0.8))
NEW = ((-3.2, -1.9), (2.4, -2.7), (3.6, 1.0))
PHOTOS = (((-1.0, -3.4), 0.5), ((3.4, -2.2), 2.0), ((-4.0, -0.4), -3.0))  # where they are taken, and x where they look
HEIGHT = 1.6


def make_panoramas(output: pathlib.Path, seed: int) -> None:
    rng = np.random.default_rng([seed, 30])
    rectangles = build_scene(seed, texels_per_m=110)
    walk = {f"{index:02}.jpg": _pose(rng, place) for index, place in enumerate(WALK)}
    new = {f"{index:02}.jpg": _pose(rng, place) for index, place in enumerate(NEW, start=len(WALK))}
    photos = {
        f"photo{index}.jpg": upright_pose(np.array([*place, HEIGHT]), np.array([x, 5.5, 2.0]), roll_deg=2.0)
        for index, (place, x) in enumerate(PHOTOS)
    }
    for stream, (folder, poses) in enumerate({"walk": walk, "new": new}.items(), start=30):
        _write_panoramas(output / folder, rectangles, poses, seed, stream)
    views = [View(name, PHONE, pose) for name, pose in photos.items()]
    write_images(output / "photos", rectangles, views, seed, stream=32)
    (output / "camera.txt").write_text(f"{PHONE.text()}\n")
    with (output / "poses.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["name", "x", "y", "z", "qw", "qx", "qy", "qz"])
        for name, pose in walk.items():
            w, x, y, z = pose.qvec
            writer.writerow([name, *pose.cam_in_world, w, -x, -y, -z])
    for name, poses in (("truth.txt", new), ("photos_truth.txt", photos)):
        write_poses(output / name, {f"query/{photo}": pose for photo, pose in poses.items()})


def _pose(rng: np.random.Generator, place: tuple[float, float]) -> Pose:
    """Returns the pose of a camera on a stick, which is turned anyhow and nearly upright."""
    heading, (pitch, roll) = rng.uniform(0, 2 * np.pi), np.radians(rng.normal(0, 2, 2))
    centre = np.array([*place, HEIGHT + rng.normal(0, 0.05)])
    level = upright_pose(centre, centre + [np.sin(heading), np.cos(heading), 0], roll_deg=0.0)
    return Pose.from_centre(Rotation.from_euler("xz", [pitch, roll]).as_matrix() @ level.rotation, centre)


def _write_panoramas(
    folder: pathlib.Path, rectangles: list[Rectangle], poses: dict[str, Pose], seed: int, stream: int
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for index, (name, pose) in enumerate(poses.items()):
        picture = render_panorama(rectangles, RENDERED, pose, WIDTH)
        photo = photograph(picture, np.random.default_rng([seed, stream, index]))
        if not cv2.imwrite(str(folder / name), photo, [cv2.IMWRITE_JPEG_QUALITY, 95]):
            raise OSError(f"{folder / name}: cannot be written")


def render_panorama(rectangles: list[Rectangle], camera: Camera, pose: Pose, width: int) -> Array:
    """Renders the faces of a cube with a camera, and takes each pixel from the face in whose middle it is most."""
    rays = RayGrid(camera)
    longitudes = ((np.arange(width) + 0.5) / width - 0.5) * 2 * np.pi
    latitudes = ((np.arange(width // 2) + 0.5) / (width // 2) - 0.5) * np.pi  # downwards
    longitude, latitude = np.meshgrid(longitudes, latitudes)
    directions = np.stack(
        [np.cos(latitude) * np.sin(longitude), np.sin(latitude), np.cos(latitude) * np.cos(longitude)], axis=-1
    )
    panorama = np.empty((width // 2, width, 3), np.float32)
    rotations = [rotation_of_angles(yaw, pitch) for yaw, pitch in CUBE]
    nearest = np.argmax([directions @ rotation[2] for rotation in rotations], axis=0)
    for index, rotation in enumerate(rotations):
        picture = render(rectangles, rays, Pose.from_matrix(rotation @ pose.rotation, rotation @ pose.tvec), sky)
        shown = nearest == index
        x, y, z = np.moveaxis(directions @ rotation.T, 2, 0)
        focal, _, centre, _ = camera.params
        z = np.where(shown, z, 1)
        columns, rows = ((focal * axis / z + centre - 0.5).astype(np.float32) for axis in (x, y))
        panorama[shown] = cv2.remap(picture, columns, rows, cv2.INTER_CUBIC)[shown]
    return panorama
