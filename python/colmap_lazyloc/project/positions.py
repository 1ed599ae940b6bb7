"""Writes where each query is: the table with which `lazyloc run` ends, and the columns of --crs in positions.csv."""

import csv
import io
import pathlib
from collections.abc import Mapping, Sequence

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.pose_formats.geo import GeoOrigin, find_crs, from_geodetic
from colmap_lazyloc.report.coordinates import (
    DEGREE_DIGITS,
    METRE_DIGITS,
    System,
    in_reference_system,
    length_digits,
)
from colmap_lazyloc.report.facts import METRE
from colmap_lazyloc.report.output import write_file
from colmap_lazyloc.result_fields import ResultFields
from colmap_lazyloc.results import MODEL, POSITIONS, RESULTS, pose_of, read_geodetic, read_results

ADDED = ("E", "N", "H", "X", "Y", "Z")  # columns of a reference system

Rows = list[list[str]]


def write_reference_system(folder: pathlib.Path, crs: str | None) -> None:
    """Adds positions in a projected or geocentric system, with their standard deviations, to positions.csv in a folder
    of results, in place of those of an earlier run."""
    places = read_geodetic(folder)
    system = _in_system(crs, places)
    path = folder / POSITIONS
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    num_columns = next((i for i, name in enumerate(header) if name in ADDED), len(header))
    if system is None and num_columns == len(header):
        return
    added: dict[str, list[object]] = {}
    if system is not None:
        header[num_columns:] = [*system.axes, *(f"stddev_{axis}" for axis in system.axes)]
        values = np.hstack([system.xyz, _stddevs(folder, system.name, list(places))])
        added = {name: [x if np.isfinite(x) else "" for x in row] for name, row in zip(places, values.tolist())}
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(header if added else header[:num_columns])
    missing = [""] * (len(header) - num_columns)
    table.writerows([*row[:num_columns], *(added.get(row[0], missing) if added else [])] for row in rows)
    write_file(path, [text.getvalue().encode()])


def _in_system(crs: str | None, places: Mapping[str, Sequence[float]]) -> System | None:
    """Returns latitudes, longitudes and heights in a projected or geocentric system, if there are any and it is one."""
    return in_reference_system(crs, np.array([*places.values()])) if crs is not None and places else None


def _stddevs(folder: pathlib.Path, crs: str, names: Sequence[str]) -> Array:
    """Returns the standard deviations of localized queries in a reference system, n x 3; NaN if unknown."""
    results, origin = read_results(folder / RESULTS), GeoOrigin.read(folder / MODEL)
    assert origin is not None
    poses = [pose_of(results[name]) for name in names]
    centres = np.array([pose.cam_in_world for pose in poses if pose is not None])
    unknown = np.full((3, 3), np.nan)
    covariances = np.array([results[name]["position_covariance"] or unknown for name in names])
    steps = np.concatenate([np.eye(3), -np.eye(3)])  # of a metre along the axes of the model, for the derivatives
    around = (centres[:, None] + steps).reshape(-1, 3)
    ends = from_geodetic(find_crs(crs), origin.to_geodetic(around)).reshape(-1, 6, 3)
    derivatives = (ends[:, :3] - ends[:, 3:]) / 2  # n x axis of the model x axis of the system
    variances: Array = np.einsum("nai,nab,nbi->ni", derivatives, covariances, derivatives)
    return np.sqrt(variances)


def position_lines(
    results: Mapping[str, ResultFields],
    names: Mapping[str, str],
    places: Mapping[str, Sequence[float]],
    unit: str,
    crs: str | None = None,
) -> list[str]:
    """Returns a header and a line for each query, in the order of `names`: what each is called, by its name.

    `places`: latitude, longitude and height by name, as far as they are known; `crs`: a reference system in which they
    are written, too. The standard deviation is that along the least certain direction.
    """
    stddevs = {name: stddevs[0] for name in names if (stddevs := results[name]["position_stddevs"])}
    digits = length_digits(unit, stddevs.values())
    suffix = f" ({METRE})" if unit == METRE else ""
    header = ["query", *(f"{axis}{suffix}" for axis in "xyz"), f"std. dev.{suffix}"]
    if places:
        header += ["latitude", "longitude", f"height ({METRE})"]
    system = _in_system(crs, places)
    projected = {} if system is None else {name: xyz for name, xyz in zip(places, system.xyz) if np.isfinite(xyz).all()}
    if system is not None:
        header += [f"{axis} ({of_axis})" for axis, of_axis in zip(system.axes, system.units)]
    rows: Rows = []
    for name, text in names.items():
        pose = pose_of(results[name])
        if pose is None:
            rows.append([text, f"{results[name]['status']}: {results[name]['reason']}"])
            continue
        row = [text, *(f"{value:.{digits}f}" for value in pose.cam_in_world)]
        row.append(f"{stddevs[name]:.{digits}f}" if name in stddevs else "")
        if name in places:
            latitude, longitude, height = places[name]
            row += [f"{latitude:.{DEGREE_DIGITS}f}", f"{longitude:.{DEGREE_DIGITS}f}", f"{height:.{METRE_DIGITS}f}"]
            row += [f"{value:.{METRE_DIGITS}f}" for value in projected.get(name, ())]
        rows.append(row)
    return _aligned([header, *rows])


def _aligned(rows: Rows) -> list[str]:
    """Returns the rows as lines: names to the left, numbers to the right; a reason may be as long as it is."""
    num_columns = len(rows[0])
    is_full = [len(row) > 2 for row in rows]  # without a reason
    widths = [
        max(len(row[i]) for row, full in zip(rows, is_full, strict=True) if i < len(row) and (full or i == 0))
        for i in range(num_columns)
    ]
    return [
        "  ".join([row[0].ljust(widths[0]), *(text.rjust(width) for text, width in zip(row[1:], widths[1:]))]).rstrip()
        for row in rows
    ]
