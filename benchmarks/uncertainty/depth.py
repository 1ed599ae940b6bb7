"""One database image with a depth map: localized share, errors and calibration in synthetic scenes. Prints Markdown.

    python -m benchmarks.uncertainty.depth [--num_seeds N] [--colmap COLMAP]

Errors are those of all poses, also of `LOW_CONFIDENCE` ones.

Rows: error of each depth, and where the map's scale comes from. `fitted`: maps are wrong by factors of 1/3 to 3, and
points of neighbouring database images tell the scale. `metric`: scales are wrong by 2 % (standard deviation), database
images have no common matches, and the map is stated to be metric.
"""

import argparse
import pathlib
import sys
import tempfile

import numpy as np

from benchmarks.uncertainty import localizer, report
from colmap_lazyloc.errors import command
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.program import find_colmap
from colmap_lazyloc.testing import synthetic

NOISE_RATIOS = 0.01, 0.05, 0.1
NUM_QUERIES = 20
METRIC_STDDEV_RATIO = 0.02  # the program's default


def disturbance(noise_ratio, is_metric):
    def disturb(depths, rng):
        log_scale = rng.normal(0, METRIC_STDDEV_RATIO) if is_metric else rng.uniform(-np.log(3), np.log(3))
        return depths * np.exp(log_scale + rng.normal(0, noise_ratio, len(depths)))

    return disturb


def localize_seed(colmap, seed, noise_ratio, is_metric):
    """Returns the program's results and the scene."""
    rng = np.random.default_rng(seed)
    centres = synthetic.arc(9)
    queries = report.around(centres, NUM_QUERIES, 0.7, rng)
    scene = synthetic.make_scene(centres, queries, 1.0, seed=seed, num_points=400, database_pairs=not is_metric)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        maps = synthetic.write_depth_maps(folder / "maps", scene, disturbance(noise_ratio, is_metric), seed=seed)
        results = localizer.localize(
            colmap,
            synthetic.write_database(folder / "database.db", scene),
            synthetic.write_model(folder / "model", scene),
            folder / "output",
            *("--depth_path", maps, "--LazyLocalizer.num_retrieved", 1),
            *("--LazyLocalizer.depth_is_metric", int(is_metric)),
            *report.EXACT,
        )
    return results, scene


def row(colmap, num_seeds, noise_ratio, is_metric):
    errors, squared, num_localized, num_queries = [], [], 0, 0
    for seed in range(num_seeds):
        results, scene = localize_seed(colmap, seed, noise_ratio, is_metric)
        for name in scene.query_names:
            num_queries += 1
            num_localized += results[name]["status"] == "LOCALIZED"
            if results[name]["covariance"] is None:
                continue
            stated = results[name]["cam_from_world"] or results[name]["unconfirmed_cam_from_world"]
            pose = Pose(np.array(stated["qvec"]), np.array(stated["tvec"]))
            centre = scene.images[name].pose.cam_in_world
            error, sigma = localizer.position_error(pose, results[name]["covariance"], centre)
            errors.append(error / results[name]["evidence"]["scene_distance"])
            squared.append(sigma**2)
    scale = "metric" if is_metric else "fitted"
    quantiles = " | ".join(f"{np.percentile(squared, percent):.1f}" for percent in (50, 90))
    return (
        f"| {100 * noise_ratio:.0f} % | {scale} | {num_localized} of {num_queries} | {100 * np.median(errors):.2f} % | "
        f"{quantiles} |"
    )


@command
def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--num_seeds", type=int, default=8)
    parser.add_argument("--colmap", type=pathlib.Path, help="program; default: build/bin/colmap or $COLMAP")
    options = parser.parse_args(arguments)
    colmap = options.colmap or find_colmap()
    print(
        "| error of the depths | scale | localized queries | median error / distance | median NEES (right: 2.4) "
        "| 90 % quantile of the NEES (right: 6.3) |"
    )
    print("|---|---|---|---|---|---|")
    for noise_ratio in NOISE_RATIOS:
        for is_metric in (False, True):
            print(row(colmap, options.num_seeds, noise_ratio, is_metric), flush=True)


if __name__ == "__main__":
    sys.exit(main())
