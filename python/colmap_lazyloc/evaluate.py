"""Compares estimated query poses with ground truth: position and rotation errors, recall at thresholds.

    lazyloc evaluate ESTIMATED --ground_truth TRUTH

ESTIMATED is the output folder of `colmap lazy_localizer`. ESTIMATED and TRUTH may also be files with lines
`name qw qx qy qz tx ty tz` (cam_from_world, as in poses.txt), or folders with a COLMAP model, text or binary.
TRUTH may also be a trajectory in TUM's format, `timestamp tx ty tz qx qy qz qw` (world_from_cam); a query's time is the
last number in its file name. `lazyloc import` makes a COLMAP model from poses in other formats. TRUTH may have the
names of the photos without the folder `query/` of `lazyloc run`.
Mean and median are of the localized queries. The recall is of all queries: a query without a pose is a failure.
"""

import argparse
import dataclasses
import json
import pathlib
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import TypedDict

import numpy as np

from colmap_lazyloc.array_types import Floats
from colmap_lazyloc.errors import InputError, Parser, command, logger
from colmap_lazyloc.model import ModelLike, poses_of, read_model
from colmap_lazyloc.pose_formats.assembly import assemble_poses
from colmap_lazyloc.pose_formats.posed_images import Photos, Source
from colmap_lazyloc.pose_formats.raw_poses import errors_named
from colmap_lazyloc.pose_formats.registry import FORMATS
from colmap_lazyloc.pose_formats.signatures import Head
from colmap_lazyloc.poses import Pose, PoseLike, read_poses
from colmap_lazyloc.queries import read_queries
from colmap_lazyloc.results import RESULTS, find_run, read_results, under_names_of

# The thresholds of visuallocalization.net, in metres and degrees.
DEFAULT_THRESHOLDS = ((0.25, 2.0), (0.5, 5.0), (5.0, 10.0))


Errors = dict[str, tuple[float, float] | None]  # {query name: (position error, rotation error in degrees) or None}
METRE = "m"  # the other unit is that of the database, whatever it is


class Recall(TypedDict):
    """The share of queries (`ratio`) with a position error of at most `position`, and a rotation error of at most
    `rotation_deg`."""

    position: float
    rotation_deg: float
    ratio: float


class Summary(TypedDict):
    """Errors of the localized queries (None if no query is localized), and the recall over all queries."""

    num_queries: int
    num_localized: int
    median_position_error: float | None
    mean_position_error: float | None
    max_position_error: float | None
    median_rotation_error_deg: float | None
    mean_rotation_error_deg: float | None
    max_rotation_error_deg: float | None
    recall: list[Recall]


def _read_queries(estimated: pathlib.Path) -> set[str] | None:
    """Returns the queries of the run in a folder, or of the results that the poses are a part of."""
    folder = find_run(estimated).results
    if folder is None and find_run(estimated.parent).results == estimated.parent:
        folder = estimated.parent
    return None if folder is None else set(read_results(folder / RESULTS))


def read_any_poses(path: pathlib.Path) -> dict[str, Pose]:
    """Reads the poses, by name, from a poses file or from a folder with a COLMAP model or with the results of a run."""
    folder = find_run(path).results
    if folder is not None:
        path = folder / "poses.txt"
    if not path.is_dir():
        return read_poses(path)
    return poses_of(read_model(path))


@dataclasses.dataclass(frozen=True)
class _Queries(Photos):
    """Queries in the place of photos in a folder."""

    listed: tuple[str, ...] = ()
    names = property(lambda self: sorted(self.listed))


def read_true_poses(path: pathlib.Path, queries: Collection[str]) -> dict[str, Pose]:
    """Reads true poses by name: as `read_any_poses`, or a trajectory in TUM's format, whose poses belong to queries by
    the times in their names."""
    tum = FORMATS["tum"]
    if not path.is_file() or not tum.is_one(head := Head(path)) or head.first_row[0] in queries:
        return read_any_poses(path)
    source = Source(path, _Queries(path.parent, listed=tuple(queries)))
    with errors_named(path):
        poses = assemble_poses(tum.parse(source), tum.convention, source)
    if len(poses) < len(queries):
        logger.warning("%s has no pose of %d queries", path, len(queries) - len(poses))
    return poses


