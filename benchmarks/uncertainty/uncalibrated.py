"""Localizes synthetic photos without calibration: any focal length, distortion and principal point.

Each query is seen by K database images whose poses and intrinsics are exact. It has a camera of its own, or with
--one_camera the same as all others, of which the program gets COLMAP's guess. Worlds with weak perspective are there
because focal length, distance and distortion are hard to tell apart in them. Prints a
Markdown table, one row for each world and K: the queries that are localized, those of them that are wrong (beyond 5
standard deviations and 0.5 % of the scene), the median error of the position over the distance of the scene and over
that with the true intrinsics, and medians of squared errors over their variances, over those of a normal distribution:
of the position, and of the log of the focal length.

  python -m benchmarks uncalibrated [--num_queries N] [--seed SEED]
  python -m benchmarks uncalibrated --one_camera --options --ImageReader.single_camera 1
"""

import argparse
import dataclasses
import pathlib
import tempfile

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from benchmarks.uncertainty import localizer
from benchmarks.uncertainty.stress import is_wrong_position
from colmap_lazyloc.errors import command
from colmap_lazyloc.program import find_colmap
from colmap_lazyloc.results import pose_of
from colmap_lazyloc.testing import synthetic

WIDTH, HEIGHT = 1200, 900
DATABASE_CAMERA = 1
GUESSED_FOCAL_PX = 1.2 * WIDTH  # COLMAP's default
NOISE_PX = 0.7


@dataclasses.dataclass
class World:
    """Points in a box that cameras look at from a distance."""

    size: tuple[float, float, float]  # of the box, over the distance; the last is along the line of sight
    view_deg: float  # width of the database's field of view
    arc_deg: float = 60.0  # directions that cameras look from
    num_points: int = 500
    max_distance_ratio: float = 1.3  # of the farthest camera over the nearest


WORLDS = {
    "object": World((0.6, 0.5, 0.5), 55),
    "room": World((1.6, 1.0, 1.2), 65, arc_deg=40),
    "facade": World((0.9, 0.6, 0.08), 55),
    "plane": World((0.9, 0.6, 0.0), 55),
    "telephoto": World((0.14, 0.1, 0.08), 10),
    "statue": World((0.12, 0.2, 0.05), 16, arc_deg=40),
    "few points": World((0.6, 0.5, 0.3), 55, num_points=60),
    "from afar": World((0.6, 0.5, 0.1), 55, arc_deg=15),
}


def draw_pose(world, rng):
    """Returns a camera that looks at the middle of the box, about 1 away."""
    angle, elevation = np.radians(world.arc_deg) * rng.uniform(-0.5, 0.5, 2) * [1, 0.4]
    distance = np.sqrt(world.max_distance_ratio) ** rng.uniform(-1, 1)
    centre = distance * np.array(
        [np.sin(angle) * np.cos(elevation), np.sin(elevation), -np.cos(angle) * np.cos(elevation)]
    )
    return synthetic.looking_at(centre, 0.1 * np.array(world.size) * rng.uniform(-1, 1, 3), rng.uniform(-10, 10))


def draw_camera(camera_id, database_focal_px, rng):
    """Returns a camera nobody has calibrated. Its field of view shows the scene: at most half as wide or twice."""
    focal = database_focal_px * np.exp(rng.uniform(-0.4, 0.4))
    # A zoom lens bends lines less in pixels than k1 says, because k1 is per squared tangent of the angle.
    corner = np.hypot(WIDTH, HEIGHT) / 2 / focal
    radial = rng.uniform(-0.3, 0.1) * min(1, 0.3 / corner**2)
    shift = rng.normal(0, 0.007 * WIDTH, 2)
    return synthetic.Camera(
        camera_id, "SIMPLE_RADIAL", WIDTH, HEIGHT, [focal, WIDTH / 2 + shift[0], HEIGHT / 2 + shift[1], radial]
    )


def draw_scene(world, num_images, num_queries, has_one_camera, rng):
    points = rng.uniform(-0.5, 0.5, (world.num_points, 3)) * world.size
    focal = WIDTH / 2 / np.tan(np.radians(world.view_deg) / 2)
    database = synthetic.Camera(
        DATABASE_CAMERA, "SIMPLE_RADIAL", WIDTH + 2, HEIGHT, [focal, WIDTH / 2 + 1, HEIGHT / 2, 0.0]
    )
    scene = synthetic.Scene({DATABASE_CAMERA: database}, {}, {}, [], points)
    for i in range(num_images + num_queries):
        is_query = i >= num_images
        camera = draw_camera(i + 2, focal, rng) if is_query else database
        if is_query and has_one_camera and scene.query_names:
            camera = scene.cameras[scene.images[scene.query_names[0]].camera_id]
        name, pose = f"{'query' if is_query else 'database'}/{i:03d}.jpg", draw_pose(world, rng)
        observed = synthetic.observe(camera, pose, points, NOISE_PX, 0.6, rng)
        scene.cameras[camera.camera_id] = camera
        scene.images[name] = synthetic.Image(name, i + 1, camera.camera_id, pose, *observed)
        if is_query:
            scene.query_names.append(name)
    for query in scene.query_names:
        for name in scene.database_names:
            pair = synthetic.match(scene.images[name], scene.images[query], 0.2, rng)
            if len(pair.matches) >= 15:
                scene.pairs[name, query] = synthetic.Pair(pair.matches, pair.matches, Rotation.identity(), np.zeros(3))
    return scene


