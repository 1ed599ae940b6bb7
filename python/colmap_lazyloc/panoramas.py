"""Cuts equirectangular panoramas into perspective faces: a rig of cameras that all stand at one point.

The axes of a panorama are those of COLMAP's camera model EQUIRECTANGULAR: x right, y down, z to the middle of the
picture. They are the axes of the rig, so that the pose of a rig's frame is that of its panorama.
"""

import dataclasses
import functools
import json
import math
import pathlib
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from colmap_lazyloc.array_types import Array, Floats
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.posed_images import (
    Photos,
    PosedImage,
    PosedImages,
    Source,
    decode_as_stored,
    list_images,
)
from colmap_lazyloc.pose_formats.registry import read_posed_images
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.progress import progress

FACES = {"front": (0, 0), "right": (90, 0), "back": (180, 0), "left": (270, 0), "up": (0, 90), "down": (0, -90)}
FIELD_OF_VIEW_DEG = 100.0  # overlaps, so that no object is cut at the borders of all faces
REFERENCE = "front"  # the face that has the rig's axes
PANORAMA = Camera("EQUIRECTANGULAR", 2, 1, (2.0, 1.0))
JPEG_QUALITY = 95
MARGIN = 4  # pixels that OpenCV interpolates beyond a border
MAX_WIDTH = 32000  # pixels; OpenCV cannot resample more


def rotation_of_angles(yaw_deg: float, pitch_deg: float) -> Floats:
    """Returns the rotation, from the rig, of a camera that looks to the right of the middle, and upwards."""
    yaw, pitch = math.radians(yaw_deg), math.radians(pitch_deg)
    right = np.array([math.cos(yaw), 0.0, -math.sin(yaw)])
    forward = np.array([math.cos(pitch) * math.sin(yaw), -math.sin(pitch), math.cos(pitch) * math.cos(yaw)])
    return np.stack([right, np.cross(forward, right), forward])


def face_camera(width: int) -> Camera:
    """Returns the camera of the faces of a panorama, with the panorama's resolution in the middle of each face."""
    half = math.tan(math.radians(FIELD_OF_VIEW_DEG) / 2)
    size = round(half * width / math.pi)
    focal = size / 2 / half
    return Camera("PINHOLE", size, size, (focal, focal, size / 2, size / 2))


def cut(panorama: Array) -> Iterator[tuple[str, Array]]:
    """Yields the faces of a panorama, each with its name."""
    import cv2

    width = panorama.shape[1]
    # Continues the picture beyond its left and right borders, which are neighbours.
    wide = cv2.copyMakeBorder(panorama, 0, 0, MARGIN, MARGIN, cv2.BORDER_WRAP)
    for face in FACES:
        columns, rows = _pixels_in_panorama(face, width)
        yield face, cv2.remap(wide, columns + MARGIN, rows, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE)


@functools.lru_cache(maxsize=len(FACES))
def _pixels_in_panorama(face: str, width: int) -> tuple[Array, Array]:
    """Returns the columns and rows in the panorama of a face's pixels, counted from the centre of the first pixel."""
    camera = face_camera(width)
    axis = (np.arange(camera.width) + 0.5 - camera.width / 2) / camera.params[0]
    x, y = np.meshgrid(axis, axis)
    x, y, z = np.moveaxis(np.stack([x, y, np.ones_like(x)], axis=-1) @ rotation_of_angles(*FACES[face]), 2, 0)
    columns = (np.arctan2(x, z) / (2 * np.pi) + 0.5) * width - 0.5
    rows = (np.arctan2(y, np.hypot(x, z)) / np.pi + 0.5) * (width / 2) - 0.5
    return columns.astype(np.float32), rows.astype(np.float32)


def list_panoramas(source: pathlib.Path) -> dict[str, pathlib.Path]:
    """Returns the paths by name of the panoramas in a folder, or of a single one."""
    paths = {source.name: source} if source.is_file() else {name: source / name for name in list_images(source)}
    if not paths:
        raise InputError(f"{source}: holds no image file")
    return paths


def find_widths(paths: Mapping[str, pathlib.Path]) -> dict[str, int]:
    """Returns the widths of panoramas by name."""
    widths = {}
    for name, path in paths.items():
        width, height = Photos(path.parent).size(path.name)
        if width != 2 * height or width > MAX_WIDTH:
            raise InputError(
                f"{path}: has {width} x {height} pixels; an equirectangular panorama is twice as wide as high, and at "
                f"most {MAX_WIDTH} pixels wide"
            )
        widths[name] = width
    return widths


def write_faces(paths: Mapping[str, pathlib.Path], output: pathlib.Path) -> None:
    """Writes the faces of panoramas, each in the folder of its name."""
    import cv2

    for name, path in progress(paths.items(), "panoramas"):
        panorama = decode_as_stored(np.fromfile(path, np.uint8), cv2.IMREAD_COLOR)
        if panorama is None:
            raise InputError(f"{path}: is not a photo that can be read")
        for face, pixels in cut(panorama):
            face_path = output / face / name
            face_path.parent.mkdir(parents=True, exist_ok=True)
            # COLMAP recognizes the format by the content: what OpenCV cannot write becomes JPEG.
            suffix = path.suffix if cv2.haveImageWriter(f"face{path.suffix}") else ".jpg"
            face_path.write_bytes(cv2.imencode(suffix, pixels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes())


def face_cameras(widths: Mapping[str, int]) -> dict[str, Camera]:
    """Returns the cameras of the faces of panoramas by name."""
    return {f"{face}/{name}": face_camera(width) for face in FACES for name, width in widths.items()}


def face_from_rig(face: str) -> Pose:
    """Returns the pose of a face in its panorama."""
    return Pose.from_matrix(rotation_of_angles(*FACES[face]), np.zeros(3))


def read_face_poses(source: Source, widths: Mapping[str, int], format_name: str | None) -> PosedImages:
    """Reads the poses of panoramas; returns those of their faces."""
    if source.camera is not None:
        raise InputError("--camera: panoramas have no intrinsics but their size")
    posed = read_posed_images(dataclasses.replace(source, camera=PANORAMA), format_name)
    images = []
    for image in posed.images:
        if image.name not in widths:  # a panorama that cannot be read
            continue
        pose, camera = image.cam_from_world, face_camera(widths[image.name])
        for face in FACES:
            images.append(PosedImage(f"{face}/{image.name}", camera, face_from_rig(face) @ pose))
    return dataclasses.replace(posed, images=images)


def write_rig(path: pathlib.Path, folders: Sequence[str] = ("",)) -> None:
    """Writes the rig of the faces in each of the folders, in the format of COLMAP's rig_configurator."""
    rigs = []
    for folder in folders:
        cameras = []
        for face in FACES:
            camera: dict[str, object] = {"image_prefix": f"{folder}{face}/"}
            if face == REFERENCE:
                camera["ref_sensor"] = True
            else:
                pose = face_from_rig(face)
                camera["cam_from_rig_rotation"] = pose.qvec.tolist()
                camera["cam_from_rig_translation"] = pose.tvec.tolist()
            cameras.append(camera)
        rigs.append({"cameras": cameras})
    path.write_text(json.dumps(rigs, indent=1) + "\n")
