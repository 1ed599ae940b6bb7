"""Reads JSON, XML and tables."""

import csv
import json
import math
import pathlib
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence, Set
from typing import Any

import numpy as np

from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.text_files import read_lines

_PLACEHOLDERS = "nan -nan inf -inf null none n/a na -"  # how programs write that a value is missing
MISSING = ("", *_PLACEHOLDERS.split())

# Columns of poses, in their simple names: positions, quaternions and angles. A line with as many of them is a header.
_OF_POSES = re.compile(r"q?[wxyz]|[tpcr][xyz]|rw|lat(itude)?|lon(gitude)?|alt(itude)?|yaw|pitch|roll|omega|phi|kappa")
MIN_NUM_OF_POSES = 6
_OF_NAMES = ("name", "imagename", "image", "filename", "file", "photo", "photoid", "label")

# Units in brackets behind the name of a column, by their factors to metres and degrees, and those that are refused:
# there are several feet. Other words in brackets are no units, as in `X (East)`.
_UNITS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "deg": 1.0, "rad": math.degrees(1), "gon": 0.9}
_OTHER_UNITS = ("ft", "foot", "feet", "usft", "in", "inch", "yd", "mi", "dms", "mrad", "arcsec")
_SPELLINGS = {"meter": "m", "metre": "m", "degree": "deg", "°": "deg", "radian": "rad", "grad": "gon"}
_SPELLINGS |= {
    f"{long}{metre}": f"{short}m"
    for long, short in (("milli", "m"), ("centi", "c"), ("kilo", "k"))
    for metre in ("meter", "metre")
}
_ALL_UNITS = (*_UNITS, *_OTHER_UNITS, *_SPELLINGS, *(f"{name}s" for name in _SPELLINGS))
SEPARATOR_LINE = re.compile(r"sep=.?")  # that Excel writes first, without blanks at its end
_DECIMAL_COMMA = re.compile(r"^([-+]?\d*),(\d+([eE][-+]?\d+)?)$")

Names = str | Sequence[str]  # of a column: any one of several


def read_json(path: pathlib.Path) -> Any:
    """Reads a file of JSON."""
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from None
    except (ValueError, RecursionError):
        raise InputError(f"{path}: is not JSON: it is damaged or cut off") from None


def read_xml(path: pathlib.Path) -> ET.Element:
    """Reads a file of XML, without the prefixes of its names."""
    try:
        root = ET.fromstring(path.read_bytes())
    except (ET.ParseError, ValueError, LookupError) as error:
        raise InputError(f"{path}: is not XML: it is damaged or cut off: {error}") from None
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    return root


