"""Localizes queries against one to four database images, with and without points that two of these have in common.

    python -m benchmarks sparse --data_path DATA... --output_path OUT.md [-- OPTIONS OF LAZY_LOCALIZER]

DATA are folders of scenes as for `python -m benchmarks run --dataset scenes`. The database images of a query are the K
with the most verified matches. "Star": each keypoint of the query keeps its match in one of them, so that the query is
all that they have in common. Every method gets the same matches. "With a position": the program gets the true one with
an error whose standard deviation is 5 % of the extent of the scene's cameras; "and gravity": with one of 1°.
"""

import argparse
import collections
import dataclasses
import itertools
import json
import pathlib
import tempfile

import numpy as np

from benchmarks.localization.environment import describe_environment
from benchmarks.localization.evaluation import paired_ratio, summarize
from benchmarks.localization.methods import NotApplicable
from benchmarks.localization.scenes import Scene, find_scenes, load_scene
from benchmarks.localization.sparse_runs import MOTION_AVERAGING, PROGRAM_METHODS, Record, run_method
from benchmarks.localization.sparse_scenes import make_sparse_scene
from colmap_lazyloc.errors import command
from colmap_lazyloc.program import find_colmap

NUM_IMAGES = (1, 2, 3, 4)
# Other methods. They need two images: with one, they search for a scale that the matches do not have.
OTHER_METHODS = ("generalized_relative_pose", "poselib_generalized", "poselib_hybrid", "colmap_structureless")
# Bounds of the confidence in the table that compares it with the share of right poses.
CONFIDENCE_BOUNDS = (0, 0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 1)


def run_scene(scene: Scene, arguments, cells: dict, reasons: dict[str, str]):
    """Adds the records of a scene to the cells, by (is_star, num_images, method)."""
    for is_star in (False, True):
        for num_images in NUM_IMAGES[1 if is_star else 0 :]:
            with tempfile.TemporaryDirectory() as folder:
                sparse = make_sparse_scene(scene, num_images, is_star, pathlib.Path(folder), arguments.max_num_queries)
                if not sparse.chosen:
                    continue
                for method in arguments.methods:
                    if num_images == 1 and method in OTHER_METHODS:
                        continue
                    try:
                        records = run_method(method, sparse, pathlib.Path(folder), arguments, num_images, is_star)
                        cells[is_star, num_images, method] += records
                    except NotApplicable as reason:
                        reasons[method] = str(reason)


