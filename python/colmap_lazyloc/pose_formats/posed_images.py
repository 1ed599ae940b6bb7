"""Types that all formats share: posed images, and what a format reads them from."""

import contextlib
import dataclasses
import functools
import io
import pathlib
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.conventions import COLMAP, Convention
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.result_fields import ResultFields

if TYPE_CHECKING:
    import PIL.Image
    import PIL.ImageFile

# COLMAP recognizes the format of a photo by its content. Readable are those that COLMAP 3 and COLMAP 4 both read. Those
# of phones can be converted; unreadable are raw files of cameras, and others.
_READABLE = """.bmp .dib .gif .j2c .j2k .jfif .jif .jp2 .jpe .jpeg .jpg .mpo .pbm .pgm .png .pnm .ppm .tga .tif .tiff
.webp"""
_PHONES = ".avif .avifs .heic .heics .heif .hif"
_UNREADABLE = """.jxl
.3fr .arw .cr2 .cr3 .crw .dcr .dng .erf .fff .gpr .iiq .kdc .mef .mos .mrw .nef .nrw .orf .pef .raf .raw .rw2 .rwl .sr2
.srf .srw .x3f
.apng .dds .eps .exr .hdr .icns .ico .jpf .jpx .jxr .pcd .pcx .pfm .psb .psd .qoi .ras .sgi .svg .xbm .xpm"""
ORIENTATION, SIDEWAYS = 0x0112, (5, 6, 7, 8)  # tag of EXIF; its values for photos that are shown on their side
# Depth images next to colour ones, as 7 Scenes has them: frame-000000.color.png and frame-000000.depth.png.
_DEPTH, _COLOUR = re.compile(r"([._-])depth(?=\.\w+$)", re.IGNORECASE), ("color", "colour", "rgb")
IMAGE_SUFFIXES, PHONE_SUFFIXES = tuple(_READABLE.split()), tuple(_PHONES.split())
# What macOS and network drives write beside photos: files `._photo.jpg`, and folders of these and of previews.
NO_PHOTOS = ("._", "__MACOSX", "@eaDir", ".thumbnails", ".Trashes")
UNREADABLE_SUFFIXES = tuple(_UNREADABLE.split())
VIDEO_SUFFIXES = (".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mts", ".webm")
# Pillow refuses photos with twice as many pixels. Its own bound is below the 200 megapixels of some phones.
MAX_NUM_PIXELS = 1 << 29


@dataclasses.dataclass(frozen=True, eq=False)
class PosedImage:
    """An image with its intrinsics and its pose.

    `result`: that of a localized query. `field_of_view`: the outline of what it shows, a closed ring of longitudes and
    latitudes; empty if that is unknown.
    """

    name: str
    camera: Camera
    cam_from_world: Pose
    result: ResultFields | None = None
    field_of_view: Sequence[Sequence[float]] = ()


@dataclasses.dataclass(frozen=True, eq=False)
class PosedImages:
    """What a format reads. With an origin, the world is a local frame: x east, y north, z up, in metres.

    `convention`: how the file was taken to write its poses, after the options of the command line.
    """

    images: Sequence[PosedImage]
    origin: GeoOrigin | None = None
    convention: Convention = COLMAP


@dataclasses.dataclass(frozen=True)
class Position:
    """Where a photo was taken, and the standard deviation in space in metres, if it is known."""

    name: str
    centre: tuple[float, float, float]
    accuracy_m: float | None = None


@dataclasses.dataclass(frozen=True)
class Positions:
    """Where photos were taken: in the local frame at an origin, or, without one, in the coordinates of a file. Photos
    that were taken one after the other are neighbours, if that is known.

    `title`: what the positions are, in messages.
    """

    photos: tuple[Position, ...]
    origin: GeoOrigin | None
    title: str


@dataclasses.dataclass(frozen=True)
class Photos:
    """The photos that poses belong to; without a folder, names are taken as they are in the file of poses."""

    folder: pathlib.Path | None
    prefix: str = ""  # of the names of those that are used
    excluded: Sequence[pathlib.Path] = ()  # folders below the folder that hold other images

    @functools.cached_property
    def names(self) -> list[str]:
        """The names of the photos below the folder, sorted; without depth images beside them."""
        names = (
            [] if self.folder is None else list_images(self.folder, (*IMAGE_SUFFIXES, *PHONE_SUFFIXES), self.excluded)
        )
        photos = {name.rpartition(".")[0].lower() for name in names if not _DEPTH.search(name)}

        def is_depth(name: str) -> bool:
            return any(_DEPTH.sub(rf"\1{word}", name).rpartition(".")[0].lower() in photos for word in _COLOUR)

        return [name for name in names if name.startswith(self.prefix) and not (_DEPTH.search(name) and is_depth(name))]

    def size(self, name: str) -> tuple[int, int]:
        """Returns the width and the height of a photo in pixels, as it is stored."""
        if self.folder is None:
            raise InputError("--image_path is needed, because the file does not say how large the photos are")
        size = photo_size(self.folder / name)
        if size is None:
            raise InputError(f"{self.folder / name}: is not a photo that can be read")
        return size


