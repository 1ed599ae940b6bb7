"""Reads a finished run of `colmap lazy_localizer`, and what a report compares it with."""

import dataclasses
import datetime
import functools
import json
import pathlib
from collections.abc import Iterable, Mapping

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Image, Model, poses_of, read_model
from colmap_lazyloc.points import Points, read_points
from colmap_lazyloc.poses import Pose, pose_errors
from colmap_lazyloc.progress import progress
from colmap_lazyloc.project.folder import ALIGNMENT, ARBITRARY_AXES, LOCALIZED, WITHOUT_POSES, Folder
from colmap_lazyloc.report.facts import METRE, MODEL_UNITS
from colmap_lazyloc.report.geometry import stack_poses
from colmap_lazyloc.report.options_file import RunOptions, read_options
from colmap_lazyloc.report.result_check import check_result
from colmap_lazyloc.result_fields import LeaveOneOutFields, ResultFields
from colmap_lazyloc.results import (
    RESULTS,
    Change,
    ControlResidual,
    find_run,
    pose_of,
    read_changes,
    read_control_residuals,
    read_results,
    unconfirmed_pose_of,
    under_names_of,
)


@dataclasses.dataclass(frozen=True)
class Run:
    """A finished run. Queries are in the order in which the report lists them, the least certain first."""

    path: pathlib.Path
    queries: list[ResultFields]  # results
    model: Model  # that the run wrote
    database: Model  # the posed images with which queries were compared
    points: Points
    options: RunOptions
    leave_one_out: LeaveOneOutFields | None  # leave_one_out.json
    truth: dict[str, Pose]  # by query name; empty if unknown
    unit: str  # of lengths: METRE, or MODEL_UNITS
    changes: list[Change]  # between two epochs, changes.json
    control: list[ControlResidual]  # control_points.json
    places_before: dict[str, Array]  # of photos that were adjusted together, by name
    project: Folder | None  # of `lazyloc run`

    @property
    def title(self) -> str:
        """Returns what the run has found."""
        num_localized = sum(result["status"] == "LOCALIZED" for result in self.queries)
        return f"{num_localized} of {len(self.queries)} queries localized"

    @property
    def folder(self) -> str:
        """Returns the name of the run's folder and of the folder above it."""
        return "/".join(part for part in self.path.resolve().parts[-2:] if part != "/")

    @functools.cached_property
    def names(self) -> list[str]:
        """Returns the queries' names."""
        return [result["name"] for result in self.queries]

    @functools.cached_property
    def poses(self) -> list[Pose | None]:
        """Returns the queries' poses, also those of low confidence."""
        return [unconfirmed_pose_of(result) for result in self.queries]

    @functools.cached_property
    def position_stddevs(self) -> Array:
        """Returns the queries' standard deviations of position along the least certain axis; NaN if unknown."""
        return np.array([(result.get("position_stddevs") or [np.nan])[0] for result in self.queries], float)

    @functools.cached_property
    def errors(self) -> tuple[Array, Array]:
        """Returns the queries' errors of position, and of rotation in degrees; NaN if unknown."""
        if self.truth:
            truth = [self.truth.get(name) for name in self.names]
            return pose_errors(*stack_poses(self.poses), *stack_poses(truth))
        found = self.leave_one_out["poses"] if self.leave_one_out else []
        listed: dict[str, Mapping[str, object]] = {pose["name"]: pose for pose in found}
        poses = [listed.get(name, {}) for name in self.names]
        return numbers(poses, "position_error"), numbers(poses, "rotation_error_deg")

    @functools.cached_property
    def database_images(self) -> list[Image]:
        """Returns the database images by name."""
        return [image for _, image in sorted(self.database.images.items())]

    @functools.cached_property
    def database_index(self) -> dict[str, int]:
        """Returns the index of each database image by its name."""
        return {image.name: i for i, image in enumerate(self.database_images)}

    @property
    def alignment(self) -> list[str]:
        """Returns where the metres of the mapper's model come from, and what is inaccurate; empty for other models."""
        return _lines(self._input_model / ALIGNMENT)

    @property
    def without_poses(self) -> list[str]:
        """Returns the names of the photos of which the mapper has found no pose; empty for other models."""
        return _lines(self._input_model / WITHOUT_POSES)

    @property
    def is_level(self) -> bool:
        """True if the z axis is known to point up."""
        is_aligned = bool(self.alignment) and not (self._input_model / ARBITRARY_AXES).is_file()
        return is_aligned or _is_geographic(self.path)

    @property
    def _input_model(self) -> pathlib.Path:
        return _input_model(self.options, self.project)

    @property
    def query_list(self) -> pathlib.Path | None:
        """Returns the path of the query list; None if the run had none."""
        path = self.options.values.get("query_list_path")
        if not path:
            return None
        return pathlib.Path(path) if self.project is None else self.project.lists / pathlib.Path(path).name

    @property
    def written(self) -> str:
        """Returns when the run was written, ISO 8601."""
        seconds = (self.path / RESULTS).stat().st_mtime
        return datetime.datetime.fromtimestamp(seconds).astimezone().isoformat(timespec="seconds")


def numbers(items: Iterable[Mapping[str, object]], field: str) -> Array:
    """Returns a field of all items; NaN where it is null or missing."""
    return np.array([np.nan if item.get(field) is None else item[field] for item in items], float)


def used_pairs(result: ResultFields) -> list[bool]:
    """Returns for each pair of a query whether its pose rests on it. If the focal length was unknown, no pair has a
    relative pose, and those that were verified count."""
    used = [pair["rotation_error_deg"] is not None for pair in result["pairs"]]
    if any(used) or unconfirmed_pose_of(result) is None:
        return used
    return [pair["num_inliers"] > 0 for pair in result["pairs"]]


