#!/usr/bin/env python3
"""Writes the table of formats in docs/own_data.md from the registry of formats.

scripts/python.sh scripts/make_format_table.py
"""

import pathlib

from colmap_lazyloc.pose_formats.conventions import ROTATIONS
from colmap_lazyloc.pose_formats.registry import FORMATS

PROJECT_PATH = pathlib.Path(__file__).resolve().parents[1]
PAGE_PATH = PROJECT_PATH / "docs" / "own_data.md"
BEGIN = "<!-- Made by scripts/python.sh scripts/make_format_table.py; do not edit. -->\n\n"
END = "<!-- End of the table. -->\n"
COLUMNS = ("format", "files", "poses", "axes", "rotation", "coordinates", "intrinsics", "photos by", "export")


def make_table() -> str:
    """Returns the table as Markdown."""
    lines = [f"| {' | '.join(COLUMNS)} |", "|---" * len(COLUMNS) + "|"]
    for name, form in FORMATS.items():
        convention = form.convention
        rotation = convention.rotation
        if rotation == "quaternion":
            rotation += f" {convention.quaternion}"
        elif rotation in ROTATIONS:
            rotation += " in radians" if rotation == "rotation vector" else " in degrees"
        is_mixed = convention.vector == "centre" and convention.direction == "cam_from_world"
        poses = convention.direction + (", with the centre" if is_mixed else "")
        cells = (
            f"`{name}`",
            form.title,
            poses,
            convention.camera_axes,
            rotation,
            form.world,
            form.cameras,
            form.photos,
            "" if form.writer is None else f"without {form.writer.omits}" if form.writer.omits else "yes",
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def make_page() -> str:
    """Returns the page with a new table."""
    head, _, rest = PAGE_PATH.read_text(encoding="utf-8").partition(BEGIN)
    return head + BEGIN + make_table() + "\n" + END + rest.partition(END)[2]


if __name__ == "__main__":
    PAGE_PATH.write_text(make_page(), encoding="utf-8")