def evaluate(
    estimated: ModelLike | Mapping[str, PoseLike], truth: ModelLike | Mapping[str, PoseLike], names: Iterable[str]
) -> Errors:
    """Returns a dict with the error of each query in `names`: (position error, rotation error in degrees), or None if
    the query has no estimated pose.

    `estimated` and `truth` are a `Model`, a pycolmap.Reconstruction, or a dict {name: pose}. A pose is a `Pose`, a
    pycolmap.Rigid3d or a pycolmap.Image.
    """
    poses, true_poses = poses_of(estimated), poses_of(truth)
    return {name: poses[name].errors(true_poses[name]) if name in poses else None for name in names}


def summarize(errors: Errors, thresholds: Sequence[tuple[float, float]] = DEFAULT_THRESHOLDS) -> Summary:
    """Returns the median, mean and maximum error of the localized queries, and the recall at each threshold.

    A threshold is a pair: the maximum position error in the unit of the model, and the maximum rotation error in
    degrees.
    """
    localized = np.array([error for error in errors.values() if error is not None], float).reshape(-1, 2)

    def statistic(function: Callable[[Floats], np.floating], column: int) -> float | None:
        return float(function(localized[:, column])) if len(localized) > 0 else None

    def recall(position: float, rotation_deg: float) -> Recall:
        num_within = float(np.sum(np.all(localized <= (position, rotation_deg), axis=1)))
        return {"position": position, "rotation_deg": rotation_deg, "ratio": num_within / len(errors)}

    return {
        "num_queries": len(errors),
        "num_localized": len(localized),
        "median_position_error": statistic(np.median, 0),
        "mean_position_error": statistic(np.mean, 0),
        "max_position_error": statistic(np.max, 0),
        "median_rotation_error_deg": statistic(np.median, 1),
        "mean_rotation_error_deg": statistic(np.mean, 1),
        "max_rotation_error_deg": statistic(np.max, 1),
        "recall": [recall(*threshold) for threshold in thresholds],
    }


def choose_queries(
    estimated: Collection[str], queries: set[str] | None, truth: Collection[str], options: argparse.Namespace
) -> tuple[list[str], bool]:
    """Returns the names of the queries to evaluate, and whether those without an estimated pose are among them;
    `queries`: of the run, if they are known."""
    if options.query_list_path is not None:
        names = [*under_names_of(truth, dict.fromkeys(read_queries(options.query_list_path)))]
        unknown = [name for name in names if name not in truth]
        if unknown:
            raise InputError(
                f"{options.ground_truth}: has no pose of {len(unknown)} of {len(names)} queries of "
                f"{options.query_list_path}; the first is '{unknown[0]}'"
            )
        return names, True
    if options.ground_truth.is_dir():  # a model also has the database images
        return choose_queries_of_model(set(estimated), queries, set(truth), options)
    if not truth:
        raise InputError(f"{options.ground_truth}: holds no pose")
    if estimated and not set(estimated) & set(truth):
        raise InputError(f"{options.estimated_poses}: has no name in common with {options.ground_truth}")
    return sorted(truth), True


def choose_queries_of_model(
    estimated: set[str], found: set[str] | None, truth: set[str], options: argparse.Namespace
) -> tuple[list[str], bool]:
    """Returns the same if the true poses are those of a model."""
    queries = estimated if found is None else found
    names = sorted(queries & truth)
    if not names:
        raise InputError(f"{options.estimated_poses}: no image of {options.ground_truth} has a pose here")
    if found is None:
        logger.warning("only estimated poses are compared: --query_list_path names the queries")
    elif queries - truth:
        logger.warning("%s has no pose of %d queries", options.ground_truth, len(queries - truth))
    return names, found is not None


def format_length(length: float, unit: str) -> str:
    if unit != METRE:
        return f"{length:.4g}"
    if length >= 1:
        return f"{length:.3f} m"
    return f"{100 * length:.2f} cm" if length >= 0.01 else f"{1000 * length:.2f} mm"


