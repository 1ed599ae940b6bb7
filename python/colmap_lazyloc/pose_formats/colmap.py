"""Reads and writes COLMAP models, text or binary, and lists of poses; poses keep every bit."""

import pathlib
import re
from collections.abc import Sequence

import numpy as np

from colmap_lazyloc.model import Camera, Image, read_model, write_model
from colmap_lazyloc.pose_formats import table
from colmap_lazyloc.pose_formats.conventions import MAX_ROTATION_ERROR
from colmap_lazyloc.pose_formats.frames import Frame
from colmap_lazyloc.pose_formats.geo import FILE_NAME, GeoOrigin
from colmap_lazyloc.pose_formats.posed_images import PosedImage, PosedImages, Source
from colmap_lazyloc.pose_formats.raw_poses import RawPose, RawPoses, each
from colmap_lazyloc.pose_formats.signatures import Head
from colmap_lazyloc.pose_formats.text import column_names, numbers
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.text_files import read_entries

MODEL_FILES = ("cameras", "images", "points3D", "rigs", "frames")
FILES = rf"({'|'.join(MODEL_FILES)})\.(txt|bin)|{re.escape(FILE_NAME)}"


def parse(source: Source) -> RawPoses:
    model = read_model(source.path)

    def parse_image(image: Image) -> RawPose:
        qvec, norm = image.pose.qvec, float(np.linalg.norm(image.pose.qvec))
        # As COLMAP, accepts quaternions of any length; units keep every bit.
        unit = qvec if abs(norm - 1) < MAX_ROTATION_ERROR else qvec / norm
        return RawPose(unit, image.pose.tvec, image.name, camera=model.cameras[image.camera_id])

    posed = [image for image in model.images.values() if image.cam_from_world is not None]
    poses = each(posed, parse_image, lambda image: image.name)
    return RawPoses(poses, Frame(origin=GeoOrigin.read(source.path)))


def write(path: pathlib.Path, raw: RawPoses) -> None:
    """Writes a model of poses that have COLMAP's convention."""
    images = [
        PosedImage(pose.name, pose.camera, Pose(pose.rotation, pose.vector))
        for pose in raw.written
        if pose.name is not None and isinstance(pose.camera, Camera)
    ]
    write_posed_images(path, PosedImages(images, raw.frame.origin))


def write_posed_images(folder: pathlib.Path, posed: PosedImages, binary: bool = False) -> None:
    """Writes a COLMAP model, with a camera for each set of intrinsics; replaces an earlier model in the folder."""
    images = sorted(posed.images, key=lambda image: image.name)
    camera_ids: dict[Camera, int] = {}
    for image in images:
        camera_ids.setdefault(image.camera, len(camera_ids) + 1)
    for name in MODEL_FILES:
        for suffix in (".bin", ".txt"):
            (folder / (name + suffix)).unlink(missing_ok=True)
    (folder / FILE_NAME).unlink(missing_ok=True)
    records = [
        Image(image.name, camera_ids[image.camera], image.cam_from_world, image_id)
        for image_id, image in enumerate(images, start=1)
    ]
    write_model(folder, {camera_id: camera for camera, camera_id in camera_ids.items()}, records, binary)
    if posed.origin is not None:
        posed.origin.write(folder)


COLUMNS = ["qw", "qx", "qy", "qz", "tx", "ty", "tz"]  # after the name


def is_header_of_poses_txt(columns: Sequence[str]) -> bool:
    return list(columns[-7:]) == COLUMNS


def parse_poses(source: Source) -> RawPoses:
    """Reads poses.txt of this program and of hloc: lines `name qw qx qy qz tx ty tz`, whose names may contain spaces.

    A header with other columns specifies what the columns are.
    """
    columns = Head(source.path).columns
    if columns and not is_header_of_poses_txt(columns):
        return table.parse(source)
    lines = [(number, line) for number, line in read_entries(source.path) if column_names(line) != columns]

    def parse_line(entry: tuple[int, str]) -> RawPose:
        name, *words = entry[1].rsplit(maxsplit=7)
        values = numbers(words, 7)
        return RawPose(values[:4], values[4:], name)

    return RawPoses(each(lines, parse_line, lambda entry: f"line {entry[0]}"))
