"""Reads where photos were taken, without rotations: from a table, from geo.txt of OpenDroneMap, or from EXIF.

Such positions are no poses. They place the model that COLMAP's mapper makes of the photos.
"""

import dataclasses
import pathlib
from collections.abc import Sequence

import numpy as np

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.pose_formats import exif_gps, odm_geo, table
from colmap_lazyloc.pose_formats.assembly import assemble_positions
from colmap_lazyloc.pose_formats.frames import GEOGRAPHIC, Frame
from colmap_lazyloc.pose_formats.geo import find_crs
from colmap_lazyloc.pose_formats.naming import Names
from colmap_lazyloc.pose_formats.opensfm import grid_name
from colmap_lazyloc.pose_formats.posed_images import Positions, Source
from colmap_lazyloc.pose_formats.raw_poses import RawPose, RawPoses, each, errors_named
from colmap_lazyloc.pose_formats.signatures import Head
from colmap_lazyloc.pose_formats.text import Row, Table, is_header_of_poses, numbers, simple_name
from colmap_lazyloc.text_files import read_entries

EXIF, POSITIONS = "exif", "positions"
FORMATS = (EXIF, POSITIONS)
ACCURACY = ("accuracy", "accuracy_m", "stddev", "stddev_m")
GEODETIC = (table.LONGITUDE, table.LATITUDE, (*table.HEIGHT, "height"))
ROTATIONS = (*table.QUATERNION, *table.YAW, *table.ANGLES)  # a table with one of these columns has poses
EXPECTED = "name; latitude, longitude, altitude, or x, y, z; and accuracy (metres), if it is known"
NO_POSES = (
    "has positions without rotations, which are not poses: `lazyloc run --poses` reconstructs the photos and aligns "
    "the model to these positions"
)


def is_one(head: Head) -> bool:
    """True for a table of positions, for geo.txt without rotations, and for lines `name x y z`, as COLMAP's
    model_aligner takes them."""
    if head.is_folder:
        return False
    if odm_geo.has_header(head):
        return not odm_geo.is_one(head)
    if _has_no_header(head):
        return True
    has_centre = any(_has(head, *axes) for axes in (GEODETIC, table.CENTRE))
    is_of_poses = _has(head, ROTATIONS) or is_header_of_poses(",".join(sorted(head.names)))
    return _has(head, table.NAME) and has_centre and not is_of_poses


def _has(head: Head, *names: Sequence[str]) -> bool:
    """True if a table has a column for each of these, which may have one of several names."""
    return head.has(*("|".join(map(simple_name, several)) for several in names))


def _has_no_header(head: Head) -> bool:
    """True for a first line with a name and three numbers, separated by blanks, and no names of columns above it."""
    words = head.first_line.split()
    return (
        not _has(head, table.NAME)
        and len(words) == 4
        and head.count_numbers(words[1:]) == 3
        and head.count_numbers(words[:1]) == 0
    )


def find_format(path: pathlib.Path) -> str | None:
    """Returns the format of a file of positions by its content; None for any other file, and for a folder."""
    try:
        return POSITIONS if is_one(Head(path)) else None
    except OSError:
        return None  # the reader of poses reports it


def read_positions(source: Source, format_name: str | None) -> Positions:
    """Reads the positions of the photos of a source; each error is an InputError that names the file or folder."""
    if format_name == EXIF:
        return _read_exif(source)
    with errors_named(source.path):
        raw = _parse(source)
        if raw.frame.is_geographic:
            source = dataclasses.replace(source, crs=None)  # it is that of the report
        return assemble_positions(raw, source)


def _parse(source: Source) -> RawPoses:
    head = Head(source.path)
    if odm_geo.has_header(head):
        return _parse_odm(source)
    if _has_no_header(head):
        if source.crs is not None and find_crs(source.crs).is_geographic:
            raise InputError("its degrees need a first line `name latitude longitude altitude`, instead of --crs")
        lines = read_entries(source.path)
        return RawPoses(each(lines, lambda line: _listed(line[1]), lambda line: f"line {line[0]}"))
    rows = Table(source.path)
    is_geodetic = rows.has(table.LATITUDE, table.LONGITUDE)
    vector = GEODETIC if is_geodetic else table.CENTRE
    rows.require(EXPECTED, table.NAME, *vector)

    def parse_row(row: Row) -> RawPose:
        accuracy = row.number(ACCURACY) if row.has(ACCURACY) else 0.0
        is_known = 0 < accuracy < exif_gps.MAX_STDDEV_M  # receivers write 0, -1 or 999999 if it is not
        return _position(row.text(table.NAME), table.position_of(row, vector), accuracy if is_known else None)

    poses = each(rows.rows(), parse_row, lambda row: row.label)
    rows.report_unused()
    return RawPoses(poses, Frame(GEOGRAPHIC) if is_geodetic else Frame())


def _parse_odm(source: Source) -> RawPoses:
    (_, header), *lines = read_entries(source.path)
    poses = each(lines, lambda line: _listed(line[1]), lambda line: f"line {line[0]}")
    return RawPoses(poses, Frame(grid_name(header)))


def _listed(line: str) -> RawPose:
    """Parses `name x y z`, which more words may follow."""
    name, *rest = line.split()
    return _position(name, numbers(rest[:3], 3), None)


def _position(name: str, centre: list[float], accuracy_m: float | None) -> RawPose:
    return RawPose(np.eye(3), centre, name, accuracy_m=accuracy_m)


def _read_exif(source: Source) -> Positions:
    """Reads the GPS of the photos in a folder, which may be the originals of the photos of the source."""
    if not source.path.is_dir():
        raise InputError(f"{source.path}: is not a folder of photos, in which the format exif reads GPS")
    found = exif_gps.read_positions(source.path)
    if not found:
        raise InputError(f"{source.path}: has no photo with GPS")
    names = Names.match([photo.name for photo in found], source.photos).photos
    return exif_gps.in_local_frame(
        [dataclasses.replace(found[index], name=name) for index, name in sorted(names.items())], source.origin
    )