@dataclasses.dataclass(frozen=True)
class Source:
    """A file of poses, and what else is known about its images."""

    path: pathlib.Path
    photos: Photos = Photos(None)
    camera: Camera | None = None  # of all images, if the file has no intrinsics
    calibration_path: pathlib.Path | None = None
    crs: str | None = None  # coordinate reference system of the positions
    origin: GeoOrigin | None = None
    # These replace the convention of the format: see Convention.
    pose_direction: str | None = None
    camera_axes: str | None = None
    quaternion_order: str | None = None
    shows_crs: bool = False  # the results are shown in `crs`, so that a geographic file may have it, too


@functools.cache
def convertible_suffixes() -> tuple[str, ...]:
    """Returns the endings of the photos of phones that Pillow, if installed, reads from now on.

    Those of HEIC need pillow-heif.
    """
    try:
        import PIL.Image
    except ImportError:
        return ()
    with contextlib.suppress(ImportError):
        import pillow_heif

        pillow_heif.register_heif_opener()
    PIL.Image.init()
    return tuple(suffix for suffix in PHONE_SUFFIXES if suffix in PIL.Image.registered_extensions())


def open_photo(file: pathlib.Path | io.BytesIO) -> "PIL.ImageFile.ImageFile":
    """Opens a photo with Pillow, whose errors for damaged files are of many types. The caller closes it."""
    import PIL.Image

    convertible_suffixes()  # so that Pillow reads photos of phones
    PIL.Image.MAX_IMAGE_PIXELS = MAX_NUM_PIXELS
    return PIL.Image.open(file)


def stored_size(photo: "PIL.Image.Image") -> tuple[int, int]:
    """Returns the width and height in pixels with which a photo is stored. Pillow exchanges them for a TIFF file that
    is shown on its side."""
    width, height = photo.size
    is_exchanged = photo.format == "TIFF" and photo.getexif().get(ORIENTATION) in SIDEWAYS
    return (height, width) if is_exchanged else (width, height)


def photo_size(path: pathlib.Path) -> tuple[int, int] | None:
    """Returns the width and height of a photo in pixels, as it is stored; None if it cannot be read."""
    try:
        with open_photo(path) as photo:
            return stored_size(photo)
    except ImportError:
        raise
    except Exception:
        return None


def decode_as_stored(data: Array, flags: int) -> Array | None:
    """Decodes a photo with OpenCV, without turning it by EXIF, because COLMAP does not turn it either; None if it
    cannot be read. `data`: the bytes of the file, which may have any name; `flags`: of OpenCV's imdecode."""
    import cv2

    # OpenCV turns TIFF photos in any case, and garbles them if it reduces their size.
    if data[:4].tobytes() in (b"II*\0", b"MM\0*"):
        upright = cv2.imdecode(data, flags & cv2.IMREAD_COLOR)
        return None if upright is None else turn_back(upright, read_orientation(io.BytesIO(data.tobytes())))
    return cv2.imdecode(data, flags | cv2.IMREAD_IGNORE_ORIENTATION) if data.size else None


def read_orientation(file: pathlib.Path | io.BytesIO) -> int:
    """Returns EXIF's orientation of a photo; 1, upright, if it has none or cannot be read."""
    try:
        with open_photo(file) as photo:
            return int(photo.getexif().get(ORIENTATION, 1))
    except Exception:  # without Pillow, and each decoder raises others for damaged files
        return 1


def turn_back(upright: Array, orientation: int) -> Array:
    """Returns the pixels as they are stored of a photo that was turned upright by EXIF's orientation."""
    stored = upright.swapaxes(0, 1) if orientation in (5, 7) else upright
    if orientation in (2, 4):
        stored = np.flip(stored, 1 if orientation == 2 else 0)
    return np.ascontiguousarray(np.rot90(stored, {3: 2, 6: 1, 7: 2, 8: 3}.get(orientation, 0)))


def list_images(
    folder: pathlib.Path, suffixes: tuple[str, ...] = IMAGE_SUFFIXES, excluded: Sequence[pathlib.Path] = ()
) -> list[str]:
    """Returns the names of the image files below a folder, sorted; follows links, but not into excluded folders."""
    if not folder.is_dir():
        raise InputError(f"{folder}: is not a folder")
    import os

    closed = {os.path.realpath(path) for path in excluded}
    names = []
    for directory, folders, files in os.walk(folder, followlinks=True):
        photos = (name for name in files if not name.startswith(NO_PHOTOS))
        names += [(pathlib.Path(directory) / name).relative_to(folder).as_posix() for name in photos]
        here = os.path.realpath(directory)
        # Does not follow a link to a folder above it, which would lead round and round.
        inside = {name: os.path.realpath(os.path.join(directory, name)) for name in folders}
        folders[:] = [
            name
            for name in folders
            if name not in NO_PHOTOS and inside[name] not in closed and not f"{here}/".startswith(f"{inside[name]}/")
        ]
    # A named pipe would keep its reader waiting for ever.
    return sorted(name for name in names if name.lower().endswith(suffixes) and not (folder / name).is_fifo())
