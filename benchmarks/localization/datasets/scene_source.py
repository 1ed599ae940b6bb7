"""What a dataset's module gives: images with intrinsics and known poses, and which of them are queries."""

import dataclasses
import pathlib

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.poses import Pose


@dataclasses.dataclass(frozen=True)
class Options:
    """What the command line says about a dataset; a module uses what applies to it."""

    ground_truth: str = "original"  # or sfm, if a dataset has two
    focal_length_px: float | None = None  # instead of the dataset's
    image_step: int = 1  # every n-th image of each list or sequence


@dataclasses.dataclass(frozen=True)
class SourceImage:
    camera: Camera
    cam_from_world: Pose | None  # None: a query whose pose is not public


@dataclasses.dataclass(frozen=True)
class SceneSource:
    """A scene as its dataset gives it. Lengths are metres, pixels COLMAP's."""

    name: str
    image_path: pathlib.Path  # names are relative to it
    images: dict[str, SourceImage]
    query_names: tuple[str, ...]
    pairs: tuple[tuple[str, str], ...] | None = None  # None: the dataset comes with no list
    leave_one_out: bool = False  # each query against all other images, queries or not

    @property
    def database_names(self) -> list[str]:
        queries = set(self.query_names)
        return sorted(name for name in self.images if name not in queries)


def require(path: pathlib.Path, where_from: str) -> pathlib.Path:
    """Returns the path if it exists; the error says where to get the file."""
    if not path.exists():
        raise InputError(f"{path} is missing: {where_from}")
    return path
