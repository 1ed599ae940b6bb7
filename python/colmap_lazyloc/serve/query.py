"""What is localized for one request: a photo, and what else is known of it."""

import dataclasses
import os
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from colmap_lazyloc.arrays import to_camera
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.inputs import GravityPrior, PositionPrior
from colmap_lazyloc.localizer import Localizer
from colmap_lazyloc.result import Result
from colmap_lazyloc.serve.geopose import Pixels
from colmap_lazyloc.serve.sessions import agrees

SESSION = re.compile("[A-Za-z0-9._-]{1,64}")


@dataclasses.dataclass(frozen=True)
class Query:
    """A photo, a file or pixels, with arguments of Localizer.localize_photo, and the position from its session."""

    photo: bytes | Pixels
    fields: Mapping[str, Any]
    localizer: Localizer
    prior: PositionPrior | None = None

    def localize(self) -> Result:
        if self.prior is not None:
            result = self._localize({**self.fields, "position": self.prior})
            if agrees(result):
                return result
        return self._localize(self.fields)

    def _localize(self, fields: Mapping[str, Any]) -> Result:
        if isinstance(self.photo, np.ndarray):
            return self.localizer.localize_photo(self.photo, name="photo", **fields)
        # A file in memory: nothing of the photo reaches a disk, and its EXIF is read as that of any file.
        with os.fdopen(os.memfd_create("photo"), "wb") as file:
            file.write(self.photo)
            file.flush()
            return self.localizer.localize_photo(f"/proc/self/fd/{file.fileno()}", name="photo", **fields)


def parse_fields(fields: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """Returns the arguments of Localizer.localize_photo, and the session."""
    parsers: dict[str, Callable[[list[str]], Any]] = {
        "camera": _parse_camera,
        "position": _parse_position,
        "gravity": _parse_gravity,
        "session": _parse_session,
    }
    parsed: dict[str, Any] = {}
    for name, text in fields:
        if name not in parsers:
            raise InputError(f"unknown field {name!r}; known are {', '.join(parsers)}")
        if name in parsed:
            raise InputError(f"{name} is given twice")
        parsed[name] = parsers[name](text.replace(",", " ").split())
    return parsed


def _parse_camera(words: list[str]) -> str:
    camera = " ".join(words)
    to_camera(camera)  # raises if it is none
    return camera


def _parse_position(words: list[str]) -> PositionPrior:
    numbers = _parse_numbers("position", words, (4, 6, 9))
    uncertainty: Any = numbers[3:]
    if len(numbers) == 9:
        upper = np.zeros((3, 3))
        upper[np.triu_indices(3)] = uncertainty
        uncertainty = upper + np.triu(upper, 1).T
    elif not min(uncertainty) > 0:
        raise InputError("position: a standard deviation is not positive")
    return numbers[:3], uncertainty


def _parse_gravity(words: list[str]) -> GravityPrior:
    *direction, stddev_deg = _parse_numbers("gravity", words, (4,))
    if not stddev_deg > 0 or not any(direction):
        raise InputError("gravity: must be a direction and a positive standard deviation")
    return direction, stddev_deg


def _parse_session(words: list[str]) -> str:
    session = " ".join(words)
    if not SESSION.fullmatch(session):
        raise InputError("session: must be a name of at most 64 letters, digits, dots, dashes and underscores")
    return session


def _parse_numbers(name: str, words: list[str], counts: Sequence[int]) -> list[float]:
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) not in counts:
        raise InputError(f"{name}: must be {' or '.join(map(str, counts))} numbers")
    return numbers
