"""Reads control points: surveyed points, and where they are marked in photos."""

import dataclasses
import pathlib
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence

import numpy as np

from colmap_lazyloc.array_types import Floats
from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.pose_formats import odm_geo
from colmap_lazyloc.pose_formats.frames import GEOGRAPHIC, NO_FRAME, Frame
from colmap_lazyloc.pose_formats.geo import GeoOrigin, find_crs
from colmap_lazyloc.pose_formats.naming import Names
from colmap_lazyloc.pose_formats.opensfm import grid_name
from colmap_lazyloc.pose_formats.positions import GEODETIC
from colmap_lazyloc.pose_formats.raw_poses import each_named, errors_named
from colmap_lazyloc.pose_formats.signatures import Head, foreign
from colmap_lazyloc.pose_formats.table import CENTRE, LATITUDE, LONGITUDE, NAME, position_of
from colmap_lazyloc.pose_formats.text import Row, Table, numbers, read_xml, split
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.text_files import read_entries

POINT = ("point", "gcp", "gcpname", "gcplabel", "marker", "controlpoint", "pointid")
PIXEL = (("px", "imx", "pixelx", "u", "x"), ("py", "imy", "pixely", "v", "y"))
MARKS_LAYOUT = "photo point x y"  # of Pix4D, which writes no header
EXPECTED = "a list of OpenDroneMap, Metashape's XML of markers, or tables: `point x y z` and `photo point x y`"
# Columns of the table of markers that Metashape exports, below a line `#CoordinateSystem: ... (EPSG::32632)`.
METASHAPE = (
    ("x/easting", "y/northing", "z/altitude"),
    ("x/east", "y/north", "z/altitude"),
    ("x/longitude", "y/latitude", "z/altitude"),
)
METASHAPE_SYSTEM = re.compile(r"#CoordinateSystem:.*\(EPSG::?(\d+)\)")
ODM_CORNER = 0.5  # OpenDroneMap counts pixels from the centre of the first one, COLMAP from its corner
POINT_STDDEV_M = 0.02  # of control points and their marks
MAX_DISTANCE_M = 1e5  # between a point and the origin of a model


@dataclasses.dataclass(frozen=True)
class Mark:
    """Where a point is seen in a photo, in COLMAP's pixels."""

    photo: str
    point: str
    pixel: tuple[float, float]


@dataclasses.dataclass(frozen=True)
class MarkedPhotos:
    """`images`: by the name of a photo in marks, the image that it means; `missing`: names that mean none; `ambiguous`:
    why the first of these that could mean several does not, empty if there is none."""

    images: dict[str, str]
    missing: list[str]
    ambiguous: str

    @staticmethod
    def among(marks: Iterable[Mark], images: Iterable[str]) -> "MarkedPhotos":
        names = sorted({mark.photo for mark in marks})
        found = Names.among(names, sorted(images))
        return MarkedPhotos(
            {names[index]: image for index, image in found.photos.items()},
            [name for index, name in enumerate(names) if index not in found.photos],
            next(iter(found.ambiguous.values()), ""),
        )


@dataclasses.dataclass
class ControlPoints:
    """Marks, and the coordinates of points by name in `frame`; a mark may be of a point that nobody has surveyed."""

    marks: list[Mark] = dataclasses.field(default_factory=list)
    points: dict[str, Sequence[float]] = dataclasses.field(default_factory=dict)
    frame: Frame = NO_FRAME
    _marked: set[tuple[str, str]] = dataclasses.field(default_factory=set, repr=False)  # photo and point

    def add_point(self, name: str, place: Sequence[float]) -> None:
        """Adds a point; a second one of the same name must be at the same place."""
        _check_finite(place)
        if list(self.points.setdefault(name, place)) != list(place):
            raise ValueError(f"point '{name}' is at another place before")

    def add_mark(self, photo: str, point: str, pixel: Sequence[float]) -> None:
        _check_finite(pixel)
        if (photo, point) in self._marked:
            raise ValueError(f"point '{point}' is marked in '{photo}' before")
        self._marked.add((photo, point))
        self.marks.append(Mark(photo, point, (pixel[0], pixel[1])))

    def in_model(self, origin: GeoOrigin | None) -> dict[str, Floats]:
        """Returns the points in the coordinates of a model, whose origin is on the Earth if it has one."""
        if self.frame.is_geographic and origin is None:
            raise InputError("control points in geographic coordinates need a model with geo.json")
        found, _ = self.in_local_frame(origin)
        far = [name for name, place in found.items() if np.linalg.norm(place) > MAX_DISTANCE_M]
        if origin is not None and far:
            remedy = "" if self.frame.is_geographic else ": name the system of its coordinates (--crs)"
            raise InputError(f"point '{far[0]}' is more than 100 km away from the photos{remedy}")
        return found

    def in_local_frame(self, origin: GeoOrigin | None = None) -> tuple[dict[str, Floats], GeoOrigin | None]:
        """Returns the points in the local frame at an origin, by default in their middle, and the origin; points of no
        known place are returned as they are."""
        poses = [Pose.from_centre(np.eye(3), np.array(place, float)) for place in self.points.values()]
        placed, origin = self.frame.to_local(poses, origin) if poses else ([], origin)
        lost = [name for name, pose in zip(self.points, placed) if pose is None]
        if lost:
            logger.warning("points that are not on the Earth, or 0, 0: %s", ", ".join(lost))
        return {name: pose.cam_in_world for name, pose in zip(self.points, placed) if pose is not None}, origin


