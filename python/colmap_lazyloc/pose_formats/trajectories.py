"""Reads trajectories without names of photos: of TUM, KITTI, and tables of ARKit and ARCore.

They say where a body was, world_from_body. The body is the camera itself, with COLMAP's axes (TUM, KITTI) or OpenGL's
(ARKit, ARCore), unless a calibration gives the camera's pose on the body.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.pose_formats.calibration import IDENTITY, read_calibration
from colmap_lazyloc.pose_formats.posed_images import (
    OPENGL_FROM_COLMAP,
    PosedImage,
    PosedImages,
    Source,
    nearest_rotation,
    quaternion_rotation,
)
from colmap_lazyloc.pose_formats.table import NAME, camera_of_entry
from colmap_lazyloc.pose_formats.text import Entry, Table
from colmap_lazyloc.pose_formats.times import interpolate, photo_times
from colmap_lazyloc.poses import Pose

Array = NDArray[np.float64]
TIME = ("timestamp", "time", "t")


@dataclasses.dataclass(frozen=True, eq=False)
class Row:
    """A row of a trajectory: world_from_body, and its time or its photo if the row says so."""

    rotation: Array
    centre: Array
    time: float | None = None
    name: str | None = None
    entry: Entry | None = None


def read_tum(source: Source) -> PosedImages:
    """Reads `timestamp tx ty tz qx qy qz qw`."""

    def parse(v: list[float]) -> Row:
        return Row(quaternion_rotation(v[7], *v[4:7]), np.array(v[1:4]), v[0])

    return _posed(source, _numeric_rows(source, {8: parse}), is_opengl=False)


def read_kitti(source: Source) -> PosedImages:
    """Reads a 3 x 4 matrix per row; the rows belong to the photos in the order of their names."""
    rows = _numeric_rows(source, {12: lambda v: _matrix_row(v, None)})
    names = source.photos.names
    if not names:
        raise InputError("--image_path is needed, because the file names no photos")
    if len(names) != len(rows):
        raise InputError(f"{source.path}: has {len(rows)} poses, but {source.photos.folder} has {len(names)} photos")
    return _posed(source, [dataclasses.replace(row, name=name) for row, name in zip(rows, names)], is_opengl=False)


def read_arkit(source: Source) -> PosedImages:
    """Reads a table with names of columns, or `timestamp tx ty tz qw qx qy qz`, or a timestamp and a 3 x 4 matrix."""

    def parse(v: list[float]) -> Row:
        return Row(quaternion_rotation(*v[4:8]), np.array(v[1:4]), v[0])

    return _read_phone(source, {8: parse, 13: lambda v: _matrix_row(v[1:], v[0])})


def read_arcore(source: Source) -> PosedImages:
    """Reads a table with names of columns, or `timestamp qx qy qz qw tx ty tz`."""

    def parse(v: list[float]) -> Row:
        return Row(quaternion_rotation(v[4], *v[1:4]), np.array(v[5:8]), v[0])

    return _read_phone(source, {8: parse})


def _read_phone(source: Source, parsers: dict[int, Callable[[list[float]], Row]]) -> PosedImages:
    table = Table(source.path)
    rows = [_named_row(entry, source) for entry in table.entries()] if table.columns else _numeric_rows(source, parsers)
    return _posed(source, [row for row in rows if row is not None], is_opengl=True)


def _named_row(entry: Entry, source: Source) -> Row | None:
    """Returns a row of a table with names of columns; None if its photo is not there."""
    time = entry.number(*TIME) if entry.has(TIME) else None
    name = source.find_photo(entry.text(*NAME)) if entry.has(NAME) else None
    if entry.has(NAME) and name is None:
        return None
    if entry.has("t_00"):  # Polycam
        values = [entry.number(f"t_{row}{column}") for row in range(3) for column in range(4)]
        return dataclasses.replace(_matrix_row(values, time), name=name, entry=entry)
    if entry.has("m00"):
        values = [entry.number(f"m{row}{column}") for row in range(3) for column in range(4)]
        return dataclasses.replace(_matrix_row(values, time), name=name, entry=entry)
    centre = np.array([entry.number("tx", "x", "px"), entry.number("ty", "y", "py"), entry.number("tz", "z", "pz")])
    return Row(quaternion_rotation(*entry.numbers("qw qx qy qz")), centre, time, name, entry)


def _matrix_row(values: list[float], time: float | None) -> Row:
    matrix = np.reshape(values, (3, 4))
    return Row(nearest_rotation(matrix[:, :3]), matrix[:, 3], time)


def _numeric_rows(source: Source, parsers: dict[int, Callable[[list[float]], Row]]) -> list[Row]:
    rows = Table(source.path).rows
    count = len(rows[0])
    if count not in parsers:
        raise InputError(f"{source.path}: has {count} columns instead of {' or '.join(map(str, parsers))}")
    return [parsers[count]([float(word) for word in row]) for row in rows]


def _check_one_camera(source: Source, times: dict[str, float]) -> None:
    """Refuses photos of two cameras at the same time, because all photos get the poses of one."""
    names: dict[float, str] = {}
    for name, time in times.items():
        if names.setdefault(time, name) != name:
            raise InputError(
                f"--image_path {source.photos.folder}: {names[time]} and {name} have the same time, but the trajectory "
                "is that of one camera: give the folder of its photos, or the rig (lazyloc import --rig_config_path)"
            )


def _posed(source: Source, rows: list[Row], is_opengl: bool) -> PosedImages:
    """Returns the images of the rows, each with the row of its name, or with a pose at its time."""
    if not rows:
        return PosedImages([])
    if all(row.name is not None for row in rows):
        bodies = {str(row.name): (row.rotation, row.centre) for row in rows}
    else:
        centres, rotations = np.array([row.centre for row in rows]), np.array([row.rotation for row in rows])
        if any(row.time is None for row in rows):
            raise InputError(f"{source.path}: has neither names of photos nor times")
        names = photo_times(source)
        bodies = interpolate(names, [row.time or 0.0 for row in rows], centres, rotations) if names else {}
        _check_one_camera(source, {name: names[name] for name in bodies})
    if not bodies:
        return PosedImages([])
    camera, cam_from_body = read_calibration(source, next(iter(bodies)))
    if cam_from_body is None:
        cam_from_body = Pose.from_matrix(OPENGL_FROM_COLMAP, np.zeros(3)) if is_opengl else IDENTITY
    entries = {row.name: row.entry for row in rows if row.name is not None and row.entry is not None}
    images = []
    for name, (rotation, centre) in bodies.items():
        own = camera or (camera_of_entry(entries[name]) if name in entries else None)
        if own is None:
            raise InputError(f"{source.path}: has no intrinsics: give them as --camera or --calibration")
        images.append(PosedImage(name, own, cam_from_body @ Pose.from_centre(rotation.T, centre)))
    return PosedImages(images)