class Table:
    """The rows of a file with columns separated by commas, semicolons, tabs or blanks, by the names of their columns.

    Names of columns are compared without case, blanks, underscores and units in brackets. Rows of poses are in metres
    and degrees, whatever their units.
    """

    def __init__(self, path: pathlib.Path, layouts: Sequence[str] = ()):
        """`layouts`: names of the columns of a file that has no row with names, one for each number of columns."""
        self.path = path
        lines = [line.strip().removeprefix("\ufeff") for line in read_lines(path)]
        if SEPARATOR_LINE.fullmatch(lines[0]):
            lines[0] = ""
        body = [(number, line) for number, line in enumerate(lines, 1) if line and not line.startswith("#")]
        heads = [line for line in lines[: body[0][0] if body else None] if line]
        found = [line for line in reversed(heads) if _is_header(line)]
        head = next((line for line in found if is_header_of_poses(line)), found[0] if found else None)
        like = head if head is not None and separator_of(head) else body[0][1] if body else ""
        # A comment may have commas where the rows have blanks.
        first = next((line for _, line in body if line != head), "")
        separator = separator_of(like)
        like_row = like if separator is None or separator in first else first
        self._rows = [(number, split(line, like_row)) for number, line in body if line != head]
        if not self._rows:
            raise InputError(f"{path}: has no rows")
        if head is not None and any(word in _ALL_UNITS for word in self._rows[0][1]):
            raise InputError(f"{path}: has a line of units: write them in brackets behind the names, as in `x [mm]`")
        self.titles = [] if head is None else split(head.lstrip("# "), like)
        count = len(self._rows[0][1])
        known = {"qw", "m00", "r00", *(word for layout in layouts for word in layout.split())}
        # A comment may have as many words as there are columns.
        self.separator, self.has_names = separator_of(like_row), True  # of the columns
        if layouts and (len(self.titles) != count or known.isdisjoint(map(simple_name, self.titles))):
            self.has_names = False
            self.titles = next((words for layout in layouts if len(words := layout.split()) == count), [])
            if not self.titles:
                counts = " or ".join(str(len(layout.split())) for layout in layouts)
                raise InputError(f"{path}: has {count} column{'s' * (count > 1)} instead of {counts}")
        if not self.titles:
            raise InputError(f"{path}: has no row with the names of its columns")
        self.columns = [simple_name(title) for title in self.titles]
        self.units = [_unit_of(title) for title in self.titles]
        twice = next((name for name in self.columns if name and self.columns.count(name) > 1), None)
        if twice is not None:
            raise InputError(f"{path}: has two columns '{twice}'")
        self._used: set[str] = set()
        if self.separator is None and self.columns[0] in _OF_NAMES:
            self._rows = [(number, _join_first(words, len(self.columns))) for number, words in self._rows]

    def rows(self) -> list["Row"]:
        return [Row(self, number, words) for number, words in self._rows]

    def has(self, *names: Names) -> bool:
        """True if there is a column for each of the names."""
        return all(self.find(name) is not None for name in names)

    def find(self, names: Names) -> int | None:
        """Returns the place of the first column that has one of these names."""
        for name in (names,) if isinstance(names, str) else names:
            if simple_name(name) in self.columns:
                self._used.add(simple_name(name))
                return self.columns.index(simple_name(name))
        return None

    def require(self, expected: str, *names: Names) -> None:
        """Refuses a table without one of these columns."""
        if not self.has(*names):
            raise InputError(f"{self.path}: has the columns {', '.join(self.titles)[:300]}; expected are {expected}")

    def report_unused(self, used: Iterable[str] = ()) -> None:
        """Names the columns that nobody has looked for, and that are not among those used."""
        report_unused(self.path, [dict(zip(self.titles, self.titles))], self._used.union(used), "columns")


class Row:
    """A row of a table by the names of its columns."""

    def __init__(self, table: Table, line_number: int, words: list[str]):
        self.label = f"line {line_number}"
        self._table, self._words = table, words

    @property
    def values(self) -> dict[str, str]:
        """The values by the simple names of their columns, without those that are missing."""
        self._check()
        pairs = zip(self._table.columns, self._words)
        return {name: word for name, word in pairs if word.lower() not in MISSING}

    def text(self, names: Names) -> str:
        """Returns the value of a column."""
        self._check()
        place = self._table.find(names)
        title = names if isinstance(names, str) else names[0]
        if place is None or self._words[place].lower() in MISSING:
            raise ValueError(f"there is no {title}")
        return self._words[place]

    def number(self, names: Names) -> float:
        """Returns the value of a column as a number, in metres or degrees."""
        text, unit = self.text(names), self.unit(names)
        if unit in _OTHER_UNITS:
            raise ValueError(f"a column is in {unit}: give metres and degrees")
        try:
            return float(text) * _UNITS.get(unit, 1.0)
        except ValueError:
            raise ValueError(f"expected a number, found '{text[:40]}'") from None

    def has(self, names: Names) -> bool:
        """True if there is a column of this name, whose value is not missing in this row."""
        place = self._table.find(names)
        return place is not None and place < len(self._words) and self._words[place].lower() not in MISSING

    def unit(self, names: Names) -> str:
        """Returns the unit of a column; empty if it has none."""
        place = self._table.find(names)
        return "" if place is None else self._table.units[place]

    def numbers(self, *names: Names) -> list[float]:
        """Returns the values of several columns."""
        return [self.number(name) for name in names]

    def _check(self) -> None:
        if len(self._words) != len(self._table.columns):
            raise ValueError(f"there are {len(self._words)} columns instead of {len(self._table.columns)}")


def simple_name(text: str) -> str:
    """Returns the name of a column without case, blanks, underscores and units."""
    return re.sub(r"\[[^\[\]]*\]|\([^()]*\)|[\s_#\"]", "", text).lower()


