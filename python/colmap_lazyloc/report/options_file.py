"""Reads options.ini, which `colmap lazy_localizer` writes."""

import dataclasses
import pathlib

from colmap_lazyloc.text_files import read_lines

VERSION_PREFIX = "# written by "
CHANGED_PREFIX = "# not defaults: "


@dataclasses.dataclass(frozen=True)
class RunOptions:
    """The options of a run."""

    values: dict[str, str]  # by full name, such as LazyLocalizer.seed
    changed: tuple[str, ...]  # names of those that differ from their defaults
    program: str  # the program's name and version; empty if the run does not record it


def read_options(path: pathlib.Path) -> RunOptions:
    """Reads the options; comments at the head name the program and the options that differ from their defaults."""
    values: dict[str, str] = {}
    changed: tuple[str, ...] = ()
    program, section = "", ""
    for line in read_lines(path):
        if line.startswith(VERSION_PREFIX):
            program = line.removeprefix(VERSION_PREFIX)
        elif line.startswith(CHANGED_PREFIX):
            changed = tuple(line.removeprefix(CHANGED_PREFIX).split())
        elif line.startswith("["):
            section = line.strip("[]") + "."
        elif "=" in line and not line.startswith("#"):
            name, _, value = line.partition("=")
            values[section + name] = value
    return RunOptions(values, changed, program)
