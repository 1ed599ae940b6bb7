"""What the reader of a format returns: the poses as the file has them."""

import contextlib
import dataclasses
import pathlib
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeVar

import numpy as np

from colmap_lazyloc.errors import InputError, first_names, logger
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.cameras import SizeOfPhoto
from colmap_lazyloc.pose_formats.conventions import Convention
from colmap_lazyloc.pose_formats.frames import NO_FRAME, Frame, Similarity
from colmap_lazyloc.result_fields import ResultFields

# What damaged values lead to, in a reader that takes them to be right.
DAMAGE = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)

# Values of JSON by the names of their types in Python, and what Python says of wrong ones in the words of a file.
_KINDS = {"str": "a text", "NoneType": "null", "list": "a list", "dict": "an object", "bool": "true or false"}
_KINDS |= {"int": "a number", "float": "a number"}
_WORDS = (
    (r"could not convert string to float: (.*)", r"expected a number, found \1"),
    (r"invalid literal for int\(\) with base 10: (.*)", r"expected a whole number, found \1"),
    (r"(?:setting an array element with a sequence|cannot reshape array).*", "its numbers are not those of a matrix"),
    (r"cannot convert float (?:NaN|infinity) to integer", "a number is not finite"),
    (
        r".*(?:index out of range|out of bounds|not enough values|too many values).*",
        "it has too few or too many values",
    ),
    (r".*\barg(?:ument)? is an empty sequence|max\(\) iterable argument is empty", "it is empty"),
)

MAX_NUM_NAMED = 3  # of what is left out

T = TypeVar("T")
MakeCamera = Callable[[SizeOfPhoto], Camera]


@dataclasses.dataclass(frozen=True, eq=False)
class RawPose:
    """A pose as a file has it; a convention specifies what its rotation and vector mean.

    Its photo is found by `name`, or the number `frame` in the photo's name, or `time`, or else its place in the file.
    `camera`: its intrinsics, or the function that makes them, if no option gives others. `similarity`: from the pose's
    world to the frame of the file. `result`: that of a localized query, in the coordinates of the model. `accuracy_m`:
    the standard deviation of the position in space, if the file has it. `field_of_view`: as PosedImage has it.
    """

    rotation: Any
    vector: Any
    name: str | None = None
    frame: int | None = None
    time: float | None = None
    camera: Camera | MakeCamera | None = None
    similarity: Similarity | None = None
    result: ResultFields | None = None
    accuracy_m: float | None = None
    field_of_view: Sequence[Sequence[float]] = ()


@dataclasses.dataclass(frozen=True)
class BadPose:
    """An item of a file that is no pose, and why."""

    label: str
    reason: str


@dataclasses.dataclass(frozen=True, eq=False)
class RawPoses:
    """What a reader returns; `convention`: that of the file, if the format's own leaves something open."""

    poses: Sequence[RawPose | BadPose]
    frame: Frame = NO_FRAME
    convention: Convention | None = None

    @property
    def written(self) -> list[RawPose]:
        """Returns the poses of a file to write, which are all good."""
        return [pose for pose in self.poses if isinstance(pose, RawPose)]


def each(items: Iterable[T], parse: Callable[[T], object], label: Callable[[T], object] | None = None) -> list[Any]:
    """Parses each item; one that is damaged becomes a BadPose, so that it does not end the others."""
    if items is None or isinstance(items, (str, dict, float, int)):
        raise ValueError(f"there is {_KINDS.get(type(items).__name__)} instead of a list of poses")
    poses: list[Any] = []
    for index, item in enumerate(items, start=1):
        try:
            poses.append(parse(item))
        except DAMAGE as error:
            poses.append(BadPose(f"pose {index}" if label is None else str(label(item)), reason_of(error)))
    return poses


def each_named(path: pathlib.Path, items: Iterable[T], parse: Callable[[T], None], label: Callable[[T], str]) -> None:
    """Parses items that are no poses; damaged ones are left out, and named."""
    bad = [item for item in each(items, parse, label) if isinstance(item, BadPose)]
    if bad:
        names = first_names([f"{item.label} ({item.reason})" for item in bad], MAX_NUM_NAMED)
        logger.warning("%s: left out: %s", path, names)


def of_largest_part(poses: list[Any], part_of: Callable[[RawPose], str | None], path: pathlib.Path) -> list[Any]:
    """Returns the poses of the largest part of a reconstruction, because parts that are not connected have coordinates
    of their own; `part_of`: its name, or None if it is not known. Poses of others are counted in a warning."""
    count = Counter(part for pose in poses if isinstance(pose, RawPose) and (part := part_of(pose)) is not None)
    if len(count) < 2:
        return poses
    ((largest, _),) = count.most_common(1)
    kept = [pose for pose in poses if isinstance(pose, BadPose) or part_of(pose) in (largest, None)]
    text = "%s: %d photos of %d other components are left out, because they have no transform to the same coordinates"
    logger.warning(text, path, len(poses) - len(kept), len(count) - 1)
    return kept


def reason_of(error: Exception) -> str:
    """Returns why an item could not be read; options that are missing or wrong concern all items, and are raised."""
    if isinstance(error, InputError) and str(error).startswith("--"):
        raise error
    if isinstance(error, KeyError):
        return f"it lacks {error}"
    text = str(error)
    if isinstance(error, InputError):
        return text
    if isinstance(error, (TypeError, AttributeError)):
        text = re.sub(r"^(list|str)(ing)? ind.*", r"'\1'", text)  # list indices must be integers
        kinds = [kind for name in re.findall(r"'(\w+)'", text) if (kind := _KINDS.get(name))]
        return f"there is {kinds[0]} where another value is expected" if kinds else "a value is of another kind"
    return next((re.sub(pattern, words, text) for pattern, words in _WORDS if re.fullmatch(pattern, text)), text)


@contextlib.contextmanager
def errors_named(path: pathlib.Path, of_damage: str = "") -> Iterator[None]:
    """Makes an InputError that names the file of any error within; `of_damage`: what precedes the reason of others."""
    try:
        yield
    except (*DAMAGE, OSError) as error:
        text = reason_of(error)
        if isinstance(error, InputError):
            if text.startswith(str(path)):
                raise
            of_damage = ""
        raise InputError(f"{path}: {of_damage}{text}") from None


def matrix_parts(matrix: Any) -> tuple[Any, Any]:
    """Returns the rotation and the vector of a 3x4 or 4x4 matrix, which may be a list of its numbers, row by row."""
    rows = np.array(matrix, float)
    if rows.size not in (12, 16):
        raise ValueError(f"a pose has {rows.size} numbers, not those of a 3 x 4 or 4 x 4 matrix")
    rows = rows.reshape(-1, 4)
    if len(rows) == 4 and np.all(np.isfinite(rows)) and not np.allclose(rows[3], (0, 0, 0, 1), atol=1e-6):
        raise ValueError("the last row of a 4 x 4 matrix is not 0 0 0 1, so that it may be transposed")
    return rows[:3, :3], rows[:3, 3]
