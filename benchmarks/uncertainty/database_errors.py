"""Wrong database poses and one to three database images: is the stated covariance right? Prints a Markdown table.

    python -m benchmarks.uncertainty.database_errors [--num_seeds N] [OPTION ...]

Synthetic scenes whose database poses are off by independent errors; further options go to the program. With one image,
depth maps (1 % errors) or a position of the query (5 % of the distance) fix the distance. Cells: queries with a pose
(`LOCALIZED` ones), and the median and the 90 % quantile of the squared normalised position error of the poses (2.4 and
6.3 are right).
"""

import argparse
import pathlib
import sys
import tempfile

import numpy as np

from benchmarks.uncertainty import localizer, report
from colmap_lazyloc.errors import command
from colmap_lazyloc.program import find_colmap
from colmap_lazyloc.results import unconfirmed_pose_of
from colmap_lazyloc.testing import synthetic

FOCAL_LENGTH_PX, DISTANCE = 520, 6
NUM_DATABASE_IMAGES, NUM_QUERIES = 24, 20
POSITION_STDDEV = 0.3
EXACT_INTRINSICS = "--LazyLocalizer.Advanced.focal_length_stddev_ratio", 0
ERRORS_PX = 0, 1, 3, 6
CASES = {
    "1 database image, depth map": (1, "depth"),
    "1 database image, position": (1, "position"),
    "2 database images": (2, ""),
    "2 database images, depth maps": (2, "depth"),
    "3 database images": (3, ""),
    "3 database images, depth maps": (3, "depth"),
}


def disturbed_depths(depths, rng):
    return depths * np.exp(0.01 * rng.standard_normal(len(depths)))


def write_scene(folder, seed, error_px):
    """Writes a scene to a folder and returns it with the options of its further input."""
    rng = np.random.default_rng(seed)
    centres = synthetic.arc(NUM_DATABASE_IMAGES)
    queries = report.around(centres, NUM_QUERIES, 0.7, rng)
    scene = synthetic.make_scene(centres, queries, 1.0, seed=seed, num_points=400, database_pairs=True)
    noise_rad = error_px / FOCAL_LENGTH_PX
    given = report.with_disturbed_database(scene, np.degrees(noise_rad), DISTANCE * noise_rad, rng)
    synthetic.write_database(folder / "database.db", scene)
    synthetic.write_model(folder / "model", given)
    lines = []
    for name in scene.query_names:
        position = scene.images[name].pose.cam_in_world + POSITION_STDDEV * rng.standard_normal(3)
        lines.append(f"{name} {' '.join(map(repr, position.tolist()))} {POSITION_STDDEV}\n")
    (folder / "position.txt").write_text("".join(lines))
    maps = synthetic.write_depth_maps(folder / "maps", scene, disturbed_depths, seed=seed)
    extra = {"": (), "depth": ("--depth_path", maps)}
    extra["position"] = "--query_position_path", folder / "position.txt"
    return scene, extra


def cell(colmap, scenes, num_retrieved, extra, options):
    squares, num_localized = [], 0
    for folder, (scene, options_of) in scenes.items():
        with tempfile.TemporaryDirectory() as output:
            results = localizer.localize(
                colmap,
                folder / "database.db",
                folder / "model",
                pathlib.Path(output) / "output",
                *EXACT_INTRINSICS,
                *("--LazyLocalizer.num_retrieved", num_retrieved, *options_of[extra], *options),
            )
        for name, result in results.items():
            pose = unconfirmed_pose_of(result)
            num_localized += result["status"] == "LOCALIZED"
            if pose:
                truth = scene.images[name].pose.cam_in_world
                squares.append(localizer.position_error(pose, result["covariance"], truth)[1] ** 2)
    if not squares:
        return "0"
    quantiles = f"{np.median(squares):.1f}; {np.percentile(squares, 90):.1f}"
    return f"{len(squares)} ({num_localized}); {quantiles}"


@command
def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--num_seeds", type=int, default=4)
    parser.add_argument("--colmap", type=pathlib.Path, help="program; default: build/bin/colmap or $COLMAP")
    options, more = parser.parse_known_args(arguments)
    colmap = options.colmap or find_colmap()
    print(f"| database poses off by | {' | '.join(CASES)} |\n|---|{'---|' * len(CASES)}")
    for error_px in ERRORS_PX:
        with tempfile.TemporaryDirectory() as name:
            scenes = {}
            for seed in range(options.num_seeds):
                folder = pathlib.Path(name) / str(seed)
                folder.mkdir()
                scenes[folder] = write_scene(folder, seed, error_px)
            cells = [cell(colmap, scenes, num, extra, more) for num, extra in CASES.values()]
        print(f"| {error_px} px | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    sys.exit(main())