def guessed(scene):
    """Returns the scene as the program gets it: with guessed intrinsics of the queries."""
    changed = scene.copy()
    for camera in changed.cameras.values():
        if camera.camera_id != DATABASE_CAMERA:
            camera.params = [GUESSED_FOCAL_PX, WIDTH / 2, HEIGHT / 2, 0.0]
            camera.has_prior_focal_length = False
    return changed


def localize(colmap, scene, folder, queries, *options):
    folder.mkdir()
    (folder / "queries.txt").write_text(queries)
    return localizer.localize(
        colmap,
        synthetic.write_database(folder / "database.db", scene, geometry=None),
        synthetic.write_model(folder / "model", scene),
        folder / "output",
        "--query_list_path",
        folder / "queries.txt",
        *options,
    )


def rows_of(scene, results):
    """Returns rows of position error, and errors of position and log focal length over their deviations.

    They are NaN for a query that is not localized, and the last one if its focal length was not tested.
    """
    rows = np.full((len(scene.query_names), 3), np.nan)
    for row, name in zip(rows, scene.query_names, strict=True):
        result, true = results[name], scene.images[name]
        if result["status"] != "LOCALIZED":
            continue
        row[:2] = localizer.position_error(pose_of(result), result["covariance"], true.pose.cam_in_world)
        intrinsics = result["intrinsics"] or {}
        factor, stddev = intrinsics.get("focal_factor", np.nan), intrinsics.get("focal_factor_stddev", np.nan)
        if result["intrinsics_source"] == "joint":
            continue  # the image alone says little of the focal length
        true_factor = scene.cameras[true.camera_id].params[0] / GUESSED_FOCAL_PX
        row[2] = np.log(factor / true_factor) / (stddev / factor)
    return rows


def median(values):
    """Returns the median of the values that are known; NaN if there is none."""
    known = values[np.isfinite(values)]
    return np.median(known) if known.size else np.nan


def print_row(colmap, name, world, num_images, num_queries, has_one_camera, seed, options):
    rng = np.random.default_rng([seed, num_images, list(WORLDS).index(name)])
    scene = draw_scene(world, num_images, num_queries, has_one_camera, rng)
    names = "".join(f"{query}\n" for query in scene.query_names)
    lines = "".join(
        f"{query} {scene.cameras[scene.images[query].camera_id].intrinsics().text()}\n" for query in scene.query_names
    )
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        found = localize(colmap, guessed(scene), folder / "guessed", names, *options)
        rows = rows_of(scene, found)
        true = rows_of(scene, localize(colmap, scene, folder / "true", lines, *options))
    num_wrong = sum(is_wrong_position(error, sigmas, scene_size=1, truth_stddev=0) for error, sigmas, _ in rows)
    is_localized, is_true_localized = np.isfinite(rows[:, 0]), np.isfinite(true[:, 0])
    both = is_localized & is_true_localized
    error = median(rows[both, 0])
    ratio = np.exp(np.mean(np.log(rows[both, 0] / true[both, 0]))) if both.any() else np.nan
    squares = [median(rows[:, 1] ** 2) / chi2.median(3), median(rows[:, 2] ** 2) / chi2.median(1)]
    localized = f"{is_localized.sum()} of {num_queries} | {is_true_localized.sum()}"
    figures = " | ".join(f"{value:.3g}" for value in (error, ratio, *squares, np.nanmax(rows[:, 1])))
    print(f"| {name} | {num_images} | {localized} | {num_wrong} | {figures} |", flush=True)


@command
def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", nargs="+", choices=WORLDS, default=list(WORLDS), help="default: all")
    parser.add_argument("--num_images", type=int, nargs="+", default=[4, 10, 20], help="K; default: 4 10 20")
    parser.add_argument("--num_queries", type=int, default=30, help="of each row; default: 30")
    parser.add_argument("--one_camera", action="store_true", help="the queries of a row have the same camera")
    parser.add_argument("--seed", type=int, default=0, help="default: 0")
    parser.add_argument("--colmap", type=pathlib.Path, default=find_colmap(), help="path of our colmap program")
    parser.add_argument("--options", nargs=argparse.REMAINDER, default=[], help="further options of the program")
    arguments = parser.parse_args(arguments)
    print(
        "| world | K | localized | with true intrinsics | wrong | error | over true | position² | focal² | largest σ |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for name in arguments.worlds:
        for num_images in arguments.num_images:
            print_row(
                arguments.colmap,
                name,
                WORLDS[name],
                num_images,
                arguments.num_queries,
                arguments.one_camera,
                arguments.seed,
                arguments.options,
            )
