"""What the localizer is given: the types of its arguments, and queries that are not in the database."""

import dataclasses
from collections.abc import Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from colmap_lazyloc.model import CameraLike, ModelLike
from colmap_lazyloc.poses import PoseLike
from colmap_lazyloc.text_files import Path

CameraInput = str | Mapping[str, object] | CameraLike  # "MODEL width height params...", a dict, or a pycolmap.Camera
PoseInput = PoseLike | ArrayLike | tuple[ArrayLike, ArrayLike]  # a PoseLike, a 3x4 or 4x4 matrix, or (R, t)
PosedInput = (
    tuple[ArrayLike, ArrayLike, CameraInput] | tuple[PoseInput, CameraInput]
)  # (R, t, camera) or (pose, camera)
ModelInput = ModelLike | Mapping[str, PosedInput]  # a ModelLike, or {name: (R, t, camera) or (pose, camera)}
PositionPrior = tuple[ArrayLike, ArrayLike]  # (x, y, z); one or three standard deviations, or a 3x3 covariance
GravityPrior = tuple[ArrayLike, float]  # downward direction (x, y, z), and its standard deviation in degrees
PairInput = ArrayLike | tuple[ArrayLike, ArrayLike]  # matches, or (keypoints of the posed image, matches)
Option = str | float | Path | ArrayLike  # the value of an option
Options = Mapping[str, "Option | Options"]  # {name: value}, or nested dicts


@dataclasses.dataclass(frozen=True, eq=False)
class Photo:
    """A photo that is not in the database. Its features are extracted and matched in memory.

    The fields are the arguments of `Localizer.localize_photo`.
    """

    image: Path | NDArray[np.uint8]
    camera: CameraInput | None = None
    name: str | None = None
    position: PositionPrior | None = None
    gravity: GravityPrior | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Matches:
    """A query with features and matches of your own. The fields are the arguments of `Localizer.localize_matches`."""

    camera: CameraInput
    keypoints: ArrayLike
    pairs: Mapping[str, PairInput]
    name: str = "query"
    position: PositionPrior | None = None
    gravity: GravityPrior | None = None


Query = str | Photo | Matches  # a string is the name of one of `Localizer.queries`
QueryT = TypeVar("QueryT", bound=Query)  # lets a dict with keys of one kind be an argument