def table(cells: dict, methods: list[str], is_star: bool) -> str:
    """Returns the figures of all scenes together. Ratios are over the poses that both localized."""
    lines = [
        "| K | method | queries | localized | median errors | queries within 5 cm and 1° "
        "| median of normalized squared error (right: 2.4) | position error divided by motion averaging's [95 %] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for num_images in NUM_IMAGES:
        for method in methods:
            records = cells.get((is_star, num_images, method))
            if records:
                baseline = cells.get((is_star, num_images, MOTION_AVERAGING), [])
                lines.append(f"| {num_images} | {method} | {_figures(records, baseline)} |")
    return "\n".join(lines)


def _figures(records: list[Record], baseline: list[Record]) -> str:
    all_rows = [record.row for record in records]
    summary = summarize(all_rows)
    share = 1 - summary.num_lost / summary.num_queries
    rows = collections.defaultdict(list)
    for row in all_rows:
        if row.is_measured:
            rows[row.scene].append(row)
    medians = [np.median([row.position_error_cm for row in of_scene]) for of_scene in rows.values()]
    rotations = [np.median([row.rotation_error_deg for row in of_scene]) for of_scene in rows.values()]
    median = (
        f"{np.exp(np.mean(np.log(medians))):.2f} cm / {np.exp(np.mean(np.log(rotations))):.3f}°" if medians else "–"
    )
    right = np.mean([row.position_error_cm <= 5 and row.rotation_error_deg <= 1 for row in all_rows])
    squared_sigmas = [r.error_sigma**2 for r in records if r.has_covariance and not r.row.is_lost]
    nees = f"{np.median(squared_sigmas):.1f}" if squared_sigmas else "–"
    ratio = paired_ratio(all_rows, [record.row for record in baseline])
    ratio_text = f"{ratio.mean:.2f} [{ratio.low:.2f}, {ratio.high:.2f}]" if ratio else "–"
    return f"{summary.num_queries} | {100 * share:.0f} % | {median} | {100 * right:.0f} % | {nees} | {ratio_text}"


def status_table(cells: dict, methods: list[str]) -> str:
    """Returns the number of queries of each status. Right ones of LOW_CONFIDENCE are in brackets."""
    lines = ["| | K | method | statuses |", "|---|---|---|---|"]
    for (is_star, num_images, method), records in cells.items():
        if method not in methods or method not in PROGRAM_METHODS:
            continue
        counts = collections.Counter(record.row.status for record in records)
        right = sum(record.is_right for record in records if record.row.status == "LOW_CONFIDENCE")
        text = ", ".join(f"`{status}` {count}" for status, count in counts.most_common())
        text = text.replace("`LOW_CONFIDENCE`", f"`LOW_CONFIDENCE` ({right} right)")
        lines.append(f"| {'star' if is_star else 'overlap'} | {num_images} | {method} | {text} |")
    return "\n".join(lines)


def reliability_table(cells: dict) -> str:
    """Compares the confidence with the share of right poses; both also of poses that are refused."""
    lines = ["| confidence | overlap: poses, mean, right | star: poses, mean, right |", "|---|---|---|"]
    for low, high in itertools.pairwise(CONFIDENCE_BOUNDS):
        texts = []
        for wanted in (False, True):
            of_kind = [
                record
                for (is_star, num_images, method), records in cells.items()
                if is_star == wanted and num_images > 1 and method == "lazyloc"
                for record in records
                if record.has_covariance and low <= record.confidence and (record.confidence < high or high == 1)
            ]
            mean = np.mean([record.confidence for record in of_kind]) if of_kind else np.nan
            right = np.mean([record.is_right for record in of_kind]) if of_kind else np.nan
            texts.append(f"{len(of_kind)}, {mean:.2f}, {right:.2f}" if of_kind else "–")
        lines.append(f"| {low} to {high} | {' | '.join(texts)} |")
    return "\n".join(lines)


@command
def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data_path", type=pathlib.Path, nargs="+", required=True, help="folders of scenes")
    parser.add_argument("--colmap", type=pathlib.Path, default=find_colmap(), help="path of our colmap program")
    parser.add_argument("--output_path", type=pathlib.Path, required=True, help="Markdown file to write")
    parser.add_argument("--scenes", nargs="+", help="default: all")
    parser.add_argument(
        "--methods", nargs="+", default=[*PROGRAM_METHODS, MOTION_AVERAGING, *OTHER_METHODS], help="default: all"
    )
    parser.add_argument("--max_num_queries", type=int, help="of a scene, evenly spread; default: all")
    parser.add_argument(
        "--truth_stddev",
        nargs="+",
        default=[],
        metavar="SCENE=LENGTH",
        help="standard deviation of the errors of a scene's true positions along each axis; default: 0",
    )
    parser.add_argument("options", nargs="*", help="further options of lazy_localizer")
    arguments = parser.parse_args(arguments)
    arguments.truth_stddevs = {name: float(length) for name, length in (a.split("=") for a in arguments.truth_stddev)}
    cells, reasons = collections.defaultdict(list), {}
    for path in arguments.data_path:
        for name in find_scenes(path):
            if arguments.scenes and name not in arguments.scenes:
                continue
            print(name, flush=True)
            run_scene(load_scene(path / name), arguments, cells, reasons)
            _write(arguments, cells, reasons)


def _write(arguments, cells: dict, reasons: dict[str, str]):
    """Writes the tables, and beside them a line of JSON for each query."""
    command_line = " ".join(["python -m benchmarks sparse --data_path DATA", *arguments.options])
    parts = ["# sparse", "\n\n".join(describe_environment()), f"`{command_line}`"]
    parts += ["## Overlapping database images", table(cells, arguments.methods, is_star=False)]
    parts += ["## Star", table(cells, arguments.methods, is_star=True)]
    parts += ["## Statuses", status_table(cells, arguments.methods)]
    parts += ["## Confidence", reliability_table(cells)]
    parts += [f"{method}: {reason}" for method, reason in reasons.items()]
    arguments.output_path.write_text("\n\n".join(parts) + "\n")
    records = [dataclasses.asdict(record) for of_cell in cells.values() for record in of_cell]
    lines = [json.dumps(record) + "\n" for record in records]
    arguments.output_path.with_suffix(".jsonl").write_text("".join(lines))
