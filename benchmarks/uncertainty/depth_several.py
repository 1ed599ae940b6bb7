"""Depth maps of any quality with one and with several database images: do they help, do they harm? Prints Markdown.

    python -m benchmarks.uncertainty.depth_several [--num_seeds N]
    python -m benchmarks.uncertainty.depth_several --database_path D --input_path M [--depth_path MAPS] [OPTION ...]

The first form makes synthetic scenes with maps of every kind (`KINDS`). The second one localizes each posed image of a
real scene against the others, with the given maps, or with maps of points that pairs of posed images triangulate,
disturbed (`REAL_KINDS`); further options go to the program. Cells: queries with status `LOCALIZED`, position error
over that without maps (geometric mean and its standard error, of the queries with both), and the median of the squared
normalised position error (2.4 is right). For one image, in place of the ratio, the error over the distance.
"""

import argparse
import pathlib
import sys
import tempfile

import numpy as np

from benchmarks.uncertainty import localizer, report
from benchmarks.uncertainty.depth_points import triangulated_depths
from colmap_lazyloc.errors import command
from colmap_lazyloc.model import read_model
from colmap_lazyloc.program import find_colmap
from colmap_lazyloc.results import pose_of
from colmap_lazyloc.testing import synthetic

NUM_DATABASE_IMAGES, NUM_QUERIES = 24, 20
NUMS_RETRIEVED = 1, 2, 3, 20


def noisy(stddev_ratio, log_scale=0.0):
    def disturb(depths, rng):
        scale = np.exp(rng.uniform(-log_scale, log_scale))
        return depths * scale * np.exp(stddev_ratio * rng.standard_normal(len(depths)))

    return disturb


# How the depths of a map are disturbed; None: those of the next database image at the same pixels' points.
KINDS = {
    "exact": noisy(0),
    "1 %": noisy(0.01),
    "5 %": noisy(0.05),
    "10 %": noisy(0.1),
    "5 %, scales of 1/3 to 3": noisy(0.05, np.log(3)),
    "random": lambda depths, rng: rng.uniform(1, 9, len(depths)),
    "inverse": lambda depths, rng: 30 / depths,
    "constant": lambda depths, rng: np.full(len(depths), np.mean(depths)),
    "of another image": lambda depths, rng: rng.permutation(depths),
    "of the next image": None,
}


REAL_KINDS = "1 %", "5 %", "5 %, scales of 1/3 to 3", "random", "inverse", "of another image"


def write_maps(folder, scene, kind, seed):
    if KINDS[kind] is not None:
        return synthetic.write_depth_maps(folder, scene, KINDS[kind], seed=seed)
    other = scene.copy()
    names = scene.database_names
    for name, next_name in zip(names, names[1:] + names[:1], strict=True):
        other.images[name].pose = scene.images[next_name].pose
    return synthetic.write_depth_maps(folder, other, seed=seed)


def write_real_maps(folder, model, depths, kind):
    rng = np.random.default_rng(0)
    for name, (pixels, depth) in depths.items():
        camera = model.cameras[model.images[name].camera_id]
        values = np.full((camera.height, camera.width), np.nan, np.float32)
        values[pixels[:, 1], pixels[:, 0]] = KINDS[kind](depth, rng)
        path = folder / f"{name}.npy"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, values)
    return folder


class Scene:
    """A scene on the disk and how to localize its queries."""

    def __init__(self, colmap, database_path, model_path, true_centres, options):
        self.colmap, self.files, self.options = colmap, (database_path, model_path), options
        self.true_centres = true_centres

    def localize(self, num_retrieved, *options):
        """Returns (position error, the same in standard deviations, over the distance, is localized) by query."""
        with tempfile.TemporaryDirectory() as folder:
            retrieved = "--LazyLocalizer.num_retrieved", num_retrieved
            output_path = pathlib.Path(folder) / "output"
            results = localizer.localize(self.colmap, *self.files, output_path, *self.options, *retrieved, *options)
        errors = {}
        for name, result in results.items():
            pose = pose_of(result)
            if pose is None or result["covariance"] is None:
                continue
            error, sigma = localizer.position_error(pose, result["covariance"], self.true_centres[name])
            is_localized = result["status"] == "LOCALIZED"
            errors[name] = error, sigma, error / result["evidence"]["scene_distance"], is_localized
        return errors


