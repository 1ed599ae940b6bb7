"""Reads text files with one entry per line."""

import os
import pathlib
from typing import TextIO

from colmap_lazyloc.errors import InputError

Path = str | os.PathLike[str]


def open_text(path: Path) -> TextIO:
    """Opens a file for reading line by line; bytes that are not UTF-8 are escaped."""
    try:
        return pathlib.Path(path).open(encoding="utf-8", errors="backslashreplace", newline="\n")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None


def read_lines(path: Path) -> list[str]:
    """Reads all lines; bytes that are not UTF-8 are escaped."""
    try:
        return pathlib.Path(path).read_text(encoding="utf-8", errors="backslashreplace").split("\n")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None


def read_entries(path: Path) -> list[tuple[int, str]]:
    """Reads the lines that are neither empty nor comments; returns their numbers, from 1, and stripped texts."""
    lines = ((number, line.strip()) for number, line in enumerate(read_lines(path), start=1))
    return [(number, line) for number, line in lines if line and not line.startswith("#")]


def parse_numbers(path: Path, text: str, count: int | None = None) -> list[float]:
    """Parses numbers separated by blanks; there must be `count`, if it is given. Errors name `path`."""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        raise InputError(f"{path}: expected numbers, found '{text.strip()[:60]}'") from None
    if count is not None and len(values) != count:
        raise InputError(f"{path}: expected {count} numbers, found {len(values)}")
    return values
