#!/usr/bin/env python3
"""Compares estimated query poses with the ground truth: position and rotation errors, recall at thresholds.

Poses are files with lines `name qw qx qy qz tx ty tz` (cam_from_world, as in lazy_localizer's poses.txt) or folders of
COLMAP models, text or binary. A query without an estimated pose counts as a failure in every recall; mean and median
are over the localized queries. Lengths are in the unit of the database, printed as if it were the metre.
"""

import argparse
import dataclasses
import json
import math
import pathlib
import re
import sys

import numpy as np
from scipy.spatial.transform import Rotation

DEFAULT_THRESHOLDS = ((0.25, 2.0), (0.5, 5.0), (5.0, 10.0))
# hloc's `name MODEL width height params...`; any other line of a query list is a name.
QUERY_WITH_CAMERA = re.compile(r"(\S+)\s+[A-Z][A-Z0-9_]+(\s+[-+.0-9eE]+){3,}")


class InputError(Exception):
    """A mistake in the user's input, as one line."""


@dataclasses.dataclass(frozen=True)
class Pose:
    """cam_from_world."""

    rotation: Rotation
    translation: np.ndarray

    def cam_in_world(self) -> np.ndarray:
        return -self.rotation.inv().apply(self.translation)


def read_poses(path) -> dict:
    """Poses by name, of a poses file or a folder with a COLMAP model."""
    path = pathlib.Path(path)
    return _read_model(path) if path.is_dir() else _read_poses_file(path)


def read_query_names(path) -> list:
    names = {}
    for line_number, line in _entries(path):
        match = QUERY_WITH_CAMERA.fullmatch(line)
        name = match.group(1) if match else line
        if name in names:
            raise InputError(f"{path}:{line_number}: query '{name}' is listed twice")
        names[name] = None
    if not names:
        raise InputError(f"{path}: lists no query")
    return list(names)


def pose_errors(estimated: Pose, truth: Pose) -> tuple:
    """Distance of the projection centres, and the angle between the orientations in degrees."""
    position = np.linalg.norm(estimated.cam_in_world() - truth.cam_in_world())
    rotation = (estimated.rotation * truth.rotation.inv()).magnitude()
    return float(position), math.degrees(rotation)


def evaluate(estimated: dict, truth: dict, names) -> dict:
    """Errors of each query by name; None where it has no estimated pose."""
    return {name: pose_errors(estimated[name], truth[name]) if name in estimated else None for name in names}


def summarize(errors: dict, thresholds=DEFAULT_THRESHOLDS) -> dict:
    localized = np.array([error for error in errors.values() if error is not None]).reshape(-1, 2)

    def statistic(function, column):
        return float(function(localized[:, column])) if len(localized) > 0 else None

    summary = {"num_queries": len(errors), "num_localized": len(localized)}
    for column, quantity in enumerate(("position_error", "rotation_error_deg")):
        for name, function in (("median", np.median), ("mean", np.mean), ("max", np.max)):
            summary[f"{name}_{quantity}"] = statistic(function, column)
    summary["recall"] = [
        {"position": position, "rotation_deg": rotation_deg,
         "ratio": float(np.sum(np.all(localized <= (position, rotation_deg), axis=1))) / len(errors)}
        for position, rotation_deg in thresholds
    ]
    return summary


def _entries(path):
    """Number and text of the lines that are neither empty nor comments."""
    try:
        lines = pathlib.Path(path).read_text(encoding="utf-8", errors="backslashreplace").split("\n")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    for line_number, line in enumerate(lines, start=1):
        line = line.strip()
        if line and not line.startswith("#"):
            yield line_number, line


def _read_poses_file(path: pathlib.Path) -> dict:
    poses = {}
    for line_number, line in _entries(path):
        words = line.rsplit(maxsplit=7)  # a name may hold blanks
        try:
            name, numbers = words[0], np.array([float(word) for word in words[1:]])
            if numbers.size != 7 or not np.all(np.isfinite(numbers)):
                raise ValueError
        except ValueError:
            raise InputError(f"{path}:{line_number}: expected `name qw qx qy qz tx ty tz`, found '{line}'") from None
        norm = np.linalg.norm(numbers[:4])
        if abs(norm - 1) > 0.01:
            raise InputError(f"{path}:{line_number}: the quaternion's norm is {norm:.6g}, not 1")
        if name in poses:
            raise InputError(f"{path}:{line_number}: image '{name}' has a pose already")
        poses[name] = Pose(Rotation.from_quat(np.roll(numbers[:4], -1)), numbers[4:])
    return poses


