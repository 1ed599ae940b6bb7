"""The photos of a project: which files are used, what they are called, and what they hold."""

import concurrent.futures
import pathlib
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.extras import is_installed
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.posed_images import (
    IMAGE_SUFFIXES,
    ORIENTATION,
    PHONE_SUFFIXES,
    SIDEWAYS,
    UNREADABLE_SUFFIXES,
    VIDEO_SUFFIXES,
    convertible_suffixes,
    list_images,
    open_photo,
    photo_size,
    stored_size,
    turn_back,
)
from colmap_lazyloc.progress import progress
from colmap_lazyloc.project.folder import Folder, content, fingerprint, remove

# Characters that COLMAP's lists and databases cannot hold: blanks, control characters, bytes that are not UTF-8, and
# the backslash, which COLMAP takes for a slash.
UNSAFE = re.compile(r"[\s\\\x00-\x1f\x7f-\x9f\ud800-\udfff]")
JPEG_QUALITY = 95  # of converted photos
REFUSED = ".refused"  # ending of the mark of a photo that could not be converted
PHONE_FORMATS = ("AVIF", "HEIF")  # Pillow's names
MIRRORED, TURNED = (2, 4, 5, 7), (3, 6, 8)  # values of EXIF's orientation for mirror images, and for others
MAX_NUM_NAMED = 5  # of photos that are left out


def find_photos(source: pathlib.Path, excluded: Sequence[pathlib.Path]) -> dict[str, pathlib.Path]:
    """Returns the paths by name of the photos in a folder, or of a single one. `excluded`: folders of other images."""
    videos = []
    if source.is_file():
        root, every = source.parent, [source.name]
    else:
        root, every = source, list_images(source, (*IMAGE_SUFFIXES, *PHONE_SUFFIXES, *UNREADABLE_SUFFIXES), excluded)
        videos = list_images(source, VIDEO_SUFFIXES, excluded)
    others = set(PHONE_SUFFIXES).difference(convertible_suffixes()).union(UNREADABLE_SUFFIXES)
    unreadable = [name for name in every if pathlib.PurePath(name).suffix.lower() in others]
    names = sorted(set(every).difference(unreadable))
    hints = [_describe(unreadable, _remedy(unreadable))] if unreadable else []
    hints += [_describe(videos, "pass the path of a video instead of the folder's")] if videos else []
    hint = "; ".join(hints)
    if not names:
        raise InputError(f"{source}: {hint or 'holds no image file'}")
    if hint:
        logger.warning("%s: %s", source, hint)
    return {name: root / name for name in names}


def _describe(names: Sequence[str], remedy: str) -> str:
    counts = Counter(pathlib.PurePath(name).suffix.lower() for name in names)
    kinds = ", ".join(f"{count} {suffix}" for suffix, count in sorted(counts.items()))
    files = "1 file is" if len(names) == 1 else f"{len(names)} files are"
    return f"{files} left out: {kinds} ({remedy})"


def _remedy(unreadable: Sequence[str]) -> str:
    can_install = any(name.lower().endswith(PHONE_SUFFIXES) for name in unreadable)
    them = "it" if len(unreadable) == 1 else "them"
    return f"COLMAP cannot read {them}: convert to JPEG" + (", or install pillow-heif" if can_install else "")


def has_one_camera(paths: Iterable[pathlib.Path]) -> bool:
    """True if EXIF shows that one camera with one lens took all photos of a size and a focal length. Needs Pillow."""
    with concurrent.futures.ThreadPoolExecutor() as threads:
        kinds = list(threads.map(_kind_and_camera, paths))
    return None not in kinds and len(set(kinds)) == len({kind for kind, _ in filter(None, kinds)})


def _kind_and_camera(path: pathlib.Path) -> tuple[tuple[object, ...], tuple[str, ...]] | None:
    """Returns size and focal length, and what EXIF has of the camera; None without a model or a focal length."""
    from PIL.ExifTags import IFD, Base

    try:
        with open_photo(path) as photo:
            main = photo.getexif()
            tags = {**main, **main.get_ifd(IFD.Exif)}
            size = photo.size
    except ImportError:
        raise
    except Exception:  # each decoder raises others for damaged files
        return None
    camera = tuple(str(tags.get(tag, "")) for tag in (Base.Make, Base.Model, Base.LensModel, Base.DigitalZoomRatio))
    # COLMAP takes the first one that is there. Photos with different ones never share a camera.
    focal_length = tags.get(Base.FocalLengthIn35mmFilm) or tags.get(Base.FocalLength)
    return ((*size, str(focal_length)), camera) if camera[1] and focal_length else None


