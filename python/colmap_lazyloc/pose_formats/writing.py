"""Makes of posed images the poses that a format writes: the opposite of assembly. Names what a format cannot hold."""

import dataclasses
import enum
import pathlib
import re
from collections.abc import Callable, Mapping, Sequence

from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.assembly import some_of
from colmap_lazyloc.pose_formats.cameras import coefficients
from colmap_lazyloc.pose_formats.conventions import Convention, written
from colmap_lazyloc.pose_formats.frames import GEOGRAPHIC, NO_FRAME, Frame, Similarity, apply
from colmap_lazyloc.pose_formats.geo import FILE_NAME, GeoOrigin
from colmap_lazyloc.pose_formats.posed_images import PosedImage, PosedImages
from colmap_lazyloc.pose_formats.raw_poses import RawPose, RawPoses

SECOND_FOCAL_LENGTH = "fy"  # in Writer.cameras: may differ from the first


class World(enum.Enum):
    """Where the coordinates of a written file are."""

    MODEL = enum.auto()  # those of the model
    LOCAL = enum.auto()  # those of the model, with the place of its origin on the Earth
    GRID = enum.auto()  # those of a reference system if one is given, or else of the model
    EARTH = enum.auto()  # longitude, latitude, height


@dataclasses.dataclass(frozen=True)
class Writer:
    """How a format is written.

    `write`: writes poses, as the file has them, to a path, which does not exist. `omits`: what the format has no place
    for, beside covariances. `cameras`: by the kind of a camera, the coefficients that it may have; None if the format
    has all intrinsics, or none. `needs_camera`: a photo without intrinsics is left out. `holds_name`: true for the
    name of a photo that the format can hold. `folder`: of a folder, the pattern of the names of its files.
    `needs_covariances`: the format has these, and a photo without one is left out.
    """

    write: Callable[[pathlib.Path, RawPoses], None]
    world: World = World.MODEL
    omits: str = ""
    cameras: Mapping[str, str] | None = None
    needs_camera: bool = False
    holds_name: Callable[[str], bool] = str.isprintable
    folder: str | None = None
    needs_covariances: bool = False


@dataclasses.dataclass(frozen=True)
class Target:
    """What is specified for a file beside its format: a reference system, and a transform from the file's world to that
    of the model."""

    crs: str | None = None
    similarity: Similarity | None = None


NO_TARGET = Target()


def file_of(text: Callable[[RawPoses], str]) -> Callable[[pathlib.Path, RawPoses], None]:
    """Returns the function that writes a file with a text."""

    def write(path: pathlib.Path, raw: RawPoses) -> None:
        path.write_text(text(raw), encoding="utf-8", newline="")

    return write


def raw_poses(posed: PosedImages, convention: Convention, writer: Writer, target: Target = NO_TARGET) -> RawPoses:
    """Returns the poses as a file of this convention has them, sorted by name. Names what is left out."""
    frame = _frame(writer.world, posed.origin, target)
    images = _certain(_writable(posed.images, writer), writer)
    poses = frame.from_local([image.cam_from_world for image in images], posed.origin)
    if target.similarity is not None:
        to_file = target.similarity.inverse()
        poses = [apply(to_file, pose) for pose in poses]
    if frame.is_in_degrees:
        convention = dataclasses.replace(convention, vector="degrees")
    items = [
        RawPose(
            *written(pose, convention),
            image.name,
            camera=camera,
            similarity=target.similarity,
            result=image.result,
            field_of_view=image.field_of_view,
        )
        for image, pose, camera in zip(images, poses, _cameras(images, writer))
        if camera is not None or not writer.needs_camera
    ]
    return RawPoses(items, frame)


def check_path(path: pathlib.Path, writer: Writer, overwrites: bool) -> None:
    """Checks early that a file or folder can be written; a folder is replaced only if it holds nothing else."""
    if not path.absolute().parent.is_dir():
        raise InputError(f"--output {path}: its folder does not exist")
    if not path.exists():
        return
    if not overwrites:
        raise InputError(f"--output {path}: exists; --overwrite replaces it")
    if path.is_dir() != (writer.folder is not None):
        raise InputError(f"--output {path}: is {'a folder' if path.is_dir() else 'a file'} and would be replaced")
    files = sorted(file for file in path.rglob("*") if not file.is_dir())
    other = next((file for file in files if not re.fullmatch(writer.folder or "", file.name)), None)
    if other is not None:
        raise InputError(f"--output {path}: would be replaced, but holds something else: {other.name}")


def describe_omitted(posed: PosedImages, writer: Writer, target: Target) -> str:
    """Returns what the format has no place for, as a list."""
    is_placed = posed.origin is None or writer.world in (World.LOCAL, World.EARTH) or target.crs is not None
    place = "" if is_placed else f"the place on the Earth ({FILE_NAME})"
    covariances = "" if writer.needs_covariances else "covariances"
    return ", ".join(text for text in (writer.omits, place, covariances) if text)


def _frame(world: World, origin: GeoOrigin | None, target: Target) -> Frame:
    """Returns the frame of a file, whose reference system is used or refused."""
    if target.crs is not None and world is not World.GRID:
        raise InputError(f"--crs {target.crs}: has no effect with this format")
    if origin is None and (world is World.EARTH or target.crs is not None):
        raise InputError(f"the model has no {FILE_NAME}, so that it is not known where on the Earth its poses are")
    if world is World.EARTH:
        return Frame(GEOGRAPHIC)
    if target.crs is not None:
        return Frame(target.crs, true_north=True)
    return Frame(origin=origin) if world is World.LOCAL else NO_FRAME


def _writable(images: Sequence[PosedImage], writer: Writer) -> list[PosedImage]:
    """Returns the images whose names a file can hold, sorted by name."""
    bad = [image for image in images if not writer.holds_name(image.name)]
    if bad:
        names = some_of([repr(image.name) for image in bad])
        logger.warning(
            "%d of %d photos left out, because the format cannot hold their names: %s", len(bad), len(images), names
        )
    return sorted((image for image in images if writer.holds_name(image.name)), key=lambda image: image.name)


def _certain(images: list[PosedImage], writer: Writer) -> list[PosedImage]:
    """Returns the images with a covariance, if a format needs one."""
    if not writer.needs_covariances:
        return images
    certain = [image for image in images if image.result and image.result.get("pose_covariance_in_map") is not None]
    if len(certain) < len(images):
        logger.warning(
            "%d of %d photos left out, because their covariances are not known", len(images) - len(certain), len(images)
        )
    return certain


def _cameras(images: Sequence[PosedImage], writer: Writer) -> list[Camera | None]:
    """Returns the cameras of images; None for those that a format cannot hold exactly."""
    if writer.cameras is None:
        return [image.camera for image in images]
    holds = {camera: _holds(writer.cameras, camera) for camera in {image.camera for image in images}}
    bad = [image for image in images if not holds[image.camera]]
    if bad:
        models = ", ".join(sorted({image.camera.model for image in bad}))
        what = "" if writer.needs_camera else "intrinsics of "
        logger.warning(
            "%s%d of %d photos left out, because the format cannot hold their cameras: %s",
            what,
            len(bad),
            len(images),
            models,
        )
    return [image.camera if holds[image.camera] else None for image in images]


def _holds(kinds: Mapping[str, str], camera: Camera) -> bool:
    kind, values = coefficients(camera)
    needed = set(values) - {"fx", "fy", "cx", "cy"}
    if values.get("fx") != values.get("fy"):
        needed.add(SECOND_FOCAL_LENGTH)
    return kind in kinds and needed <= set(kinds[kind].split())
