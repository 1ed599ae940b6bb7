"""Compares estimated query poses with ground truth: position and rotation errors, recall at thresholds.

    lazyloc evaluate ESTIMATED --ground_truth TRUTH

ESTIMATED is the output folder of `colmap lazy_localizer`. ESTIMATED and TRUTH may also be files with lines
`name qw qx qy qz tx ty tz` (cam_from_world, as in poses.txt) or folders with a COLMAP model, text or binary. A query
without an estimated pose counts as a failure in every recall; mean and median are taken over the localized queries.
Lengths are in the unit of the database, which is the metre if --unit says so or TRUTH is a model with geographic
coordinates.
"""

import argparse
import json
import pathlib
import sys

import numpy as np

from colmap_lazyloc.errors import InputError, command
from colmap_lazyloc.model import read_model
from colmap_lazyloc.poses import Pose, read_poses
from colmap_lazyloc.queries import read_queries
from colmap_lazyloc.results import read_results

# The thresholds of visuallocalization.net, in metres and degrees.
DEFAULT_THRESHOLDS = ((0.25, 2.0), (0.5, 5.0), (5.0, 10.0))

METRE = "m"  # the other unit is that of the database, whatever it is


def find_run(estimated: pathlib.Path) -> pathlib.Path | None:
    """Returns the output folder of the run that wrote the poses: the path itself, or the folder that holds it."""
    return next((folder for folder in (estimated, estimated.parent) if (folder / "results.jsonl").is_file()), None)


def read_any_poses(path: pathlib.Path) -> dict[str, Pose]:
    """Reads the poses, by name, from a poses file or from a folder with a COLMAP model or with the results of a run."""
    if (path / "results.jsonl").is_file():
        path = path / "poses.txt"
    if not path.is_dir():
        return read_poses(path)
    return {name: image.cam_from_world for name, image in read_model(path).images.items()}


def evaluate(estimated: dict, truth: dict, names) -> dict:
    """Returns position error and rotation error in degrees by query name; None if there is no estimated pose."""
    return {name: estimated[name].errors(truth[name]) if name in estimated else None for name in names}


def summarize(errors: dict, thresholds=DEFAULT_THRESHOLDS) -> dict:
    """Returns median, mean and maximum errors of the localized queries, and the recall at each threshold."""
    localized = np.array([error for error in errors.values() if error is not None]).reshape(-1, 2)

    def statistic(function, column):
        return float(function(localized[:, column])) if len(localized) > 0 else None

    summary = {"num_queries": len(errors), "num_localized": len(localized)}
    for column, quantity in enumerate(("position_error", "rotation_error_deg")):
        for name, function in (("median", np.median), ("mean", np.mean), ("max", np.max)):
            summary[f"{name}_{quantity}"] = statistic(function, column)
    summary["recall"] = [
        {
            "position": position,
            "rotation_deg": rotation_deg,
            "ratio": float(np.sum(np.all(localized <= (position, rotation_deg), axis=1))) / len(errors),
        }
        for position, rotation_deg in thresholds
    ]
    return summary


def choose_queries(estimated: dict, truth: dict, options) -> tuple[list, bool]:
    """Returns the names of the queries to evaluate, and whether those without an estimated pose are among them."""
    if options.query_list_path is not None:
        names = list(read_queries(options.query_list_path))
        unknown = [name for name in names if name not in truth]
        if unknown:
            raise InputError(
                f"{options.ground_truth}: has no pose of {len(unknown)} of {len(names)} queries of "
                f"{options.query_list_path}; the first is '{unknown[0]}'"
            )
        return names, True
    if options.ground_truth.is_dir():  # a model also has the database images
        return choose_queries_of_model(set(estimated), set(truth), options)
    if not truth:
        raise InputError(f"{options.ground_truth}: holds no pose")
    if estimated and not set(estimated) & set(truth):
        raise InputError(f"{options.estimated_poses}: has no name in common with {options.ground_truth}")
    return sorted(truth), True


def choose_queries_of_model(estimated: set, truth: set, options) -> tuple[list, bool]:
    """Returns the same if the true poses are those of a model."""
    run = find_run(options.estimated_poses)
    queries = estimated if run is None else set(read_results(run / "results.jsonl"))
    names = sorted(queries & truth)
    if not names:
        raise InputError(f"{options.estimated_poses}: no image of {options.ground_truth} has a pose here")
    if run is None:
        print("only estimated poses are compared: --query_list_path names the queries", file=sys.stderr)
    elif queries - truth:
        print(f"{options.ground_truth} has no pose of {len(queries - truth)} queries", file=sys.stderr)
    return names, run is not None