def make_scene(folder, colmap, seed, has_database_pairs):
    rng = np.random.default_rng(seed)
    centres = synthetic.arc(NUM_DATABASE_IMAGES)
    queries = report.around(centres, NUM_QUERIES, 0.7, rng)
    scene = synthetic.make_scene(centres, queries, 1.0, seed=seed, num_points=400, database_pairs=has_database_pairs)
    centre_of = {name: scene.images[name].pose.cam_in_world for name in scene.query_names}
    files = synthetic.write_database(folder / "database.db", scene), synthetic.write_model(folder / "model", scene)
    return scene, Scene(colmap, *files, centre_of, report.EXACT)


def header(label, nums_retrieved):
    """Returns the first two lines of a table."""
    titles = (
        "1 database image: localized; median error / distance; median NEES"
        if num == 1
        else f"{num} database images: localized; error ratio; median NEES"
        for num in nums_retrieved
    )
    return f"\n| kind of map, {label} | {' | '.join(titles)} |\n|---|{'---|' * len(nums_retrieved)}"


def cell(num_retrieved, runs):
    """runs: (errors without maps, errors with maps) for each scene."""
    values = [value for _, with_maps in runs for value in with_maps.values()]
    text = str(sum(value[3] for value in values))
    if not values:
        return text
    if num_retrieved == 1:
        gain = f"{100 * np.median([value[2] for value in values]):.2f} %"
    else:
        logs = [np.log(after[name][0] / before[name][0]) for before, after in runs for name in before if name in after]
        mean = np.exp(np.mean(logs))
        gain = f"{mean:.3f} ± {mean * np.std(logs) / np.sqrt(len(logs)):.3f}"
    return f"{text}; {gain}; {np.median([value[1] ** 2 for value in values]):.1f}"


def print_synthetic(colmap, num_seeds, num_retrieved_list):
    for is_metric in (False, True):
        print(header("stated to be metric" if is_metric else "scale estimated", num_retrieved_list))
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            scenes = []
            for seed in range(num_seeds):
                (folder / str(seed)).mkdir()
                scenes.append(make_scene(folder / str(seed), colmap, seed, not is_metric))
            without = {num: [scene.localize(num) for _, scene in scenes] for num in num_retrieved_list}
            cells = [cell(num, [(errors, errors) for errors in without[num]]) for num in num_retrieved_list]
            print(f"| none | {' | '.join(cells)} |", flush=True)
            for i, kind in enumerate(KINDS):
                if is_metric and "scales" in kind:
                    continue
                maps = [write_maps(folder / f"{i}_{k}", scenes[k][0], kind, k) for k in range(num_seeds)]
                cells = []
                for num in num_retrieved_list:
                    options = ["--LazyLocalizer.depth_is_metric", int(is_metric), "--depth_path"]
                    runs = [scene.localize(num, *options, maps[k]) for k, (_, scene) in enumerate(scenes)]
                    cells.append(cell(num, list(zip(without[num], runs, strict=True))))
                print(f"| {kind} | {' | '.join(cells)} |", flush=True)


def print_real(colmap, files, more_options):
    model = read_model(files.input_path)
    centre_of = {image.name: image.cam_from_world.cam_in_world for image in model.images.values()}
    options = "--LazyLocalizer.leave_one_out", 1, *more_options
    scene = Scene(colmap, files.database_path, files.input_path, centre_of, options)
    print(header(f"scene {files.input_path.parent.name}", NUMS_RETRIEVED))
    without = {num: scene.localize(num) for num in NUMS_RETRIEVED}
    print("| none | " + " | ".join(cell(num, [(without[num], without[num])]) for num in NUMS_RETRIEVED) + " |")
    with tempfile.TemporaryDirectory() as folder:
        if files.depth_path:
            maps = {"given": files.depth_path}
        else:
            depths = triangulated_depths(files.database_path, model)
            maps = {kind: write_real_maps(pathlib.Path(folder) / kind[:6], model, depths, kind) for kind in REAL_KINDS}
        for kind, path in maps.items():
            cells = [cell(num, [(without[num], scene.localize(num, "--depth_path", path))]) for num in NUMS_RETRIEVED]
            print(f"| {kind} | {' | '.join(cells)} |", flush=True)


@command
def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--num_seeds", type=int, default=4)
    parser.add_argument("--colmap", type=pathlib.Path, help="program; default: build/bin/colmap or $COLMAP")
    for name in ("database_path", "input_path", "depth_path"):
        parser.add_argument(f"--{name}", type=pathlib.Path)
    options, more = parser.parse_known_args(arguments)
    colmap = options.colmap or find_colmap()
    if options.database_path:
        print_real(colmap, options, more)
    else:
        print_synthetic(colmap, options.num_seeds, NUMS_RETRIEVED)


if __name__ == "__main__":
    sys.exit(main())
