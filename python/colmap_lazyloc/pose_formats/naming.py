"""Finds the photos that a file of poses names, by the names alone."""

import dataclasses
import os
import pathlib
import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.pose_formats.posed_images import Photos

ENDING = re.compile(r"\.(?=\w*[^\W\d])\w{1,5}$")  # .jpg or .HEIC, but not the fraction of a time
Parts = Sequence[str]  # of a path


def _fold(text: str) -> str:
    return text.casefold()


def _fold_stem(text: str) -> str:
    return ENDING.sub("", text).casefold()


# What must be equal in the last part of both paths: for the file's, for the photo's. Later ones are tried for what
# earlier ones have not found.
_KEYS: Sequence[tuple[str, Callable[[str], str], Callable[[str], str]]] = (
    ("", str, str),
    ("without regard to capital letters", _fold, _fold),
    ("", _fold, _fold_stem),  # a name without an ending
    ("with another ending", _fold_stem, _fold_stem),
)


@dataclasses.dataclass(frozen=True)
class Names:
    """The photos that the names in a file mean.

    `photos`: by the index of the name; `ambiguous`: why a name is none, by its index; `how`: how names differ from
    those of the photos.
    """

    photos: dict[int, str]
    ambiguous: dict[int, str]
    how: str = ""

    @staticmethod
    def match(names: Sequence[str], photos: Photos) -> "Names":
        """Finds the photos of names; a name and a photo belong together if each is the other's only best choice.

        The best choice has the longest common end of the paths. Without a folder of photos, names are taken as they
        are.
        """
        if photos.folder is None:
            return _distinct([clean(name) for name in names])
        return Names.among(names, photos.names, os.path.abspath(photos.folder))

    @staticmethod
    def among(names: Sequence[str], photos: Iterable[str], folder: str = "") -> "Names":
        """Finds the photos of names among the names of photos in a folder, as `match` does."""
        # Photos are known by their whole paths, because a file may name their folder, too.
        paths = {photo: _parts(f"{folder}/{photo}") for photo in photos}
        left = {index: _parts(clean(name)) for index, name in enumerate(names)}
        found: dict[int, str] = {}
        ambiguous: dict[int, str] = {}
        ways = []
        for way, of_name, of_photo in _KEYS:
            new, unclear = _match_by(left, paths, of_name, of_photo)
            found |= new
            for index, reason in unclear.items():
                ambiguous[index] = reason.replace("NAME", names[index])
            ways += [way] if new and way else []
            for index in (*new, *unclear):
                left.pop(index, None)
            for photo in new.values():
                del paths[photo]
        return Names(found, ambiguous, ", ".join(ways))


def clean(name: str) -> str:
    """Returns a path as it is on Linux and macOS, without what does not name a folder."""
    path = re.sub(r"[\\/]+", "/", name)
    return re.sub(r"^(file:)?(\./)*", "", path)


def last_number(name: str) -> str | None:
    """Returns the last number in a name, without its ending; None if there is none."""
    numbers = re.findall(r"\d+(?:\.\d+)?", ENDING.sub("", name.rpartition("/")[2]))
    return numbers[-1] if numbers else None


def times_of(names: Iterable[str]) -> list[tuple[str, str]]:
    """Returns (time, name) by time: the last number in the file's name, if these numbers are unique; or else 0, 1, 2...
    in the order of the names."""
    names = sorted(names)
    found = {name: number for name in names if (number := last_number(name)) is not None}
    if len({float(number) for number in found.values()}) == len(names):
        return sorted(((number, name) for name, number in found.items()), key=lambda item: float(item[0]))
    return [(str(i), name) for i, name in enumerate(names)]


def short_names(names: Sequence[str], has_ending: bool = True) -> list[str]:
    """Returns the last parts of paths, and with `has_ending` false without their endings; the paths if two of these are
    equal."""
    short = [name.rpartition("/")[2] for name in names]
    short = short if has_ending else [ENDING.sub("", name) for name in short]
    return short if len(set(short)) == len(short) else list(names)


def files_by_name(path: pathlib.Path, ending: str) -> list[tuple[str, pathlib.Path]]:
    """Returns the files below a folder, or one, with their names in it without the ending: those of photos."""
    folder, paths = (path, sorted(path.rglob(f"*{ending}"))) if path.is_dir() else (path.parent, [path])
    return [(file.relative_to(folder).as_posix().removesuffix(ending), file) for file in paths]


def inside(folder: pathlib.Path, name: str) -> pathlib.Path:
    """Returns the path of a photo's file in a folder; refuses a name that leads out of it."""
    if ".." in name.split("/") or name.startswith("/"):
        raise InputError(f"photo '{name}': its name leads out of the folder")
    return folder / name


def natural_key(name: str) -> list[tuple[int, str]]:
    """Returns what sorts names by the numbers in them: 2 before 10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name) if part]


def natural_order(names: Sequence[str]) -> list[int]:
    """Returns the indices of names, sorted by the numbers in them."""
    return sorted(range(len(names)), key=lambda index: natural_key(names[index]))


def _parts(path: str) -> list[str]:
    return [part for part in unicodedata.normalize("NFC", path).split("/") if part not in ("", ".", "..")] or [""]


def _distinct(names: Sequence[str]) -> Names:
    """Takes names as they are, but none that two poses have."""
    count = Counter(names)
    unique = {index: name for index, name in enumerate(names) if count[name] == 1}
    twice = {index: _of_two(name) for index, name in enumerate(names) if count[name] > 1}
    return Names(unique, twice)


def _of_two(name: str) -> str:
    return f"two poses belong to '{name}'"


def _score(first: Parts, second: Parts) -> tuple[int, int]:
    """Returns how many parts at the ends of two paths are equal, without regard to capital letters, and exactly."""
    pairs = list(zip(reversed(first[:-1]), reversed(second[:-1])))
    folded = next((i for i, (a, b) in enumerate(pairs) if a.casefold() != b.casefold()), len(pairs))
    exact = next((i for i, (a, b) in enumerate(pairs) if a != b), len(pairs))
    return folded, 2 * exact + (ENDING.sub("", first[-1]) == ENDING.sub("", second[-1]))


def _match_by(
    names: dict[int, list[str]],
    photos: dict[str, list[str]],
    of_name: Callable[[str], str],
    of_photo: Callable[[str], str],
) -> tuple[dict[int, str], dict[int, str]]:
    """Returns the photos of names that are each other's only best choice, and why other names are none."""
    by_key: dict[str, list[str]] = {}
    for photo, parts in photos.items():
        by_key.setdefault(of_photo(parts[-1]), []).append(photo)
    best_photos: dict[int, list[str]] = {}
    scores: dict[int, tuple[int, int]] = {}
    claims: dict[str, list[int]] = {}  # names by their best choice
    for index, parts in names.items():
        choices = by_key.get(of_name(parts[-1]), [])
        if choices:
            own = {photo: _score(parts, photos[photo]) for photo in choices}
            scores[index] = max(own.values())
            best_photos[index] = [photo for photo, score in own.items() if score == scores[index]]
            for photo in best_photos[index]:
                claims.setdefault(photo, []).append(index)
    found, unclear = {}, {}
    for index, choices in best_photos.items():
        best = max(scores[claim] for claim in claims[choices[0]])
        if len(choices) > 1:
            unclear[index] = f"'NAME' may be {choices[0]} or {choices[1]}: give the folder of one of them, or paths"
        elif scores[index] == best:
            if sum(scores[claim] == best for claim in claims[choices[0]]) > 1:
                unclear[index] = _of_two(choices[0])
            else:
                found[index] = choices[0]
    return found, unclear
