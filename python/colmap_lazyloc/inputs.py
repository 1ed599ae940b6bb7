"""Queries that are not in the database."""

import dataclasses
import os
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclasses.dataclass(frozen=True, eq=False)
class Photo:
    """A photo whose features are extracted and matched in memory.

    `image`: a file (below the option image_path, if it is set), or uint8 values, height x width (grey) or
    height x width x 3 (RGB). `camera`: as for `Localizer.localize_photo`. `name`: the query's name, from which random
    choices are seeded; default: the path, or "photo". `position`, `gravity`: as for `Localizer.localize`.
    """

    image: str | os.PathLike[str] | NDArray[np.uint8]
    camera: Any = None
    name: str | None = None
    position: Any = None
    gravity: Any = None


@dataclasses.dataclass(frozen=True, eq=False)
class Matches:
    """A query with features and matches of its own; the fields are described at `Localizer.localize_matches`."""

    camera: Any
    keypoints: ArrayLike
    pairs: Mapping[str, Any]
    name: str = "query"
    position: Any = None
    gravity: Any = None


Query = str | Photo | Matches
QueryT = TypeVar("QueryT", bound=Query)  # lets a dict with keys of one kind be an argument
