"""Localizes queries against one to four database images, with and without points that two of these have in common.

    python -m benchmarks sparse --data_path DATA... --output_path OUT.md [-- OPTIONS OF LAZY_LOCALIZER]

DATA are folders of scenes as for `python -m benchmarks run --dataset scenes`. The database images of a query are the K
with the most verified matches. "Star": each keypoint of the query keeps its match in one of them, so that the query is
all that they have in common. Every method gets the same matches.
"""

import argparse
import collections
import dataclasses
import pathlib
import tempfile

import numpy as np

from benchmarks.localization.environment import describe_environment
from benchmarks.localization.evaluation import Row, Series, make_row, paired_ratio, summarize
from benchmarks.localization.methods import MethodOptions, NotApplicable, Result, load_method
from benchmarks.localization.methods.lazyloc import read_method_results
from benchmarks.localization.scenes import Scene, find_scenes, load_scene
from benchmarks.localization.sparse_scenes import SparseScene, make_sparse_scene
from benchmarks.uncertainty.localizer import position_error
from colmap_lazyloc.errors import command
from colmap_lazyloc.model import write_model
from colmap_lazyloc.program import find_colmap, run_colmap
from colmap_lazyloc.results import pose_of, read_results

NUM_IMAGES = (1, 2, 3, 4)
# Our methods: options of the program.
PROGRAM_METHODS = {
    "lazyloc": [],
    "motion averaging": ["--LazyLocalizer.Advanced.post_optimization", "none"],
}
# Other methods. They need two images: with one, they search for a scale that the matches do not have.
RIVALS = ("generalized_relative_pose", "poselib_generalized", "poselib_hybrid", "colmap_structureless")


@dataclasses.dataclass
class Cell:
    """The rows of a method, and the squared position errors over the variances that it states."""

    rows: list[Row] = dataclasses.field(default_factory=list)
    squared_sigmas: list[float] = dataclasses.field(default_factory=list)


def localize_by_program(scene: SparseScene, folder: pathlib.Path, arguments, options: list) -> dict[str, dict]:
    """Returns the records of results.jsonl."""
    database_images = [image for name, image in scene.images.items() if name not in scene.chosen]
    model_path = write_model(folder / "model", scene.cameras, database_images)
    list_path, output_path = folder / "queries.txt", folder / "output"
    list_path.write_text("".join(f"{query} {scene.camera(query).text()}\n" for query in scene.query_names))
    paths = {"database": scene.database_path, "input": model_path, "output": output_path, "query_list": list_path}
    path_options = [text for name, path in paths.items() for text in (f"--{name}_path", path)]
    run_colmap(arguments.colmap, "lazy_localizer", *path_options, *options, *arguments.options)
    return read_results(output_path / "results.jsonl")


def run_program(scene: SparseScene, folder: pathlib.Path, arguments, options: list, cell: Cell) -> dict[str, Result]:
    """Returns the results, and adds the normalised errors to the cell."""
    records = localize_by_program(scene, folder, arguments, options)
    for name, record in records.items():
        if pose_of(record) and record["covariance"]:
            centre = scene.true_pose(name).cam_in_world
            cell.squared_sigmas.append(position_error(pose_of(record), record["covariance"], centre)[1] ** 2)
    return read_method_results(folder / "output" / "results.jsonl", scene.query_names)


def run_scene(scene: Scene, arguments, cells: dict, reasons: dict[str, str]):
    """Adds the rows of a scene to the cells, by (is_star, num_images, method)."""
    for is_star in (False, True):
        for num_images in NUM_IMAGES[1 if is_star else 0 :]:
            with tempfile.TemporaryDirectory() as folder:
                sparse = make_sparse_scene(scene, num_images, is_star, pathlib.Path(folder))
                if not sparse.chosen:
                    continue
                for method in arguments.methods:
                    if num_images == 1 and method in RIVALS:
                        continue
                    cell = cells[is_star, num_images, method]
                    results = _run_method(method, sparse, pathlib.Path(folder), arguments, cell, num_images, reasons)
                    series = Series(method, num_images)
                    cell.rows += [make_row("sparse", sparse, name, series, result) for name, result in results.items()]


