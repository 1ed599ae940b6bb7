"""Reads JSON files and tables."""

import csv
import json
import pathlib
import re
from collections.abc import Mapping, Sequence
from typing import Any

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.text_files import read_lines


def read_json(path: pathlib.Path) -> Any:
    """Reads a file of JSON."""
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from None
    except (ValueError, RecursionError):
        raise InputError(f"{path}: is not JSON: it is damaged or cut off") from None


class Table:
    """The rows of a file with columns separated by commas, semicolons or blanks, and the columns' names if it has any.

    Names are compared without case, blanks, underscores and units in brackets.
    """

    def __init__(self, path: pathlib.Path):
        lines = [line.strip().removeprefix("\ufeff") for line in read_lines(path)]
        lines = [line for line in lines if line and not re.match(r"#\s*cameras\b", line)]
        header = next((line for line in lines if re.search(r"[a-df-zA-DF-Z]{2}", line)), "")
        is_header = bool(lines) and lines[0] == header and not _is_number(_split(header)[-1])
        self.columns = [simple_name(word) for word in _split(header.lstrip("# "))] if is_header else []
        body = [line for line in lines[is_header:] if not line.startswith("#")]
        self.rows = [_split(line, header if is_header else line) for line in body]
        width = len(self.columns) if is_header else max(map(len, self.rows), default=0)
        for row in self.rows:
            if len(row) != width:
                raise InputError(f"{path}: a row has {len(row)} columns instead of {width}: '{' '.join(row)[:60]}'")
        if not self.rows:
            raise InputError(f"{path}: has no rows")

    def entries(self) -> list["Entry"]:
        """Returns the rows with the names of their columns."""
        return [Entry(dict(zip(self.columns, row))) for row in self.rows]


class Entry:
    """A row of a table by the names of its columns."""

    def __init__(self, values: Mapping[str, str]):
        self._values = values

    def has(self, *names: str | Sequence[str]) -> bool:
        """True if the row has a value for each of the names; a list of names means any of these."""
        return all(self._find(name) is not None for name in names)

    def text(self, *names: str) -> str:
        """Returns the first of the values that the row has."""
        value = self._find(names)
        if value is None:
            raise InputError(f"there is no column '{names[0]}'")
        return value

    def number(self, *names: str, default: float | None = None) -> float:
        """Returns the first of the values that the row has as a number."""
        value = self._find(names)
        if value is None and default is not None:
            return default
        text = self.text(*names)
        try:
            return float(text)
        except ValueError:
            raise InputError(f"column '{names[0]}': expected a number, found '{text[:40]}'") from None

    def numbers(self, names: str) -> list[float]:
        """Returns the values of several columns, whose names are separated by blanks."""
        return [self.number(name) for name in names.split()]

    def _find(self, names: str | Sequence[str]) -> str | None:
        for name in (names,) if isinstance(names, str) else names:
            value = self._values.get(simple_name(name), "")
            if value != "":
                return value
        return None


def simple_name(text: str) -> str:
    """Returns the name of a column without case, blanks, underscores and units."""
    return re.sub(r"\[.*?\]|\(.*?\)|[\s_#\"]", "", text).lower()


def _split(line: str, like: str | None = None) -> list[str]:
    """Splits a line at the separator that it has, or that another line has."""
    like = like or line
    separator = next((separator for separator in (",", ";", "\t") if separator in like), None)
    if separator is None:
        return line.split()
    try:
        return [word.strip() for word in next(csv.reader([line], delimiter=separator))]
    except csv.Error:
        return [line]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