def convert_photos(folder: Folder, role: str, paths: Mapping[str, pathlib.Path]) -> dict[str, pathlib.Path]:
    """Converts photos to JPEG that COLMAP cannot read, or not as they are meant; returns the paths of all by name.

    Files that cannot be converted stay as they are. What was converted, or could not be, is kept by the content of the
    file for as long as there is a photo of this role with it.
    """
    if not is_installed("PIL"):
        return dict(paths)
    with concurrent.futures.ThreadPoolExecutor() as threads:
        is_chosen = dict(zip(paths, threads.map(_needs_conversion, paths.values()), strict=True))
    place = folder.converted / role
    targets = {name: place / f"{content(path)}.jpg" for name, path in paths.items() if is_chosen[name]}
    kept = set(targets.values())
    for path in place.iterdir() if place.is_dir() else ():
        if path.with_suffix(".jpg") not in kept:
            path.unlink()
    missing = {
        target: paths[name]
        for name, target in targets.items()
        if not target.exists() and not target.with_suffix(REFUSED).exists()
    }
    if missing:
        logger.info("converting %d photos to JPEG", len(missing))
        place.mkdir(parents=True, exist_ok=True)
        with concurrent.futures.ThreadPoolExecutor() as threads:
            list(progress(threads.map(_convert, missing.values(), missing), "photos", len(missing)))
    return {**paths, **{name: target for name, target in targets.items() if target.exists()}}


def _needs_conversion(path: pathlib.Path) -> bool:
    """True for photos of phones, for 16 bits per colour, and for pixels that EXIF calls a mirror image."""
    try:
        with open_photo(path) as photo:
            has_16_bits = photo.mode in ("RGB", "RGBA") and any(";16" in str(tile) for tile in photo.tile)
            return photo.format in PHONE_FORMATS or has_16_bits or photo.getexif().get(ORIENTATION) in MIRRORED
    except Exception:  # each decoder raises others for damaged files
        return path.name.lower().endswith(PHONE_SUFFIXES)  # so that it is refused once


def _convert(path: pathlib.Path, target: pathlib.Path) -> None:
    """Writes a JPEG file with the EXIF of a photo; a mark that it is refused if the photo cannot be read."""
    import PIL.ImageOps

    try:
        with open_photo(path) as photo:
            orientation = photo.getexif().get(ORIENTATION)
            upright = PIL.ImageOps.exif_transpose(photo) if orientation in MIRRORED else photo
            exif = upright.info.get("exif") or b""
            pixels = upright.convert("RGB")
            if orientation in TURNED and photo.format == "TIFF":  # Pillow has turned it
                pixels = PIL.Image.fromarray(turn_back(np.asarray(pixels), orientation))
                exif = PIL.Image.Exif()
                exif[ORIENTATION] = orientation
    except Exception:  # each decoder raises others for damaged files
        target.with_suffix(REFUSED).touch()
        return
    staged = target.with_suffix(".tmp")
    pixels.save(staged, "JPEG", quality=JPEG_QUALITY, subsampling=0, exif=exif)
    staged.replace(target)


def stored_pixel(what: str, path: pathlib.Path, x: float, y: float) -> tuple[float, float]:
    """Returns where the project's image of a photo has the pixel that a viewer of photos shows at x, y. Viewers turn
    photos upright; the project does so only with mirror images. `what` begins the message if there is no such pixel."""
    try:
        with open_photo(path) as photo:
            (width, height), orientation = stored_size(photo), photo.getexif().get(ORIENTATION)
    except ImportError:
        raise
    except Exception:  # each decoder raises others for damaged files
        raise InputError(f"{what}: {path} is not a photo that can be read") from None
    shown = (height, width) if orientation in SIDEWAYS else (width, height)
    if not (0 <= x <= shown[0] and 0 <= y <= shown[1]):
        raise InputError(f"{what}: is outside of the photo, which has {shown[0]} x {shown[1]} pixels")
    turned = {3: (width - x, height - y), 6: (y, height - x), 8: (width - y, x)}
    return turned.get(orientation or 0, (x, y))


