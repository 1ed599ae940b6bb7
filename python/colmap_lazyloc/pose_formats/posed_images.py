"""Types that all formats share: posed images, and what a format reads them from."""

import dataclasses
import functools
import pathlib
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.poses import Pose

IMAGE_SUFFIXES = (".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff")
UNREADABLE_SUFFIXES = (".avif", ".heic", ".heif")  # of photos that COLMAP cannot read, as many phones make them
# Turns the axes of OpenGL's cameras (x right, y up, z backward) into COLMAP's (x right, y down, z forward).
OPENGL_FROM_COLMAP = np.diag([1.0, -1.0, -1.0])
MAX_ROTATION_ERROR = 0.01  # of an element of a rotation in a file, which may have few digits


@dataclasses.dataclass(frozen=True, eq=False)
class PosedImage:
    """An image with its intrinsics and its pose."""

    name: str
    camera: Camera
    cam_from_world: Pose


@dataclasses.dataclass(frozen=True, eq=False)
class PosedImages:
    """What a format reads. With an origin, the world is a local frame: x east, y north, z up, in metres."""

    images: Sequence[PosedImage]
    origin: GeoOrigin | None = None


@dataclasses.dataclass(frozen=True)
class Photos:
    """The photos that poses belong to; without a folder, names are taken as they are in the file of poses."""

    folder: pathlib.Path | None
    prefix: str = ""  # of the names of those that are used

    @functools.cached_property
    def names(self) -> list[str]:
        """The names of the photos below the folder, sorted."""
        names = [] if self.folder is None else list_images(self.folder)
        return [name for name in names if name.startswith(self.prefix)]

    def find(self, text: object) -> str | None:
        """Returns the name of a photo; None if there is none, or several that it may be.

        A file may name a photo by its path, by a path from another folder, or without its ending.
        """
        path = str(text).replace("\\", "/").removeprefix("./")
        if self.folder is None:
            return path
        if path in self._by_name:
            return path
        base = path.rpartition("/")[2]
        return self._by_base.get(base) or self._by_stem.get(base)

    def size(self, name: str) -> tuple[int, int]:
        """Returns the width and the height of a photo in pixels, as it is stored."""
        if self.folder is None:
            raise InputError("--image_path is needed, because the file does not say how large the photos are")
        import PIL.Image

        path = self.folder / name
        try:
            with PIL.Image.open(path) as photo:
                return photo.size
        except (OSError, ValueError, PIL.Image.DecompressionBombError):
            raise InputError(f"{path}: is not a photo that can be read") from None

    @functools.cached_property
    def _by_name(self) -> frozenset[str]:
        return frozenset(self.names)

    @functools.cached_property
    def _by_base(self) -> dict[str, str]:
        return _unique({name: name.rpartition("/")[2] for name in self.names})

    @functools.cached_property
    def _by_stem(self) -> dict[str, str]:
        return _unique({name: pathlib.PurePosixPath(name).stem for name in self.names})


@dataclasses.dataclass(frozen=True)
class Source:
    """A file of poses, and what else is known about its images."""

    path: pathlib.Path
    photos: Photos = Photos(None)
    camera: Camera | None = None  # of all images, if the file has no intrinsics
    calibration_path: pathlib.Path | None = None
    crs: str | None = None  # coordinate reference system of x, y, z
    origin: GeoOrigin | None = None

    def find_photo(self, text: object) -> str | None:
        """Returns the name of the photo that the file names so; None if it is not there."""
        return self.photos.find(text)


def list_images(folder: pathlib.Path, suffixes: tuple[str, ...] = IMAGE_SUFFIXES) -> list[str]:
    """Returns the names of the image files below a folder, sorted; follows links."""
    if not folder.is_dir():
        raise InputError(f"{folder}: is not a folder")
    import os

    names = (
        (pathlib.Path(directory) / name).relative_to(folder).as_posix()
        for directory, _, files in os.walk(folder, followlinks=True)
        for name in files
    )
    return sorted(name for name in names if name.lower().endswith(suffixes))


def pose_of_camera(world_from_cam: ArrayLike, is_opengl: bool = False) -> Pose:
    """Returns the pose of a camera from the 3x4 or 4x4 matrix of its axes and its centre in the world."""
    matrix = np.asarray(world_from_cam, float)
    if matrix.shape not in ((3, 4), (4, 4)):
        raise ValueError(f"a pose has the shape {matrix.shape}, not 3 x 4 or 4 x 4")
    rotation = nearest_rotation(matrix[:3, :3])
    if is_opengl:
        rotation = rotation @ OPENGL_FROM_COLMAP
    return Pose.from_centre(rotation.T, matrix[:3, 3])


def nearest_rotation(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the rotation nearest to a matrix, which must be one up to rounding."""
    if not np.all(np.isfinite(matrix)):
        raise ValueError("a rotation has values that are not finite")
    u, _, vt = np.linalg.svd(matrix)
    rotation: NDArray[np.float64] = u @ vt
    if np.linalg.det(rotation) < 0 or np.abs(rotation - matrix).max() > MAX_ROTATION_ERROR:
        raise ValueError("a matrix is not a rotation")
    return rotation


def quaternion_rotation(w: float, x: float, y: float, z: float) -> NDArray[np.float64]:
    """Returns the rotation of a quaternion, which is a unit up to rounding."""
    qvec = np.array([w, x, y, z], float)
    norm = float(np.linalg.norm(qvec))
    if not abs(norm - 1) <= MAX_ROTATION_ERROR:
        raise ValueError(f"a quaternion's norm is {norm:g}, not 1")
    return Pose(qvec, np.zeros(3)).rotation


def numbers(values: Any, count: int) -> list[float]:
    """Returns `count` numbers of a list, or of the words of a text."""
    found = [float(value) for value in (values.split() if isinstance(values, str) else values)]
    if len(found) != count:
        raise ValueError(f"there are {len(found)} numbers instead of {count}")
    return found


def _unique(keys: dict[str, str]) -> dict[str, str]:
    """Returns the names by the keys that only one of them has."""
    count = Counter(keys.values())
    return {key: name for name, key in keys.items() if count[key] == 1}
