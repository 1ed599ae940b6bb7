"""Reads COLMAP models, text or binary, and lists of poses; poses keep every bit."""

from collections.abc import Sequence

import numpy as np

from colmap_lazyloc.model import Image, read_model
from colmap_lazyloc.pose_formats import table
from colmap_lazyloc.pose_formats.conventions import MAX_ROTATION_ERROR
from colmap_lazyloc.pose_formats.frames import Frame
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.pose_formats.posed_images import Source
from colmap_lazyloc.pose_formats.raw_poses import RawPose, RawPoses, each
from colmap_lazyloc.pose_formats.signatures import Head
from colmap_lazyloc.pose_formats.text import column_names, numbers
from colmap_lazyloc.text_files import read_entries


def parse(source: Source) -> RawPoses:
    model = read_model(source.path)

    def parse_image(image: Image) -> RawPose:
        camera = source.camera or model.cameras[image.camera_id]
        qvec, norm = image.pose.qvec, float(np.linalg.norm(image.pose.qvec))
        # As COLMAP, accepts quaternions of any length; units keep every bit.
        unit = qvec if abs(norm - 1) < MAX_ROTATION_ERROR else qvec / norm
        return RawPose(unit, image.pose.tvec, image.name, camera=camera)

    posed = [image for image in model.images.values() if image.cam_from_world is not None]
    poses = each(posed, parse_image, lambda image: image.name)
    return RawPoses(poses, Frame(origin=GeoOrigin.read(source.path)))


COLUMNS = ["qw", "qx", "qy", "qz", "tx", "ty", "tz"]  # after the name


def is_header_of_poses_txt(columns: Sequence[str]) -> bool:
    return list(columns[-7:]) == COLUMNS


def parse_poses(source: Source) -> RawPoses:
    """Reads poses.txt of this program and of hloc: lines `name qw qx qy qz tx ty tz`, whose names may have blanks.

    A header with other columns specifies what the columns are.
    """
    columns = Head(source.path).columns
    if columns and not is_header_of_poses_txt(columns):
        return table.parse(source)
    lines = [(number, line) for number, line in read_entries(source.path) if column_names(line) != columns]

    def parse_line(entry: tuple[int, str]) -> RawPose:
        name, *words = entry[1].rsplit(maxsplit=7)
        values = numbers(words, 7)
        return RawPose(values[:4], values[4:], name, camera=source.camera)

    return RawPoses(each(lines, parse_line, lambda entry: f"line {entry[0]}"))