def safe_names(names: Iterable[str]) -> dict[str, str]:
    """Returns names without unsafe characters, each another one; those that are safe stay as they are."""
    safe: dict[str, str] = {}
    taken: set[str] = set()
    for name in sorted(names, key=lambda name: (UNSAFE.search(name) is not None, name)):
        path = pathlib.PurePosixPath(UNSAFE.sub("_", name))
        while str(path) in taken:
            path = path.with_stem(f"{path.stem}_")
        taken.add(str(path))
        safe[name] = str(path)
    return safe


def link_photos(folder: Folder, role: str, paths: Mapping[str, pathlib.Path]) -> dict[str, str]:
    """Links photos into the project; returns the names of the images by those of the photos."""
    linked = {name: f"{role}/{safe}" for name, safe in safe_names(paths).items()}
    _replace_links(folder.images, role, {linked[name]: path for name, path in paths.items()})
    return linked


def link_masks(folder: Folder, role: str, linked: Mapping[str, str], masks: pathlib.Path | None) -> int:
    """Links the masks of photos into the project; returns how many there are."""
    remove(folder.masks / role)  # of an earlier run
    if masks is None:
        return 0
    root = masks / role if (masks / role).is_dir() else masks
    found = {f"{image}.png": root / f"{name}.png" for name, image in linked.items()}
    found = {name: path for name, path in found.items() if path.is_file()}
    _replace_links(folder.masks, role, found)
    return len(found)


def _replace_links(folder: pathlib.Path, role: str, targets: Mapping[str, pathlib.Path]) -> None:
    remove(folder / role)
    (folder / role).mkdir(parents=True)
    for name, target in targets.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        # COLMAP's extraction accepts a link to nothing, but ends at a link to itself.
        path.symlink_to(target.resolve() if target.exists() else f"{path.name}.missing")


def contents(folder: Folder, names: Iterable[str]) -> dict[str, str]:
    """Returns hashes by name of what images and their masks hold."""
    return {name: fingerprint(content(folder.images / name), content(folder.masks / f"{name}.png")) for name in names}


def has_bad_mask(folder: Folder, name: str) -> bool:
    """True if an image has a mask that cannot be read."""
    mask = folder.masks / f"{name}.png"
    return mask.is_file() and photo_size(mask) is None


def check_size(folder: Folder, label: str, cameras: Mapping[str, Camera]) -> None:
    """Raises InputError if no image has the size of its camera; `label`: what gives the cameras, in the message."""
    if not is_installed("PIL"):
        return
    text = ""
    for name, camera in cameras.items():
        size = photo_size(folder.images / name)
        if size == (camera.width, camera.height):
            return
        if size is not None:
            is_for = f"{label} is for {camera.width} x {camera.height} pixels"
            text = text or f"{is_for}, but photo {name} is stored with {size[0]} x {size[1]}"
    if text:
        raise InputError(text)


def warn_left_out(folder: Folder, cameras: Mapping[str, Camera | None], names: Sequence[str]) -> None:
    """Names images that COLMAP could not use, because it only logs which, and why."""
    if not names:
        return
    causes = [f"{name} ({_cause(folder, name, cameras[name])})" for name in names[:MAX_NUM_NAMED]]
    more = f", and {len(names) - MAX_NUM_NAMED} others" if len(names) > MAX_NUM_NAMED else ""
    text = f"{len(names)} of {len(cameras)} photos are left out: {', '.join(causes)}{more} (log: {folder.log})"
    if len(names) == len(cameras):
        raise InputError(text)
    logger.warning("%s", text)


def _cause(folder: Folder, name: str, camera: Camera | None) -> str:
    size = photo_size(folder.images / name)
    if size is None:
        return "cannot be read"
    if camera is not None and size != (camera.width, camera.height):
        return f"has {size[0]} x {size[1]} pixels, its camera {camera.width} x {camera.height}"
    return "its mask cannot be read" if has_bad_mask(folder, name) else "COLMAP cannot use it"