def report_unused(path: pathlib.Path | str, items: Iterable[Any], known: Set[str], kind: str = "keys") -> None:
    """Names the keys of objects that nobody reads, unless their values are empty, false or 0.

    `known`: the simple names of the keys that are read, and of others that change neither poses nor intrinsics.
    """
    objects = (item for item in items if isinstance(item, Mapping))
    names = dict.fromkeys(name for item in objects for name, value in item.items() if value)
    unused = [name for name in names if simple_name(name) not in known]
    if unused:
        logger.warning("%s: %s that are not used: %s", path, kind, ", ".join(unused)[:300])


def _unit_of(title: str) -> str:
    """Returns the unit in brackets of a column's title; empty if it has none that is known."""
    found = [word for pair in re.findall(r"\[(.*?)\]|\((.*?)\)", title) for word in pair if word]
    text = found[-1].strip().lower() if found else ""
    text = text.removesuffix("s") if len(text) > 3 else text
    text = _SPELLINGS.get(text, text)
    return text if text in _UNITS or text in _OTHER_UNITS else ""


def separator_of(line: str) -> str | None:
    """Returns what separates the columns of a line; None for blanks."""
    return next((separator for separator in (";", ",", "\t") if separator in line), None)


def is_header_of_poses(line: str) -> bool:
    """True for a line with the names of columns of poses, which may be a comment."""
    return sum(_OF_POSES.fullmatch(name) is not None for name in column_names(line)) >= MIN_NUM_OF_POSES


def header_of(comments: Sequence[str], body: Sequence[str]) -> tuple[str | None, str]:
    """Returns the line that names the columns, if there is one, and the first of the other lines that are no comment.

    It is the first line or a comment above it: one with columns of poses, or else one with as many words as the rows,
    the first of which is that of a name.
    """
    lines = [*comments, *body[:1]]
    head = next((line for line in reversed(lines) if is_header_of_poses(line)), None)
    row = next((line for line in body[:2] if line != head), "")
    if head is None and body:
        rows = body[1:2] if _is_named(body[0]) else body[:1]
        count = len(split(rows[0], rows[0])) if rows else 0
        head = next((line for line in reversed(lines) if _is_named(line) and len(column_names(line)) == count), None)
        row = rows[0] if head is not None and rows else body[0]
    return head, row


def column_names(line: str) -> list[str]:
    """Returns the simple names of the columns in a header."""
    return [simple_name(word) for word in split(line.lstrip("# "), line)]


def split(line: str, like: str) -> list[str]:
    """Splits a line at the separator that another line has."""
    separator = separator_of(like)
    try:
        words = line.split() if separator is None else next(csv.reader([line], delimiter=separator))
    except (csv.Error, StopIteration):
        return [line]
    words = [word.strip() for word in words]
    if separator != ",":  # numbers may have decimal commas
        words = [_DECIMAL_COMMA.sub(r"\1.\2", word) for word in words]
    return words


def _join_first(words: list[str], count: int) -> list[str]:
    """Returns `count` words, of which the first is a name that may have blanks."""
    num_first = max(1, len(words) - count + 1)
    return [" ".join(words[:num_first]), *words[num_first:]]


def numbers(values: Any, count: int) -> list[float]:
    """Returns `count` numbers of a list, or of the words of a text."""
    found = [float(value) for value in (values.split() if isinstance(values, str) else values)]
    if len(found) != count:
        raise ValueError(f"there are {len(found)} numbers instead of {count}")
    return found


def read_numbers(path: pathlib.Path, count: int) -> list[float]:
    """Reads a text file of `count` numbers, separated by blanks, commas or ends of lines."""
    return numbers(" ".join(read_lines(path)).replace(",", " "), count)


def words(*values: Any, separator: str = " ") -> str:
    """Returns the numbers of arrays, from which the same numbers are read again."""
    return separator.join(repr(float(number)) for value in values for number in np.ravel(value))


def words_of(text: str) -> frozenset[str]:
    """Returns the words of a text."""
    return frozenset(text.split())


def _is_named(line: str) -> bool:
    """True for words, the first of which is that of a column with names, and none of which is a number."""
    names = column_names(line)
    return names[:1] != [] and names[0] in _OF_NAMES and not any(re.match(r"[-+.\d]", name) for name in names)


def _is_header(line: str) -> bool:
    """True for a line with names: the last word of it is no number."""
    words = [word for word in split(line.lstrip("# "), line) if word]
    return len(words) > 1 and re.match(r"[-+.\d]*\d", words[-1]) is None and words[-1].lower() not in MISSING
