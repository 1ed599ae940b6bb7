"""Renders a robot's stereo camera in the demo's courtyard: a mapping drive with poses of SLAM, and a second drive.

Writes below the output folder:
  mapping/TIME.jpg, slam.txt        photos of the left camera, and their poses (TUM) with errors of SLAM
  drive/left/TIME.jpg, drive/right/TIME.jpg   photos of the second drive, the queries
  rig.json                          the stereo rig, in the JSON format of COLMAP's rig_configurator
  odometry.txt                      poses of the left camera relative to each other (TUM), with errors of odometry
  queries.txt, camera.txt           `name MODEL width height params...`, and the camera alone
  truth.txt                         `name qw qx qy qz tx ty tz` of the queries, cam_from_world
"""

import itertools
import json
import pathlib

import numpy as np
from scipy.spatial.transform import Rotation

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.demo.scene import View, build_scene, upright_pose, write_images
from colmap_lazyloc.model import Camera
from colmap_lazyloc.poses import Pose, write_poses

CAMERA = Camera("PINHOLE", 640, 400, (420.0, 420.0, 320.0, 200.0))
BASELINE = np.array([0.3, 0.0, 0.0])  # from the left camera to the right one, in the left one's axes, in metres
NUM_MAPPING, NUM_MOMENTS = 14, 10
SECONDS_BETWEEN = 0.5
SLAM_NOISE = 0.004, 0.03  # metres, degrees
ODOMETRY_NOISE = 0.003, 0.02  # of each step


def make_robot_scene(output: pathlib.Path, seed: int) -> None:
    rng = np.random.default_rng([seed, 10])
    mapping = [_pose(x, -3.4 + 0.25 * (index % 3), 1.0, 0.4 * x) for index, x in enumerate(_steps(-4.4, 4.4))]
    left = [_pose(x, -2.9 - 0.04 * x, 1.0, 0.5 * x + 0.4) for x in np.linspace(-3.4, 2.6, NUM_MOMENTS)]
    right = [Pose.from_matrix(pose.rotation, pose.tvec - BASELINE) for pose in left]
    rectangles = build_scene(seed, texels_per_m=110)
    folders = {"mapping": (mapping, 100.0), "drive/left": (left, 200.0), "drive/right": (right, 200.0)}
    for stream, (folder, (poses, start)) in enumerate(folders.items(), start=10):
        views = [View(f"{time}.jpg", CAMERA, pose) for time, pose in zip(_times(start, len(poses)), poses)]
        write_images(output / folder, rectangles, views, seed, stream)
    _write_trajectory(output / "slam.txt", 100.0, [_disturb(rng, pose, SLAM_NOISE) for pose in mapping])
    _write_trajectory(output / "odometry.txt", 200.0, _odometry(rng, left))
    _write_rig(output)
    truth = {
        f"{side}/{time}.jpg": pose
        for side, poses in (("left", left), ("right", right))
        for time, pose in zip(_times(200.0, len(poses)), poses)
    }
    write_poses(output / "truth.txt", truth)
    (output / "queries.txt").write_text("".join(f"{name} {CAMERA.text()}\n" for name in sorted(truth)))
    (output / "camera.txt").write_text(f"{CAMERA.text()}\n")


def _steps(start: float, end: float) -> Array:
    return np.linspace(start, end, NUM_MAPPING)


def _times(start: float, count: int) -> list[str]:
    return [f"{start + SECONDS_BETWEEN * index:.6f}" for index in range(count)]


def _pose(x: float, y: float, height: float, target_x: float) -> Pose:
    """Returns the pose of a camera that looks at the north wall."""
    return upright_pose(np.array([x, y, height]), np.array([target_x, 5.0, 1.6]), roll_deg=0.0)


def _disturb(rng: np.random.Generator, pose: Pose, noise: tuple[float, float]) -> Pose:
    metres, degrees = noise
    turn = Rotation.from_rotvec(np.radians(degrees) * rng.standard_normal(3)).as_matrix()
    return Pose.from_centre(turn @ pose.rotation, pose.cam_in_world + metres * rng.standard_normal(3))


def _odometry(rng: np.random.Generator, poses: list[Pose]) -> list[Pose]:
    """Returns the poses in a world that begins at the first one, with errors that add up from step to step."""
    found = [Pose.from_matrix(np.eye(3), np.zeros(3))]
    for before, pose in itertools.pairwise(poses):
        step = _disturb(rng, pose @ before.inverse(), ODOMETRY_NOISE)
        found.append(step @ found[-1])
    return found


def _write_trajectory(path: pathlib.Path, start: float, poses: list[Pose]) -> None:
    """Writes world_from_cam in TUM's form."""
    lines = []
    for time, pose in zip(_times(start, len(poses)), poses):
        w, x, y, z = pose.qvec
        numbers = [*pose.cam_in_world, -x, -y, -z, w]
        lines.append(f"{time} " + " ".join(f"{number:.9f}" for number in numbers) + "\n")
    path.write_text("".join(lines))


def _write_rig(output: pathlib.Path) -> None:
    right = {
        "image_prefix": "right/",
        "cam_from_rig_rotation": [1, 0, 0, 0],
        "cam_from_rig_translation": (-BASELINE).tolist(),
    }
    rig = [{"cameras": [{"image_prefix": "left/", "ref_sensor": True}, right]}]
    (output / "rig.json").write_text(json.dumps(rig, indent=2) + "\n")