def format_length(length: float, unit: str) -> str:
    if unit != METRE:
        return f"{length:.4g}"
    if length >= 1:
        return f"{length:.3f} m"
    return f"{100 * length:.2f} cm" if length >= 0.01 else f"{1000 * length:.2f} mm"


def format_table(summary: dict, unit: str, are_queries_known: bool) -> str:
    localized = f"localized       {summary['num_localized']} of {summary['num_queries']}"
    lines = [localized if are_queries_known else f"compared        {summary['num_localized']}"]
    if summary["num_localized"] > 0:
        for label, quantity, text in (
            ("position error", "position_error", lambda length: format_length(length, unit)),
            ("rotation error", "rotation_error_deg", "{:.3f} deg".format),
        ):
            figures = (f"{name} {text(summary[f'{name}_{quantity}']):<12}" for name in ("median", "mean", "max"))
            lines.append(f"{label}  {' '.join(figures)}".rstrip())
    for recall in summary["recall"]:
        limits = f"{recall['position']:g}{' m' if unit == METRE else ''}, {recall['rotation_deg']:g} deg"
        lines.append(f"within {limits:<18}{100 * recall['ratio']:5.1f} %")
    if unit != METRE:
        lines.append("Lengths are in the unit of the database.")
    return "\n".join(lines)


def format_queries(errors: dict, unit: str) -> str:
    width = max(len(name) for name in errors)
    return "\n".join(
        f"{name:<{width}}  "
        + ("not localized" if error is None else f"{format_length(error[0], unit):>10}  {error[1]:.3f} deg")
        for name, error in errors.items()
    )


def write_json(path: pathlib.Path, summary: dict, errors: dict, unit: str) -> None:
    queries = {
        name: None if error is None else {"position_error": error[0], "rotation_error_deg": error[1]}
        for name, error in errors.items()
    }
    try:
        path.write_text(json.dumps({"unit": unit, **summary, "queries": queries}, indent=2) + "\n")
    except OSError as error:
        raise InputError(f"--json: {path}: cannot be written: {error.strerror}") from None


def _threshold(text: str) -> tuple:
    try:
        position, rotation_deg = (float(word) for word in text.split(","))
        if not (position >= 0 and rotation_deg >= 0):
            raise ValueError
    except ValueError:
        raise InputError(f"--thresholds: expected `position,degrees` such as 0.25,2, found '{text}'") from None
    return position, rotation_deg


def parse_arguments(arguments):
    parser = argparse.ArgumentParser(
        prog="lazyloc evaluate", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "estimated_poses", type=pathlib.Path, help="output folder of a run, poses file, or folder with a COLMAP model"
    )
    parser.add_argument(
        "--ground_truth", type=pathlib.Path, required=True, help="poses file, or folder with a COLMAP model"
    )
    parser.add_argument(
        "--query_list_path",
        type=pathlib.Path,
        help="file with the queries to evaluate, one per line: `name` or `name MODEL width height params...`; "
        "default: all names in the ground-truth file, or, if it is a model, those of its images that were queries of "
        "the run (results.jsonl beside the estimated poses), or else all with an estimated pose",
    )
    parser.add_argument(
        "--thresholds",
        nargs="+",
        metavar="POSITION,DEG",
        help="position and rotation thresholds of the recall; default: 0.25,2 0.5,5 5,10",
    )
    parser.add_argument(
        "--unit",
        choices=("database", METRE),
        help="unit of lengths: m, or whatever the database has; default: m if TRUTH is a model with geo.json",
    )
    parser.add_argument("--per_query", action="store_true", help="also print the errors of each query")
    parser.add_argument("--json", type=pathlib.Path, help="also write the results to this file")
    options = parser.parse_args(arguments)
    if options.unit is None:
        options.unit = METRE if (options.ground_truth / "geo.json").is_file() else "database"
    options.thresholds = [_threshold(text) for text in options.thresholds] if options.thresholds else DEFAULT_THRESHOLDS
    return options


@command(name="lazyloc evaluate")
def main(arguments=None):
    options = parse_arguments(arguments)
    estimated, truth = read_any_poses(options.estimated_poses), read_any_poses(options.ground_truth)
    names, are_queries_known = choose_queries(estimated, truth, options)
    errors = evaluate(estimated, truth, names)
    summary = summarize(errors, options.thresholds)
    if options.json is not None:
        write_json(options.json, summary, errors, options.unit)
    if options.per_query:
        print(format_queries(errors, options.unit))
    print(format_table(summary, options.unit, are_queries_known))


if __name__ == "__main__":
    sys.exit(main())
