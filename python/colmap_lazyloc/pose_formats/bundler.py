"""Reads lists of cameras of Bundler, VisualSFM and Cambridge Landmarks."""

import dataclasses
import functools
import re
from collections.abc import Sequence

import numpy as np

from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.cameras import MAX_ROUNDING, SizeOfPhoto, brown_camera
from colmap_lazyloc.pose_formats.naming import clean
from colmap_lazyloc.pose_formats.posed_images import Source
from colmap_lazyloc.pose_formats.raw_poses import RawPose, RawPoses, each
from colmap_lazyloc.pose_formats.text import numbers
from colmap_lazyloc.text_files import read_entries

CAMBRIDGE = "dataset_train.txt"
_OF_LIST = re.compile(r" 0( [-+.\d]+)?$")  # behind a name that may have blanks: a zero, and the focal length of EXIF


def parse(source: Source) -> RawPoses:
    """Reads bundle.out with the names of its list.txt: focal length, k1, k2, rotation and translation of each."""
    lists = [source.path.with_name(name) for name in ("list.txt", f"{source.path.stem}.list.txt")]
    path = next((path for path in lists if path.is_file()), None)
    if path is None:
        raise InputError(f"{source.path}: list.txt with the names of its photos must be beside it")
    names = [_OF_LIST.sub("", line) for _, line in read_entries(path)]
    lines = [line for _, line in read_entries(source.path)]
    count, num_points = (int(word) for word in lines[0].split())
    if count != len(names):
        raise InputError(f"{source.path}: has {count} cameras, but {path} has {len(names)} names")
    num_lines = 1 + 5 * count + 3 * num_points
    if len(lines) not in (num_lines, 1 + 5 * count):  # then lines may be those of other cameras
        raise InputError(f"{source.path}: has {len(lines)} lines instead of {num_lines}: it is damaged")

    def parse_camera(index: int) -> RawPose:
        (focal, k1, k2), *rows = (numbers(line, 3) for line in lines[1 + 5 * index : 6 + 5 * index])
        if focal == 0:
            raise ValueError("it is not registered")
        camera = functools.partial(_camera, (focal, focal), (k1, k2))
        return RawPose(rows[:3], rows[3], names[index], camera=camera)

    return RawPoses(each(range(count), parse_camera, lambda index: names[index]))


def parse_nvm(source: Source) -> RawPoses:
    """Reads a model of VisualSFM: name, focal length, quaternion, centre, and a coefficient of each camera."""
    head, *lines = (line for _, line in read_entries(source.path))
    kind, *words = head.split()
    if kind != "NVM_V3" or words[:1] not in ([], ["FixedK"]):
        raise ValueError(f"it begins with '{head[:60]}' instead of NVM_V3 or NVM_V3 FixedK fx cx fy cy r")
    fixed = numbers(words[1:], 5) if words else None
    given = []

    def parse_camera(line: str) -> RawPose:
        name, *values = line.rsplit(maxsplit=10)
        focal, w, x, y, z, *centre, r, _ = numbers(values, 10)
        given.append((focal, r))
        fx, cx, fy, cy, r = fixed or (focal, None, focal, None, r)
        camera = functools.partial(_camera_of_visual_sfm, (fx, fy), (cx, cy), r)
        # VisualSFM writes quotes for blanks in names.
        return RawPose((w, x, y, z), centre, name.replace('"', " "), camera=camera)

    count = int(lines[0])
    _warn_of_more_models(source, lines[1 + count :])
    poses = each(lines[1 : 1 + count], parse_camera, lambda line: line.split()[0])
    if source.camera is None:
        _report_intrinsics(source, fixed, given)
    return RawPoses(poses)


def _report_intrinsics(source: Source, fixed: Sequence[float] | None, given: Sequence[tuple[float, float]]) -> None:
    """Says where principal points come from, and counts the cameras whose own focal length and distortion, `given`, are
    not used."""
    if fixed is None:
        logger.info("%s: has no FixedK: principal points are taken to be in the middle of the photos", source.path)
        return
    own = np.reshape(given, (-1, 2))
    # VisualSFM also writes 0 for a distortion that FixedK has.
    is_used = (np.isclose(own, (fixed[0], fixed[4]), MAX_ROUNDING, 1e-6) | (own == 0)).all(axis=1)
    if not is_used.all():
        text = "%s: focal length and distortion of %d of %d cameras are not used, because they contradict FixedK"
        logger.warning(text, source.path, np.sum(~is_used), len(own))


def _warn_of_more_models(source: Source, lines: Sequence[str]) -> None:
    """Counts the photos of further models, whose coordinates are their own. `lines`: those behind the first cameras."""
    num_points = int(lines[0]) if lines[:1] and lines[0].isdecimal() else 0
    more = lines[1 + num_points : 2 + num_points]
    if more and more[0].isdecimal() and int(more[0]) > 0:
        logger.warning("%s: %s photos of another model are left out: only the first is read", source.path, more[0])


def parse_cambridge(source: Source) -> RawPoses:
    """Reads dataset_train.txt: lines with name, centre and quaternion, after three lines of a head.

    The intrinsics are those of reconstruction.nvm, which has other endings of names.
    """
    path = source.path / CAMBRIDGE if source.path.is_dir() else source.path
    model = path.with_name("reconstruction.nvm")
    has_model = source.camera is None and model.is_file()
    poses = parse_nvm(dataclasses.replace(source, path=model)).poses if has_model else []
    cameras = {_stem(pose.name): pose.camera for pose in poses if isinstance(pose, RawPose) and pose.name}

    def parse_line(line: str) -> RawPose:
        name, *words = line.rsplit(maxsplit=7)
        values = numbers(words, 7)
        return RawPose(values[3:], values[:3], name, camera=cameras.get(_stem(name)))

    lines = [line for _, line in read_entries(path)][2:]
    return RawPoses(each(lines, parse_line, lambda line: line.split()[0]))


def _stem(name: str) -> str:
    return clean(name).rpartition(".")[0]


def _camera(focal: tuple[float, float], radial: Sequence[float], size_of_photo: SizeOfPhoto) -> Camera:
    size = size_of_photo()
    return brown_camera(size, focal, (size[0] / 2, size[1] / 2), tuple(radial))


def _camera_of_visual_sfm(
    focal: tuple[float, float], centre: tuple[float | None, float | None], r: float, size_of_photo: SizeOfPhoto
) -> Camera:
    """Returns a camera whose distortion undistorts: x_undistorted = x (1 + r |x|^2). Its inverse is a series in r."""
    size = size_of_photo()
    cx, cy = (length / 2 if value is None else value for value, length in zip(centre, size))
    return brown_camera(size, focal, (cx, cy), (-r, 3 * r**2, -12 * r**3))