def read_run(path: pathlib.Path, truth: dict[str, Pose] | None = None, unit: str | None = None) -> Run:
    """Reads the output folder of a run; `truth`: the queries' true poses by name; `unit`: of lengths,
    by default metres if the run has geographic coordinates."""
    results = read_results(path / RESULTS, lambda lines: progress(lines, "results"))
    if not results:
        raise InputError(f"{path / RESULTS}: holds no query")
    for result in progress(results.values(), "checks"):
        check_result(str(path / RESULTS), result)
    model = read_model(path / "model")
    _check_model(path, results, model)
    options = read_options(path / "options.ini")
    project = find_run(path).project
    leave_one_out = _read_leave_one_out(path / "leave_one_out.json", results)
    database = _database(model, results, _input_model(options, project), leave_one_out is not None)
    if truth is None:
        truth = {}
        if leave_one_out is not None and database is not model:
            truth = poses_of(database)
    return Run(
        path,
        sorted(results.values(), key=_certainty),
        model,
        database,
        read_points(path / "model"),
        options,
        leave_one_out,
        {name: pose for name, pose in under_names_of(results, truth).items() if name in results},
        unit_of(path, unit),
        read_changes(path),
        read_control_residuals(path),
        _places_before(path, results),
        project,
    )


def _lines(path: pathlib.Path) -> list[str]:
    """Returns the lines of a file; empty if there is none."""
    return path.read_text(encoding="utf-8").splitlines() if path.is_file() else []


def _input_model(options: RunOptions, project: Folder | None) -> pathlib.Path:
    """Returns the folder of the input model: that of a project, because `lazyloc run` may have stored a path relative
    to another folder."""
    return pathlib.Path(options.values.get("input_path", "")) if project is None else project.model


def _places_before(path: pathlib.Path, results: Mapping[str, ResultFields]) -> dict[str, Array]:
    """Returns where each photo of a second epoch was before it was adjusted together with the others."""
    before = path.resolve().parent / LOCALIZED / RESULTS
    if not before.is_file() or before.parent == path.resolve():
        return {}
    adjusted = {name for name, result in results.items() if "epoch" in result and result["epoch"]["is_adjusted"]}
    poses = {name: pose_of(result) for name, result in read_results(before).items()} if adjusted else {}
    return {name: pose.cam_in_world for name, pose in poses.items() if pose is not None and name in adjusted}


def unit_of(path: pathlib.Path, unit: str | None) -> str:
    """Returns the unit of a run's lengths: the given one, or metres if the run has geographic coordinates."""
    return unit or (METRE if _is_geographic(path) else MODEL_UNITS)


def _is_geographic(path: pathlib.Path) -> bool:
    return (path / "positions.geojson").is_file()


def _certainty(result: ResultFields) -> tuple[bool, bool, float, float, str]:
    """Returns the key by which queries are listed: without a pose, with an unconfirmed one, localized; each by
    confidence, then by standard deviation."""
    has_pose = result["cam_from_world"] is not None or result.get("unconfirmed_cam_from_world") is not None
    confidence, stddevs = result.get("confidence"), result.get("position_stddevs")
    return (
        has_pose,
        result["status"] == "LOCALIZED",
        0.0 if confidence is None else confidence,
        -np.inf if stddevs is None else -stddevs[0],
        result["name"],
    )


def _check_model(path: pathlib.Path, results: dict[str, ResultFields], model: Model) -> None:
    """Checks that the model is that of the results: it has exactly their poses."""
    for name, image in model.images.items():
        if not np.isfinite([*image.pose.qvec, *image.pose.tvec]).all():
            raise InputError(f"{path / 'model'}: the pose of '{name}' is not finite")
        if image.camera_id not in model.cameras:
            raise InputError(f"{path / 'model'}: image '{name}' has no camera")
    for name, result in results.items():
        pose, found = pose_of(result), model.images.get(name)
        if pose is None:
            if found is not None:
                raise InputError(
                    f"{path / 'model'}: is not the model of this run: it has query '{name}', which has no pose"
                )
            continue
        if found is None:
            raise InputError(f"{path / 'model'}: is not the model of this run: query '{name}' of {RESULTS} is missing")
        if not _is_same(pose, found.pose):
            raise InputError(f"{path / 'model'}: is not the model of this run: query '{name}' has another pose")


def _is_same(pose: Pose, other: Pose) -> bool:
    """True if all numbers are equal; a quaternion may have the opposite sign, which is the same rotation."""
    is_same_rotation = np.array_equal(pose.qvec, other.qvec) or np.array_equal(pose.qvec, -other.qvec)
    return is_same_rotation and np.array_equal(pose.tvec, other.tvec)


def _read_leave_one_out(path: pathlib.Path, results: dict[str, ResultFields]) -> LeaveOneOutFields | None:
    if not path.exists():
        return None
    try:
        summary: LeaveOneOutFields = json.loads(path.read_text(encoding="utf-8"))
        names = {pose["name"] for pose in summary["poses"]}
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, KeyError, TypeError):
        raise InputError(f"{path}: is damaged or cut off") from None
    if not names <= results.keys():
        raise InputError(f"{path}: is not of this run: {RESULTS} has no query '{min(names - results.keys())}'")
    return summary


def _database(
    model: Model, results: dict[str, ResultFields], input_model: pathlib.Path, is_leave_one_out: bool
) -> Model:
    """Returns the posed images with which queries were compared.

    In a leave-one-out run these are the images of the input model. If that is not there any more, they are those of the
    run's own model, with the poses that were estimated.
    """
    if not is_leave_one_out:
        return Model(model.cameras, {name: image for name, image in model.images.items() if name not in results})
    try:
        database = read_model(input_model)
    except InputError:
        return model
    return database if results.keys() <= database.images.keys() else model
