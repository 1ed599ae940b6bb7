"""Measures time and memory of a second epoch over the number of new photos, beside COLMAP's mapper.

    scripts/python.sh -m benchmarks epoch_size --work_path WORK [--num_photos 50 500 2000] [--mapper]

A drone photographs hilly ground in a grid, and again with four times as many photos. Keypoints and verified matches are
synthetic: each new photo has them with the next 10 new photos and the next 8 of the database. The database poses are
off by 0.01 degrees and 0.01 of a metre, at a height of 40.
"""

import argparse
import pathlib
import resource
import shutil
import subprocess
import sys

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from colmap_lazyloc.array_types import Array, Floats
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.program import find_colmap
from colmap_lazyloc.results import RESULTS, read_results, to_pose
from colmap_lazyloc.testing import synthetic

NUM_NEW_NEIGHBOURS, NUM_DATABASE_NEIGHBOURS = 10, 8
HEIGHT, SPACING = 40.0, 8.0  # of the flight, and of new photos in it
NOISE_PX = 0.7
POSE_NOISE_DEG, POSE_NOISE = 0.01, 0.01  # of database poses
DOWN = np.diag([1.0, -1.0, -1.0])
# Reports core-seconds and peak memory of a program; this process is so small that its own memory does not count.
LAUNCHER = """
import resource, subprocess, sys
limit = int(sys.argv[2])
def bound(): resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
code = subprocess.call(sys.argv[3:], stdout=open(sys.argv[1] + ".log", "w"), stderr=subprocess.STDOUT, preexec_fn=bound)
usage = resource.getrusage(resource.RUSAGE_CHILDREN)
open(sys.argv[1], "w").write(f"{code} {usage.ru_utime + usage.ru_stime} {usage.ru_maxrss / 1024}")
"""


def grid(num: int, spacing: float, rng: np.random.Generator) -> Floats:
    """Returns projection centres, row after row."""
    num_columns = int(np.ceil(np.sqrt(num)))
    rows, columns = np.divmod(np.arange(num), num_columns)
    centres = np.stack([columns * spacing, rows * spacing, np.full(num, HEIGHT)], axis=1)
    return centres + rng.normal(0, 0.5, (num, 3))


def match(image1: synthetic.Image, image2: synthetic.Image) -> synthetic.Pair:
    """Matches the keypoints of the same scene points."""
    _, first, second = np.intersect1d(image1.point_of_keypoint, image2.point_of_keypoint, return_indices=True)
    matches = np.stack([first, second], axis=1).astype(np.uint32)
    rotation = image2.pose.rotation @ image1.pose.rotation.T
    translation = image2.pose.tvec - rotation @ image1.pose.tvec
    return synthetic.Pair(matches, matches, Rotation.from_matrix(rotation), translation / np.linalg.norm(translation))


