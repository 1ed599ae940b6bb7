"""Reads results.jsonl, which `colmap lazy_localizer` writes."""

import csv
import dataclasses
import json
import pathlib
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any, NoReturn, TextIO, TypeVar

import numpy as np

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.project.folder import EPOCH, LOCALIZED, QUERY, RECORD, Folder
from colmap_lazyloc.result_fields import PoseFields, ResultFields
from colmap_lazyloc.text_files import Path, open_text

# In the output folder of a run.
RESULTS, MODEL, POSITIONS = "results.jsonl", "model", "positions.csv"
CHANGES, CONTROL_POINTS = "changes.json", "control_points.json"
REQUIRED_FIELDS = ("name", "status", "cam_from_world")


Change = dict[str, Any]  # an entry of changes.json
ControlResidual = dict[str, Any]  # an entry of control_points.json
Item = TypeVar("Item")


@dataclasses.dataclass(frozen=True)
class FoundRun:
    """The folders of a run."""

    results: pathlib.Path | None  # with results.jsonl, poses.txt, positions.csv, model/; None before the run has ended
    project: Folder | None  # of `lazyloc run`


def find_run(path: Path) -> FoundRun:
    """Returns what there is in the output folder of `colmap lazy_localizer` or of `lazyloc run`, which has its newest
    results, or in a folder of earlier results in it."""
    path = pathlib.Path(path)
    results = next((folder for folder in (path, path / EPOCH, path / LOCALIZED) if (folder / RESULTS).is_file()), None)
    around = [] if results is None else results.resolve().parents
    project = next((Folder(folder) for folder in (path, *around[:1], *around[2:3]) if (folder / RECORD).exists()), None)
    return FoundRun(results, project)


def find_results(path: Path) -> pathlib.Path:
    """Returns the folder of the results of `find_run`, or the path itself, which then cannot be read."""
    run = find_run(path)
    if run.results is None and run.project is not None:
        raise InputError(f"{path}: the last run has no results yet: give its command again")
    return run.results or pathlib.Path(path)


def read_results(path: Path, watch: Callable[[TextIO], Iterable[str]] = iter) -> dict[str, ResultFields]:
    """Returns {query name: result} for a file results.jsonl, in the order of the file. To show progress, pass `watch`:
    a function that gets the open file, and must yield the lines of the file."""
    results: dict[str, ResultFields] = {}
    with open_text(path) as file:
        for line_number, line in enumerate(watch(file), start=1):
            if line.isspace():
                continue
            result = _parse_result(f"{path}:{line_number}", line)
            if result["name"] in results:
                raise InputError(f"{path}: query '{result['name']}' has two results")
            results[result["name"]] = result
    return results


def under_names_of(names: Collection[str], items: Mapping[str, Item]) -> dict[str, Item]:
    """Returns items of queries under the names of a run: `lazyloc run` puts `query/` in front of the photos' names."""
    folder = f"{QUERY}/"
    is_of_run = len(names) > 0 and all(name.startswith(folder) for name in names)
    is_of_photos = not any(name.startswith(folder) for name in items)
    return {f"{folder}{name}": item for name, item in items.items()} if is_of_run and is_of_photos else dict(items)


def read_changes(folder: Path) -> list[Change]:
    """Reads what `lazyloc changes` has found; empty if it was not run, or if the results are newer."""
    return _read_findings(pathlib.Path(folder), CHANGES, {"kind", "centre", "bounds", "num_points", "new_photos"})


def read_control_residuals(folder: Path) -> list[ControlResidual]:
    """Reads what `lazyloc control_points` has found; empty if it was not run, or if the results are newer."""
    return _read_findings(pathlib.Path(folder), CONTROL_POINTS, {"point", "photos", "surveyed", "error"})


def _read_findings(folder: pathlib.Path, name: str, fields: set[str]) -> list[dict[str, Any]]:
    """Reads a list that a command has written beside the results, each entry with these fields; empty if there is
    none, or if the results are newer."""
    path, results = folder / name, folder / RESULTS
    if not path.is_file() or path.stat().st_mtime < results.stat().st_mtime:
        return []
    try:
        entries: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
        if not all(fields <= entry.keys() for entry in entries):
            raise ValueError
        return entries
    except (ValueError, AttributeError, TypeError):
        raise InputError(f"{path}: is damaged or cut off") from None


def read_geodetic(folder: Path) -> dict[str, list[float]]:
    """Reads latitude, longitude (degrees) and height (metres, above WGS 84) of the localized queries by name from
    positions.csv in the output folder of a run; empty if the run has no geographic coordinates."""
    path = pathlib.Path(folder) / POSITIONS
    if not path.is_file():
        return {}
    names = ("latitude_deg", "longitude_deg", "height_m")
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = [row for row in csv.DictReader(file) if row.get(names[0])]
        return {row["name"]: [float(row[name]) for name in names] for row in rows}
    except (ValueError, KeyError, TypeError, csv.Error):
        raise InputError(f"{path}: is damaged or cut off") from None


def read_fields_of_view(folder: Path) -> dict[str, list[list[float]]]:
    """Reads what the localized queries show, by name, from positions.geojson in the output folder of a run, as closed
    rings of longitude and latitude; empty if the run has no geographic coordinates."""
    path = pathlib.Path(folder) / "positions.geojson"
    if not path.is_file():
        return {}
    try:
        features = json.loads(path.read_text(encoding="utf-8"))["features"]
        views = [feature for feature in features if feature["properties"]["shows"] == "field_of_view"]
        return {view["properties"]["name"]: view["geometry"]["coordinates"][0] for view in views}
    except (ValueError, LookupError, TypeError):
        raise InputError(f"{path}: is damaged or cut off") from None


def pose_of(result: ResultFields) -> Pose | None:
    """Returns the pose of a localized query; None for all other queries, even if they have a rotation or an unconfirmed
    pose."""
    return to_pose(result["cam_from_world"]) if result["status"] == "LOCALIZED" else None


def unconfirmed_pose_of(result: ResultFields) -> Pose | None:
    """Returns the pose of a localized query, or the unconfirmed pose of a LOW_CONFIDENCE query; None for all other
    queries."""
    return pose_of(result) or to_pose(result.get("unconfirmed_cam_from_world"))


def to_pose(pose: PoseFields | None) -> Pose | None:
    """Returns the pose of a result's field."""
    return None if pose is None else Pose(np.array(pose["qvec"], float), np.array(pose["tvec"], float))


def _parse_result(place: str, line: str) -> ResultFields:
    """Parses a line; errors name `place`."""
    try:
        result: ResultFields = json.loads(line, parse_constant=_refuse)
    except ValueError:
        raise InputError(f"{place}: is not a line of {RESULTS}: it is damaged or cut off") from None
    if not isinstance(result, dict):
        raise InputError(f"{place}: is not a line of {RESULTS}")
    missing = [field for field in REQUIRED_FIELDS if field not in result]
    if missing:
        raise InputError(f"{place}: the result has no '{missing[0]}'")
    return result


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is not a number of JSON")
