"""The formats by name, how a file's format is found, and one line about a bad file."""

import dataclasses
import math
import pathlib
from collections.abc import Callable

import numpy as np

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import CAMERA_MODELS, is_model
from colmap_lazyloc.pose_formats import (
    colmap,
    metashape,
    opensfm,
    reality_capture,
    table,
    trajectories,
    transforms_json,
)
from colmap_lazyloc.pose_formats.posed_images import MAX_ROTATION_ERROR, PosedImage, PosedImages, Source

HEAD_BYTES = 1 << 16
MAX_IMAGE_SIZE = 1 << 20  # pixels; more is a mistake


@dataclasses.dataclass(frozen=True)
class Format:
    """A format: what it is, and the function that reads it."""

    title: str
    read: Callable[[Source], PosedImages]


FORMATS = {
    "colmap": Format("COLMAP model", colmap.read),
    "transforms": Format("transforms.json of nerfstudio, instant-ngp or Polycam", transforms_json.read),
    "arkit": Format("table of ARKit poses", trajectories.read_arkit),
    "arcore": Format("table of ARCore poses", trajectories.read_arcore),
    "metashape": Format("XML file of Metashape's cameras", metashape.read),
    "realitycapture": Format("CSV file of RealityCapture's cameras", reality_capture.read),
    "opensfm": Format("reconstruction.json of OpenSfM or OpenDroneMap", opensfm.read),
    "tum": Format("trajectory of TUM's format", trajectories.read_tum),
    "kitti": Format("trajectory of KITTI's format", trajectories.read_kitti),
    "csv": Format("table of names, positions and rotations", table.read),
}


def read_posed_images(source: Source, format_name: str | None = None) -> PosedImages:
    """Reads a file of any format; each error is an InputError that names the file."""
    if not source.path.exists():
        raise InputError(f"{source.path}: does not exist")
    form = FORMATS[format_name or find_format(source.path)]
    try:
        posed = form.read(source)
        _check(posed)
    except KeyError as error:
        raise InputError(f"{source.path}: is not a {form.title}: it lacks {error}") from None
    except (ArithmeticError, AttributeError, IndexError, OSError, TypeError, ValueError) as error:
        text = str(error)
        if isinstance(error, InputError) and text.startswith((str(source.path), "--")):
            raise
        joint = "" if isinstance(error, InputError) else f"is not a {form.title}: "
        raise InputError(f"{source.path}: {joint}{text}") from None
    if not posed.images:
        where = f" is in {source.photos.folder}" if source.photos.folder else " has a pose"
        raise InputError(f"{source.path}: no photo that it names{where}")
    return posed


def find_format(path: pathlib.Path) -> str:
    """Returns the name of a file's format by its content."""
    if path.is_dir():
        if is_model(path):
            return "colmap"
        raise InputError(f"{path}: holds no COLMAP model (no images.bin or images.txt)")
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES).decode("utf-8", "replace")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    name = _format_of_text(path, head)
    if name is None:
        raise InputError(f"{path}: its format is not known; name it: {', '.join(FORMATS)}")
    return name


def _format_of_text(path: pathlib.Path, head: str) -> str | None:
    start = head.lstrip("\ufeff \t\r\n")
    if start.startswith(("{", "[")):
        return "opensfm" if start.startswith("[") else "transforms"
    if start.startswith("<"):
        return "metashape"
    if "heading" in start and "alt" in start and start.startswith("#"):
        return "realitycapture"
    if any(name in path.name.lower() for name in ("arkit", "arposes")):
        return "arkit"
    if "arcore" in path.name.lower():
        return "arcore"
    lines = [line for line in start.splitlines() if line.strip()]
    body = [line for line in lines if not line.startswith("#")]
    try:
        count = len([float(word) for word in body[0].split()]) if body else 0
    except ValueError:
        return "csv" if any(separator in lines[0] for separator in ",;\t") else None
    return {8: "tum", 12: "kitti"}.get(count)


def _check(posed: PosedImages) -> None:
    """Checks what all formats must give."""
    names = set()
    for image in posed.images:
        if image.name in names:
            raise InputError(f"two poses belong to '{image.name}'")
        names.add(image.name)
        if not image.name.isprintable() or not image.name:
            raise InputError(f"a photo has the name {image.name!r}")
        _check_image(image)


def _check_image(image: PosedImage) -> None:
    camera, pose = image.camera, image.cam_from_world
    num_params = dict(CAMERA_MODELS).get(camera.model)
    if num_params != len(camera.params):
        raise InputError(f"'{image.name}' has {len(camera.params)} parameters for the camera model {camera.model}")
    if not (0 < camera.width <= MAX_IMAGE_SIZE and 0 < camera.height <= MAX_IMAGE_SIZE):
        raise InputError(f"'{image.name}' has the size {camera.width} x {camera.height}")
    if not all(map(math.isfinite, camera.params)) or not camera.params[0] > 0:
        raise InputError(f"'{image.name}' has a focal length or a distortion that cannot be")
    if not np.all(np.isfinite([*pose.qvec, *pose.tvec])):
        raise InputError(f"'{image.name}' has a pose that is not finite")
    if abs(float(np.linalg.norm(pose.qvec)) - 1) > MAX_ROTATION_ERROR:
        raise InputError(f"'{image.name}' has a rotation that is not one")