def make_scene(num_photos: int, num_keypoints: int, seed: int = 0) -> synthetic.Scene:
    """Makes the images with their true poses."""
    rng = np.random.default_rng(seed)
    cameras = {
        1: synthetic.Camera(1, "SIMPLE_RADIAL", 4000, 3000, [3000.0, 2000.0, 1500.0, -0.02]),
        2: synthetic.Camera(2, "SIMPLE_RADIAL", 4056, 3040, [2900.0, 2028.0, 1520.0, 0.01]),
    }
    centres = {1: grid(num_photos // 4, 2 * SPACING, rng), 2: grid(num_photos, SPACING, rng)}
    low = np.min(np.concatenate(list(centres.values())), axis=0)[:2] - HEIGHT
    high = np.max(np.concatenate(list(centres.values())), axis=0)[:2] + HEIGHT
    ground = (4000 / 3000 * HEIGHT) * HEIGHT  # what a photo shows
    num_points = int(num_keypoints / 0.7 / ground * np.prod(high - low))
    points = np.concatenate([rng.uniform(low, high, (num_points, 2)), np.zeros((num_points, 1))], axis=1)
    points[:, 2] = 3 * np.sin(points[:, 0] / 15) * np.sin(points[:, 1] / 11) + rng.uniform(0, 3, num_points)
    tree = KDTree(points[:, :2])
    scene = synthetic.Scene(cameras, {}, {}, [], points)
    for camera_id, folder in ((1, "database"), (2, "new")):
        for i, centre in enumerate(centres[camera_id]):
            turn = Rotation.from_euler("zyx", rng.normal(0, [20, 3, 3]), degrees=True).as_matrix()
            pose = Pose.from_centre(DOWN @ turn, centre)
            near = np.array(tree.query_ball_point(centre[:2], HEIGHT))
            xy, owners = synthetic.observe(cameras[camera_id], pose, points[near], NOISE_PX, 0.7, rng)
            owners = np.where(owners >= 0, near[owners], -1 - np.arange(len(owners)) - len(owners) * len(scene.images))
            name = f"{folder}/{i:05d}.jpg"
            scene.images[name] = synthetic.Image(name, len(scene.images) + 1, camera_id, pose, xy, owners)
    names = {key: [name for name in scene.images if name.startswith(key)] for key in ("database", "new")}
    scene.query_names = names["new"]
    for other, camera_id, count in (("database", 1, NUM_DATABASE_NEIGHBOURS), ("new", 2, NUM_NEW_NEIGHBOURS + 1)):
        nearest = KDTree(centres[camera_id]).query(centres[2], count)[1]
        for name, neighbours in zip(names["new"], nearest, strict=True):
            for neighbour in neighbours:
                key = (names[other][neighbour], name)
                if key[0] != name and key not in scene.pairs and key[::-1] not in scene.pairs:
                    scene.pairs[key] = match(scene.images[key[0]], scene.images[name])
    return scene


def with_noise(scene: synthetic.Scene, rng: np.random.Generator) -> None:
    """Moves the database poses off their true places."""
    for name in scene.database_names:
        pose = scene.images[name].pose
        turn = Rotation.from_rotvec(np.radians(rng.normal(0, POSE_NOISE_DEG, 3))).as_matrix()
        scene.images[name].pose = Pose.from_centre(
            turn @ pose.rotation, pose.cam_in_world + rng.normal(0, POSE_NOISE, 3)
        )


def measure(folder: pathlib.Path, label: str, words: list, limit_s: int = 0) -> str:
    """Runs a program on one thread; returns core-seconds and MB."""
    report = folder / f"{label}.usage"
    limit = limit_s or resource.RLIM_INFINITY
    command = [sys.executable, "-c", LAUNCHER, report, limit, find_colmap(), *words]
    subprocess.run(list(map(str, command)), check=True)
    code, seconds, megabytes = map(float, report.read_text().split())
    ended = "" if code == 0 else " (cut off)" if limit_s and seconds >= limit_s else f" (exit code {code:.0f})"
    return f"{seconds:.1f} s{ended} | {megabytes:.0f} MB"


def errors(folder: pathlib.Path, truth: dict[str, Pose]) -> str:
    """Returns the number of photos with poses, and the median and largest of their position errors."""
    distances = [
        np.linalg.norm(to_pose(result["cam_from_world"]).cam_in_world - truth[name].cam_in_world)
        for name, result in read_results(folder / RESULTS).items()
        if result["status"] == "LOCALIZED"
    ]
    return f"{len(distances)} | {1000 * np.median(distances):.1f} | {1000 * max(distances):.1f}"


def run(folder: pathlib.Path, num_photos: int, options: argparse.Namespace) -> None:
    database, model = folder / "database.db", folder / "model"
    scene = make_scene(num_photos, options.num_keypoints)
    truth: dict[str, Pose] = {name: scene.images[name].pose for name in scene.query_names}
    if not database.exists():
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        synthetic.write_database(database, scene)
        with_noise(scene, np.random.default_rng(1))
        synthetic.write_model(model, scene)
    counts: Array = np.array([len(image.keypoints) for image in scene.images.values()])
    matches = np.mean([len(pair.matches) for pair in scene.pairs.values()])
    label = f"| {num_photos:,} photos, {counts.mean():.0f} keypoints, {matches:.0f} matches a pair"
    stored = ["--database_path", database, "--input_path", model]
    steps = [
        ("localized", ["lazy_localizer", "--LazyLocalizer.num_threads", 1]),
        ("epoch", ["lazy_epoch", "--localized_path", folder / "localized", "--LazyEpoch.num_threads", 1]),
    ]
    for name, words in steps:
        if name == "localized" and (folder / name / RESULTS).exists() and not options.again:
            continue
        shutil.rmtree(folder / name, ignore_errors=True)
        usage = measure(folder, name, [*words, *stored, "--output_path", folder / name])
        print(f"{label} | {name} | {usage} | {errors(folder / name, truth)} |", flush=True)
    if options.mapper:
        shutil.rmtree(folder / "mapper", ignore_errors=True)
        (folder / "mapper").mkdir()
        words = ["mapper", "--database_path", database, "--image_path", folder, "--output_path", folder / "mapper"]
        usage = measure(folder, "mapper", [*words, "--Mapper.num_threads", 1], 60 * options.mapper_limit_minutes)
        print(f"{label} | mapper | {usage} | | | |", flush=True)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work_path", type=pathlib.Path, required=True)
    parser.add_argument("--num_photos", type=int, nargs="+", default=[50, 500, 2000])
    parser.add_argument("--num_keypoints", type=int, default=1000, help="of an image, approximately")
    parser.add_argument("--again", action="store_true", help="also localize again")
    parser.add_argument("--mapper", action="store_true", help="also run COLMAP's mapper")
    parser.add_argument("--mapper_limit_minutes", type=int, default=60, help="core-minutes until it is cut off")
    options = parser.parse_args(arguments)
    print("| | step | core-seconds | peak memory | with poses | median mm | largest mm |")
    print("|---" * 7 + "|")
    for num_photos in options.num_photos:
        run(options.work_path.resolve() / str(num_photos), num_photos, options)
    return 0
