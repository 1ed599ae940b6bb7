"""Compares the seconds per query of lazy_localizer and of pycolmap on the same verified matches, on one core.

    python -m benchmarks runtime SCENE

`colmap lazy_localizer` runs with one thread. Its pose stage (the total without reading the database) is compared with
local triangulation: pycolmap's robust triangulation of each query keypoint, then its absolute pose, also without
reading. Its total is compared with two methods whose time includes reading: a map of the K database images, which
pycolmap's `triangulate_points` makes for each query, and COLMAP 4's structure-less registration, which uses all pairs.
The process is bound to one core and the methods run one after the other, so that they do not disturb each other.

Prints a table: medians over the queries in milliseconds, ratio of the medians, median of the ratios per query.
"""

import argparse
import os
import pathlib
import statistics
import tempfile

from benchmarks.localization.environment import describe_environment
from benchmarks.localization.methods import MethodOptions, load_method
from benchmarks.localization.scenes import Scene, load_scene
from colmap_lazyloc.errors import command
from colmap_lazyloc.program import find_colmap
from colmap_lazyloc.results import read_results

# The part of our time that each method is compared with.
COUNTERPARTS = {"local_triangulation": "pose stage", "local_map": "total", "colmap_structureless": "total"}


@command
def main(arguments=None):
    arguments = _parse(arguments)
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # child processes inherit it
    scene = load_scene(arguments.scene_path)
    query_names = scene.query_names[: arguments.num_queries]
    load_before = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        options = MethodOptions(pathlib.Path(folder), arguments.colmap, arguments.num_retrieved)
        ours = measure_ours(scene, query_names, options)
        others = {name: measure(name, scene, query_names, options) for name in arguments.methods}
    for line in describe_environment():
        print(line)
    print(
        f"{scene.name}, {len(query_names)} queries, K = {arguments.num_retrieved}, one core; load average "
        f"{load_before:.1f} before, {os.getloadavg()[0]:.1f} after\n"
    )
    print(table(ours, others))


def measure_ours(scene: Scene, query_names: list[str], options: MethodOptions) -> dict[str, dict[str, float]]:
    """Returns our seconds by part and query."""
    load_method("lazyloc")(scene, query_names, options)
    seconds = {"pose stage": {}, "total": {}}
    for name, record in read_results(options.work_path / "output" / "results.jsonl").items():
        seconds["total"][name] = record["seconds"]["total"]
        seconds["pose stage"][name] = record["seconds"]["total"] - record["seconds"]["load"]
    return seconds


def measure(method: str, scene: Scene, query_names: list[str], options: MethodOptions) -> dict[str, float]:
    """Returns the method's seconds by query."""
    results = load_method(method)(scene, query_names, options)
    return {name: result.seconds for name, result in results.items()}


def table(ours: dict[str, dict[str, float]], others: dict[str, dict[str, float]]) -> str:
    lines = ["| | median, ms | compared with | ratio of medians | median ratio |", "|---|---|---|---|---|"]
    for part, seconds in ours.items():
        lines.append(f"| ours, {part} | {1e3 * statistics.median(seconds.values()):.1f} | | | |")
    for method, seconds in others.items():
        part = COUNTERPARTS[method]
        median = statistics.median(seconds.values())
        ratio_of_medians = median / statistics.median(ours[part].values())
        median_ratio = statistics.median(seconds[name] / ours[part][name] for name in seconds)
        ratios = f"{ratio_of_medians:.1f} | {median_ratio:.1f}"
        lines.append(f"| `{method}` | {1e3 * median:.1f} | ours, {part} | {ratios} |")
    return "\n".join(lines)


def _parse(argv) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene_path", type=pathlib.Path, help="folder with database.db and model/ (text)")
    parser.add_argument("--colmap", type=pathlib.Path, default=find_colmap(), help="path of our colmap program")
    parser.add_argument("--methods", nargs="+", choices=COUNTERPARTS, default=list(COUNTERPARTS), help="default: all")
    parser.add_argument("--num_retrieved", type=int, default=20, metavar="K", help="database images per query")
    parser.add_argument("--num_queries", type=int, help="number of queries; default: all")
    return parser.parse_args(argv)