def read_control_points(
    paths: Sequence[pathlib.Path], crs: str | None = None, is_only_of_points: bool = True
) -> ControlPoints:
    """Reads the points and marks of one or several files; each error is an InputError that names the file.

    `crs`: the reference system of coordinates in a table, if they are not those of the model. `is_only_of_points`: it
    is an error if the files have their own.
    """
    found = ControlPoints(frame=Frame(crs))
    for path in paths:
        with errors_named(path):
            _read(path, found)
    if is_only_of_points and crs is not None and found.frame.crs != crs:
        raise InputError("--crs has no effect: the files have their own reference system")
    if not found.marks:
        raise InputError(f"{paths[0]}: there are no marks of points in photos: expected are {EXPECTED}")
    return found


def _read(path: pathlib.Path, found: ControlPoints) -> None:
    """Adds what a file has."""
    if not path.is_file():
        raise InputError("is not a file" if path.exists() else "does not exist")
    head = Head(path)
    if head.xml("<marker"):
        _read_metashape(path, found)
    elif odm_geo.has_header(head):
        _read_odm(path, found)
    elif b"\0" in head.data or head.text[:1] in ("<", "{", "["):
        raise InputError(f"{(foreign(head) or 'is unknown').partition(':')[0]}: expected are {EXPECTED}")
    else:
        has_no_header = head.count_numbers(split(head.first_line, head.first_line)[-2:]) > 0 and not head.has("label")
        system = METASHAPE_SYSTEM.search(head.text[:1000])
        if system is not None:
            found.frame = _frame(f"EPSG:{system[1]}")
        _read_table(Table(path, (MARKS_LAYOUT,) if has_no_header else ()), found)


def _read_odm(path: pathlib.Path, found: ControlPoints) -> None:
    """Reads gcp_list.txt of OpenDroneMap: lines `x y z pixel_x pixel_y photo [point]` after one with the system.

    Without names, points are known by their coordinates.
    """
    (_, header), *lines = read_entries(path)
    names: dict[tuple[float, ...], str] = {}

    def parse(line: str) -> None:
        words = line.split()
        x, y, z, px, py = numbers(words[:5], 5)
        if len(words) < 6:
            raise ValueError("there is no photo")
        name = words[6] if len(words) > 6 else names.setdefault((x, y, z), str(len(names) + 1))
        found.add_point(name, (x, y, z))
        found.add_mark(words[5], name, (px + ODM_CORNER, py + ODM_CORNER))

    found.frame = _frame(grid_name(header))
    each_named(path, lines, lambda entry: parse(entry[1]), lambda entry: f"line {entry[0]}")


def _read_metashape(path: pathlib.Path, found: ControlPoints) -> None:
    """Reads the XML file of markers that Metashape exports; marks that it has only projected are not pinned."""
    root = read_xml(path)
    chunk = root.find("chunk") if root.tag != "chunk" else root
    if chunk is None:
        raise InputError("has no chunk")
    photos = {camera.get("id"): camera.get("label", "") for camera in chunk.iter("camera")}
    labels: dict[str | None, str] = {}
    for marker in chunk.findall("markers/marker"):
        labels[marker.get("id")] = marker.get("label", "")
        place = marker.find("reference")
        if place is not None and {"x", "y", "z"} <= set(place.keys()):
            found.add_point(marker.get("label", ""), numbers([place.get(axis) for axis in "xyz"], 3))
    system = (chunk.findtext("reference") or "").strip()
    if system and not system.startswith("LOCAL_CS"):
        found.frame = _frame(system)

    def parse(item: tuple[str, ET.Element]) -> None:
        name, location = item
        found.add_mark(photos[location.get("camera_id")], name, numbers([location.get(axis) for axis in "xy"], 2))

    items = [
        (labels.get(marker.get("marker_id"), ""), location)
        for marker in chunk.findall("frames/frame/markers/marker")
        for location in marker.findall("location")
        if location.get("pinned", "true") in ("true", "1")
    ]
    each_named(path, items, parse, lambda item: f"a mark of '{item[0]}'")


def _read_table(table: Table, found: ControlPoints) -> None:
    """Reads a table of points, or one of marks, which has a column for the photo."""
    is_of_marks = table.has(NAME, POINT, *PIXEL) and not table.has("z")
    point = POINT if table.has(POINT) else NAME
    is_geodetic = table.has(LATITUDE, LONGITUDE)
    of_metashape = next((columns for columns in METASHAPE if table.has(*columns)), CENTRE)
    vector = GEODETIC if is_geodetic else of_metashape
    if not is_of_marks:
        table.require(EXPECTED, point, *vector)
        found.frame = Frame(GEOGRAPHIC) if is_geodetic else found.frame

    def parse(row: Row) -> None:
        if is_of_marks:
            found.add_mark(row.text(NAME), row.text(POINT), row.numbers(*PIXEL))
        else:
            found.add_point(row.text(point), position_of(row, vector))

    each_named(table.path, table.rows(), parse, lambda row: row.label)
    table.report_unused()


def _check_finite(values: Sequence[float]) -> None:
    if not np.all(np.isfinite(values)):
        raise ValueError("a number is not finite")


def _frame(crs: str) -> Frame:
    find_crs(crs)
    return Frame(crs)
