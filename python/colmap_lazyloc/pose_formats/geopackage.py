"""Writes a GeoPackage of OGC, version 1.3: an SQLite file with a layer of positions and a layer of fields of view.

Coordinates are longitude and latitude; positions also have their height above the ellipsoid.
"""

import contextlib
import pathlib
import sqlite3
import struct
from collections.abc import Sequence

from colmap_lazyloc.pose_formats.point_values import NAMES, values_of
from colmap_lazyloc.pose_formats.raw_poses import RawPose, RawPoses

APPLICATION_ID, VERSION = 0x47504B47, 10300
SYSTEM = 4326  # EPSG code of longitude and latitude of WGS 84
WKT = (  # of SYSTEM, as the standard requires
    'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],'
    'AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],UNIT["degree",0.0174532925199433,'
    'AUTHORITY["EPSG","9122"]],AUTHORITY["EPSG","4326"]]'
)
TABLES = """-- The time is required; it is a constant, so that the same poses give the same file.
CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER PRIMARY KEY, organization TEXT NOT NULL,
  organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (table_name TEXT PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE,
  description TEXT DEFAULT '', last_change DATETIME NOT NULL DEFAULT '1970-01-01T00:00:00.000Z',
  min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL UNIQUE REFERENCES gpkg_contents(table_name),
  column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL,
  srs_id INTEGER NOT NULL REFERENCES gpkg_spatial_ref_sys(srs_id), z TINYINT NOT NULL, m TINYINT NOT NULL,
  PRIMARY KEY (table_name, column_name));
"""
POINT_Z, POLYGON = 1001, 3  # types of geometries in well-known binary (ISO 19125)

Points = Sequence[Sequence[float]]


def write(path: pathlib.Path, raw: RawPoses) -> None:
    """Writes the file; a photo whose field of view is not known has none."""
    with contextlib.closing(sqlite3.connect(path)) as database, database:
        database.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        database.execute(f"PRAGMA user_version = {VERSION}")
        database.executescript(TABLES)
        database.executemany(
            "INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, NULL)",
            [
                ("Undefined Cartesian", -1, "NONE", -1, "undefined"),
                ("Undefined geographic", 0, "NONE", 0, "undefined"),
                ("WGS 84", SYSTEM, "EPSG", SYSTEM, WKT),
            ],
        )
        _add_layer(database, "positions", "POINT", [(pose, [pose.vector]) for pose in raw.written])
        outlines = [(pose, pose.field_of_view) for pose in raw.written if pose.field_of_view]
        _add_layer(database, "fields_of_view", "POLYGON", outlines)


def _add_layer(database: sqlite3.Connection, name: str, kind: str, rows: Sequence[tuple[RawPose, Points]]) -> None:
    """Adds a table with the values of each photo and a geometry: a point with its height, or a polygon without."""
    columns = "".join(f", {column} {'TEXT' if column == 'status' else 'REAL'}" for column in NAMES)
    database.execute(f"CREATE TABLE {name} (fid INTEGER PRIMARY KEY AUTOINCREMENT, geom {kind}, name TEXT{columns})")
    places = [(float(point[0]), float(point[1])) for _, points in rows for point in points]
    bounds = [function(axis) for function in (min, max) for axis in zip(*places)] or [None] * 4
    database.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, min_x, min_y, max_x, max_y, srs_id) "
        "VALUES (?, 'features', ?, ?, ?, ?, ?, ?)",
        (name, name, *bounds, SYSTEM),
    )
    has_heights = kind == "POINT"
    database.execute(
        "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, ?, ?, 0)", (name, kind, SYSTEM, has_heights)
    )
    database.executemany(
        f"INSERT INTO {name} (geom, name, {', '.join(NAMES)}) VALUES (?, ?{', ?' * len(NAMES)})",
        [(_geometry(kind, points), pose.name, *values_of(pose).values()) for pose, points in rows],
    )


def _geometry(kind: str, points: Points) -> bytes:
    """Returns a geometry as the standard has it: a header, and well-known binary; both little-endian."""
    numbers = [float(number) for point in points for number in point]
    head = struct.pack("<2sBBi", b"GP", 0, 1, SYSTEM)
    counts = () if kind == "POINT" else (1, len(points))  # of rings, and of the points of the only one
    body = struct.pack(
        f"<BI{len(counts)}I{len(numbers)}d", 1, POINT_Z if kind == "POINT" else POLYGON, *counts, *numbers
    )
    return head + body