def _read_model(path: pathlib.Path) -> dict:
    if not any((path / f"images.{suffix}").exists() for suffix in ("bin", "txt")):
        raise InputError(f"{path}: holds no COLMAP model (no images.bin or images.txt)")
    import pycolmap  # here, so that poses files are read without it

    try:
        model = pycolmap.Reconstruction(path)
    except Exception as error:
        raise InputError(f"{path}: no readable COLMAP model: {str(error).strip().splitlines()[-1]}") from None
    poses = {}
    for image in model.images.values():
        if image.name in poses:
            raise InputError(f"{path}: two images are named '{image.name}'")
        cam_from_world = image.cam_from_world()
        poses[image.name] = Pose(Rotation.from_quat(cam_from_world.rotation.quat), cam_from_world.translation)
    return poses


def choose_queries(estimated: dict, truth: dict, options) -> list:
    """The names that count."""
    if options.query_list_path is not None:
        names = read_query_names(options.query_list_path)
        unknown = [name for name in names if name not in truth]
        if unknown:
            raise InputError(f"{options.ground_truth}: has no pose of {len(unknown)} of {len(names)} queries of "
                             f"{options.query_list_path}; the first is '{unknown[0]}'")
        return names
    if options.ground_truth.is_dir():  # a model holds the database images too
        names = sorted(set(estimated) & set(truth))
        print("queries: the images of the estimated poses; those that are missing there count only with "
              "--query_list_path", file=sys.stderr)
        if not names:
            raise InputError(f"{options.estimated_poses}: no image of {options.ground_truth} has a pose here")
        return names
    if not truth:
        raise InputError(f"{options.ground_truth}: holds no pose")
    if estimated and not set(estimated) & set(truth):
        raise InputError(f"{options.estimated_poses}: has no name in common with {options.ground_truth}")
    return sorted(truth)


def format_length(length: float) -> str:
    if length >= 1:
        return f"{length:.3f} m"
    return f"{100 * length:.2f} cm" if length >= 0.01 else f"{1000 * length:.2f} mm"


def format_table(summary: dict) -> str:
    lines = [f"localized       {summary['num_localized']} of {summary['num_queries']}"]
    if summary["num_localized"] > 0:
        for label, quantity, text in (("position error", "position_error", format_length),
                                      ("rotation error", "rotation_error_deg", "{:.3f} deg".format)):
            figures = (f"{name} {text(summary[f'{name}_{quantity}']):<12}" for name in ("median", "mean", "max"))
            lines.append(f"{label}  {' '.join(figures)}".rstrip())
    for recall in summary["recall"]:
        limits = f"{recall['position']:g} m, {recall['rotation_deg']:g} deg"
        lines.append(f"within {limits:<18}{100 * recall['ratio']:5.1f} %")
    return "\n".join(lines)


def format_queries(errors: dict) -> str:
    width = max(len(name) for name in errors)
    return "\n".join(
        f"{name:<{width}}  "
        + ("not localized" if error is None else f"{format_length(error[0]):>10}  {error[1]:.3f} deg")
        for name, error in errors.items())


def write_json(path: pathlib.Path, summary: dict, errors: dict) -> None:
    queries = {name: None if error is None else {"position_error": error[0], "rotation_error_deg": error[1]}
               for name, error in errors.items()}
    try:
        path.write_text(json.dumps({**summary, "queries": queries}, indent=2) + "\n")
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
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("estimated_poses", type=pathlib.Path, help="poses file or COLMAP model")
    parser.add_argument("--ground_truth", type=pathlib.Path, required=True, help="poses file or COLMAP model")
    parser.add_argument("--query_list_path", type=pathlib.Path,
                        help="the queries that count, a name or `name MODEL width height params...` a line; "
                        "default: all names of a ground-truth file; with a model, those with an estimated pose")
    parser.add_argument("--thresholds", type=_threshold, nargs="+", default=DEFAULT_THRESHOLDS,
                        metavar="POSITION,DEG", help="default: 0.25,2 0.5,5 5,10")
    parser.add_argument("--per_query", action="store_true", help="print each query's errors too")
    parser.add_argument("--json", type=pathlib.Path, help="write the figures into this file too")
    return parser.parse_args(arguments)


def main(arguments=None) -> int:
    try:
        options = parse_arguments(arguments)
        estimated, truth = read_poses(options.estimated_poses), read_poses(options.ground_truth)
        errors = evaluate(estimated, truth, choose_queries(estimated, truth, options))
        summary = summarize(errors, options.thresholds)
        if options.json is not None:
            write_json(options.json, summary, errors)
        if options.per_query:
            print(format_queries(errors))
        print(format_table(summary))
    except InputError as error:
        print(f"evaluate.py: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