def format_table(summary: Summary, unit: str, are_queries_known: bool) -> str:
    localized = f"localized       {summary['num_localized']} of {summary['num_queries']}"
    lines = [localized if are_queries_known else f"compared        {summary['num_localized']}"]
    if summary["num_localized"] > 0:
        values = {name: value for name, value in summary.items() if isinstance(value, float)}
        for label, quantity, text in (
            ("position error", "position_error", lambda length: format_length(length, unit)),
            ("rotation error", "rotation_error_deg", "{:.3f} deg".format),
        ):
            figures = (f"{name} {text(values[f'{name}_{quantity}']):<12}" for name in ("median", "mean", "max"))
            lines.append(f"{label}  {' '.join(figures)}".rstrip())
    for recall in summary["recall"]:
        limits = f"{recall['position']:g}{' m' if unit == METRE else ''}, {recall['rotation_deg']:g} deg"
        lines.append(f"within {limits:<18}{100 * recall['ratio']:5.1f} %")
    if unit != METRE:
        lines.append("Lengths are in the unit of the database.")
    return "\n".join(lines)


def format_queries(errors: Errors, unit: str) -> str:
    width = max(len(name) for name in errors)
    return "\n".join(
        f"{name:<{width}}  "
        + ("not localized" if error is None else f"{format_length(error[0], unit):>10}  {error[1]:.3f} deg")
        for name, error in errors.items()
    )


def write_json(path: pathlib.Path, summary: Summary, errors: Errors, unit: str) -> None:
    queries = {
        name: None if error is None else {"position_error": error[0], "rotation_error_deg": error[1]}
        for name, error in errors.items()
    }
    try:
        path.write_text(json.dumps({"unit": unit, **summary, "queries": queries}, indent=2) + "\n")
    except OSError as error:
        raise InputError(f"--json: {path}: cannot be written: {error.strerror}") from None


def _threshold(text: str) -> tuple[float, float]:
    try:
        position, rotation_deg = (float(word) for word in text.split(","))
        if not (position >= 0 and rotation_deg >= 0):
            raise ValueError
    except ValueError:
        raise InputError(f"--thresholds: expected `position,degrees` such as 0.25,2, found '{text}'") from None
    return position, rotation_deg


def parse_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(prog="lazyloc evaluate", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "estimated_poses", type=pathlib.Path, help="output folder of a run, poses file, or folder with a COLMAP model"
    )
    parser.add_argument(
        "--ground_truth",
        type=pathlib.Path,
        required=True,
        help="poses file, folder with a COLMAP model, or trajectory in TUM's format",
    )
    parser.add_argument(
        "--query_list_path",
        type=pathlib.Path,
        help="file with the queries to evaluate, one per line: `name` or `name MODEL width height params...`; default: "
        "all names in the ground-truth file. If the ground truth is a model: the queries of the run that are in the "
        "model; without results.jsonl, all images with an estimated pose",
    )
    parser.add_argument(
        "--thresholds",
        nargs="+",
        metavar="POSITION,DEG",
        help="maximum errors for the recall: position in the unit of the poses, rotation in degrees; "
        "default: 0.25,2 0.5,5 5,10",
    )
    parser.add_argument(
        "--unit",
        choices=("database", METRE),
        help="unit of the printed lengths: m (metres), or database (the unknown unit of the poses); "
        "default: m if the ground truth has geo.json",
    )
    parser.add_argument("--per_query", action="store_true", help="also print the errors of each query")
    parser.add_argument("--json", type=pathlib.Path, help="also write the results to this file")
    options = parser.parse_args(arguments)
    if options.unit is None:
        options.unit = METRE if (options.ground_truth / "geo.json").is_file() else "database"
    options.thresholds = [_threshold(text) for text in options.thresholds] if options.thresholds else DEFAULT_THRESHOLDS
    return options


@command(name="lazyloc evaluate")
def main(arguments: Sequence[str] | None = None) -> None:
    options = parse_arguments(arguments)
    estimated, queries = read_any_poses(options.estimated_poses), _read_queries(options.estimated_poses)
    truth = read_true_poses(options.ground_truth, {*estimated} if queries is None else queries)
    truth = under_names_of({*estimated, *(queries or ())}, truth)
    names, are_queries_known = choose_queries(estimated, queries, truth, options)
    errors = evaluate(estimated, truth, names)
    summary = summarize(errors, options.thresholds)
    if options.json is not None:
        write_json(options.json, summary, errors, options.unit)
    if options.per_query:
        print(format_queries(errors, options.unit))
    print(format_table(summary, options.unit, are_queries_known))


if __name__ == "__main__":
    sys.exit(main())