def _run_method(method, scene, folder, arguments, cell, num_images, reasons) -> dict[str, Result]:
    if method in PROGRAM_METHODS:
        return run_program(scene, folder, arguments, PROGRAM_METHODS[method], cell)
    try:
        localize = load_method(method)
        options = MethodOptions(folder / "method", arguments.colmap, num_retrieved=num_images)
        return localize(scene, scene.query_names, options)
    except NotApplicable as reason:
        reasons[method] = str(reason)
        return {}


def table(cells: dict, methods: list[str], is_star: bool) -> str:
    """Returns the figures of all scenes together. Ratios are over the poses that both localized."""
    lines = [
        "| K | method | queries | localized | median | within 5 cm, 1° | squared sigmas, median "
        "| error / motion averaging [95 %] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for num_images in NUM_IMAGES:
        for method in methods:
            cell = cells.get((is_star, num_images, method))
            if cell is None or not cell.rows:
                continue
            baseline = cells[is_star, num_images, "motion averaging"].rows if "motion averaging" in methods else []
            lines.append(f"| {num_images} | {method} | {_figures(cell, baseline)} |")
    return "\n".join(lines)


def _figures(cell: Cell, baseline: list[Row]) -> str:
    summary = summarize(cell.rows)
    share = 1 - summary.num_lost / summary.num_queries
    rows = collections.defaultdict(list)
    for row in cell.rows:
        if row.is_measured:
            rows[row.scene].append(row)
    medians = [np.median([row.position_error_cm for row in of_scene]) for of_scene in rows.values()]
    rotations = [np.median([row.rotation_error_deg for row in of_scene]) for of_scene in rows.values()]
    median = (
        f"{np.exp(np.mean(np.log(medians))):.2f} cm / {np.exp(np.mean(np.log(rotations))):.3f}°" if medians else "–"
    )
    right = np.mean([row.position_error_cm <= 5 and row.rotation_error_deg <= 1 for row in cell.rows])
    nees = f"{np.median(cell.squared_sigmas):.1f}" if cell.squared_sigmas else "–"
    ratio = paired_ratio(cell.rows, baseline)
    ratio_text = f"{ratio.mean:.2f} [{ratio.low:.2f}, {ratio.high:.2f}]" if ratio else "–"
    return f"{summary.num_queries} | {100 * share:.0f} % | {median} | {100 * right:.0f} % | {nees} | {ratio_text}"


@command
def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data_path", type=pathlib.Path, nargs="+", required=True, help="folders of scenes")
    parser.add_argument("--colmap", type=pathlib.Path, default=find_colmap(), help="path of our colmap program")
    parser.add_argument("--output_path", type=pathlib.Path, required=True, help="Markdown file to write")
    parser.add_argument("--scenes", nargs="+", help="default: all")
    parser.add_argument("--methods", nargs="+", default=[*PROGRAM_METHODS, *RIVALS], help="default: all")
    parser.add_argument("options", nargs="*", help="further options of lazy_localizer")
    arguments = parser.parse_args(arguments)
    cells, reasons = collections.defaultdict(Cell), {}
    for path in arguments.data_path:
        for name in find_scenes(path):
            if arguments.scenes and name not in arguments.scenes:
                continue
            print(name, flush=True)
            run_scene(load_scene(path / name), arguments, cells, reasons)
            _write(arguments, cells, reasons)


def _write(arguments, cells: dict, reasons: dict[str, str]):
    command_line = " ".join(["python -m benchmarks sparse --data_path DATA", *arguments.options])
    parts = ["# sparse", "\n\n".join(describe_environment()), f"`{command_line}`"]
    parts += ["## Overlapping database images", table(cells, arguments.methods, is_star=False)]
    parts += ["## Star", table(cells, arguments.methods, is_star=True)]
    parts += [f"{method}: {reason}" for method, reason in reasons.items()]
    arguments.output_path.write_text("\n\n".join(parts) + "\n")
