"""The scene that a dataset's module reads: images with intrinsics and known poses, and the names of the queries."""

import dataclasses
import pathlib

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.poses import Pose


@dataclasses.dataclass(frozen=True)
class Options:
    """Options of the command line for datasets; a module ignores those that do not apply to it."""

    ground_truth: str = "original"  # or "sfm", if the dataset has both
    focal_length_px: float | None = None  # overrides the dataset's focal length
    image_step: int = 1  # use every n-th image of each list or sequence


@dataclasses.dataclass(frozen=True)
class SourceImage:
    camera: Camera
    cam_from_world: Pose | None  # None: a query whose pose is not public


@dataclasses.dataclass(frozen=True)
class SceneSource:
    """A scene as in its dataset. Lengths are in metres, pixels follow COLMAP's convention."""

    name: str
    image_path: pathlib.Path  # names are relative to it
    images: dict[str, SourceImage]
    query_names: tuple[str, ...]
    pairs: tuple[tuple[str, str], ...] | None = None  # None if the dataset has no list of pairs
    leave_one_out: bool = False  # localize each query against all other images, including queries

    @property
    def database_names(self) -> list[str]:
        queries = set(self.query_names)
        return sorted(name for name in self.images if name not in queries)


def require(path: pathlib.Path, where_from: str) -> pathlib.Path:
    """Returns the path if it exists; the error says where to get the file."""
    if not path.exists():
        raise InputError(f"{path} is missing: {where_from}")
    return path
