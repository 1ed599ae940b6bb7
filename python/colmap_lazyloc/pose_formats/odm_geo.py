"""Reads and writes geo.txt of OpenDroneMap: lines `name x y z omega phi kappa`, after one with the reference system."""

import re

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.pose_formats.frames import GEOGRAPHIC, Frame
from colmap_lazyloc.pose_formats.geo import find_crs
from colmap_lazyloc.pose_formats.naming import short_names
from colmap_lazyloc.pose_formats.opensfm import grid_name
from colmap_lazyloc.pose_formats.posed_images import Source
from colmap_lazyloc.pose_formats.raw_poses import RawPose, RawPoses, each
from colmap_lazyloc.pose_formats.signatures import Head
from colmap_lazyloc.pose_formats.text import numbers, words
from colmap_lazyloc.text_files import read_entries

HEADER = re.compile(r"(EPSG:\d+|WGS84 UTM \d+[NS]|\+proj=.*)\s*$")
NUM_COLUMNS = 7  # of a line with rotations; accuracies and others may follow


def is_one(head: Head) -> bool:
    """True for geo.txt with rotations."""
    return has_header(head) and all(len(line.split()) >= NUM_COLUMNS for line in head.body[1:2])


def has_header(head: Head) -> bool:
    """True for geo.txt, with or without rotations: its first line is a reference system."""
    return HEADER.match(head.first_line) is not None


def parse(source: Source) -> RawPoses:
    """Reads a file with rotations, which are relative to east, north and up whatever the system of the positions is."""
    (_, header), *lines = read_entries(source.path)
    if not lines:
        raise InputError(f"{source.path}: has no rows")
    crs = grid_name(header)
    is_in_degrees = bool(find_crs(crs).is_geographic)

    def parse_line(entry: tuple[int, str]) -> RawPose:
        name, *rest = entry[1].split()
        if len(rest) < NUM_COLUMNS - 1:
            raise ValueError("there is no omega, phi, kappa")
        values = numbers(rest[: NUM_COLUMNS - 1], NUM_COLUMNS - 1)
        return RawPose(values[3:], values[:3], name)

    frame = Frame(GEOGRAPHIC) if is_in_degrees else Frame(crs, true_north=True)
    return RawPoses(each(lines, parse_line, lambda entry: f"line {entry[0]}"), frame)


def text(raw: RawPoses) -> str:
    """Returns the file, with longitudes, latitudes and heights above the ellipsoid."""
    names = short_names([pose.name or "" for pose in raw.written])
    rows = [f"{name} {words(pose.vector, pose.rotation)}\n" for name, pose in zip(names, raw.written)]
    return "EPSG:4326\n" + "".join(rows)
