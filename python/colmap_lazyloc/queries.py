"""Reads lists of queries: one `name`, or `name MODEL width height params...` as in hloc, per line."""

import re

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.text_files import Path, read_entries

_WITH_CAMERA = re.compile(r"(\S+)\s+([A-Z][A-Z0-9_]+\s+\d+\s+\d+(\s+[-+.0-9eE]+)+)")


def read_queries(path: Path) -> dict[str, Camera | None]:
    """Reads the queries' cameras by name; None for a line that holds only a name, which may have blanks."""
    queries: dict[str, Camera | None] = {}
    for line_number, line in read_entries(path):
        name, camera = _name_and_camera(line)
        if name in queries:
            raise InputError(f"{path}:{line_number}: query '{name}' is listed twice")
        queries[name] = Camera.parse(f"{path}:{line_number}", camera) if camera else None
    if not queries:
        raise InputError(f"{path}: lists no query")
    return queries


def read_query_lines(path: Path) -> dict[str, str]:
    """Reads the queries' lines by name, in the order of the file."""
    return {_name_and_camera(line)[0]: line for _, line in read_entries(path)}


def read_query_cameras(path: Path) -> dict[str, Camera]:
    """Reads the queries' cameras by name; every line must have one."""
    cameras = {}
    for name, camera in read_queries(path).items():
        if camera is None:
            raise InputError(f"{path}: expected `name MODEL width height params...`, found '{name}'")
        cameras[name] = camera
    return cameras


def _name_and_camera(line: str) -> tuple[str, str | None]:
    """Returns the name of a line, and the text of its camera if it has one."""
    match = _WITH_CAMERA.fullmatch(line)
    return (match.group(1), match.group(2)) if match else (line, None)
