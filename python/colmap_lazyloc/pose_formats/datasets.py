"""Reads the folders of datasets for localization: 7 Scenes, 12 Scenes, ScanNet, ARKitScenes.

Of a dataset with a split, the images for training are read, because the others are its queries.
"""

import functools
import pathlib
import re
from collections.abc import Iterable, Mapping

import numpy as np

from colmap_lazyloc.array_types import Floats
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.cameras import SizeOfPhoto, brown_camera, check_camera
from colmap_lazyloc.pose_formats.naming import last_number
from colmap_lazyloc.pose_formats.posed_images import Source
from colmap_lazyloc.pose_formats.raw_poses import RawPose, RawPoses, each, each_named, matrix_parts
from colmap_lazyloc.pose_formats.signatures import Head
from colmap_lazyloc.pose_formats.text import numbers, read_numbers
from colmap_lazyloc.text_files import read_entries, read_lines

# The Kinect's nominal focal length, with which results on 7 Scenes are published.
KINECT = Camera("SIMPLE_PINHOLE", 640, 480, (525.0, 320.0, 240.0))
POSE, TRAINING = ".pose.txt", "TrainSplit.txt"
SCANNET_INTRINSICS = "intrinsic/intrinsic_color.txt"
EXTRINSICS = "m_calibrationColorExtrinsic"  # of 12 Scenes
SCANNET_EXTRINSICS = "intrinsic/extrinsic_color.txt"
MAX_EXTRINSIC = 1e-4  # of an element that is taken for 0 or 1
TRAJECTORY = "lowres_wide.traj"


def is_seven_scenes(head: Head) -> bool:
    return head.is_folder and any(head.path.glob(f"seq-*/frame-*{POSE}"))


def parse_seven_scenes(source: Source) -> RawPoses:
    """Reads the sequences for training of a scene, or all if it has no split."""
    split = source.path / TRAINING
    folders = (
        [source.path / name for name in read_split(split)] if split.is_file() else sorted(source.path.glob("seq-*"))
    )
    paths = [path for folder in folders for path in sorted(folder.glob(f"frame-*{POSE}"))]
    if not paths:
        raise InputError(
            f"{source.path}: has no poses of {', '.join(folder.name for folder in folders)}: unpack their zips"
        )
    return _frames(source, paths, ".color.png", KINECT)


def read_split(path: pathlib.Path) -> list[str]:
    """Reads the folders of the sequences: `sequence1` is seq-01."""
    sequences = []
    for _, line in read_entries(path):
        match = re.fullmatch(r"sequence(\d+)", line)
        if not match:
            raise InputError(f"{path}: expected `sequence<number>`, found '{line[:60]}'")
        sequences.append(f"seq-{int(match[1]):02}")
    return sequences


def is_twelve_scenes(head: Head) -> bool:
    return head.is_folder and (head.path / "info.txt").is_file() and any((head.path / "data").glob(f"*{POSE}"))


def parse_twelve_scenes(source: Source) -> RawPoses:
    """Reads a scene without its first sequence, which is for testing."""
    info = dict(re.findall(r"(\w+) *= *(.*)", "\n".join(read_lines(source.path / "info.txt"))))
    size = int(info["m_colorWidth"]), int(info["m_colorHeight"])
    camera = _camera_of_matrix(numbers(info["m_calibrationColorIntrinsic"], 16), lambda: size)
    if EXTRINSICS in info:
        _require_identity(source.path / "info.txt", EXTRINSICS, numbers(info[EXTRINSICS], 16))
    paths = sorted((source.path / "data").glob(f"frame-*{POSE}"))
    split = source.path / "split.txt"
    if split.is_file():
        first = re.search(r"start=(\d+) *; *end=(\d+)", " ".join(read_lines(split)[:1]))
        if first is None:
            raise InputError(f"{split}: its first line has no `start=... ; end=...`")
        begin, end = int(first[1]), int(first[2])
        paths = [path for path in paths if not begin <= _number(path) <= end]
    return _frames(source, paths, ".color.jpg", camera)


def _number(path: pathlib.Path) -> int:
    return int(last_number(path.name) or -1)


def _frames(source: Source, paths: Iterable[pathlib.Path], ending: str, camera: Camera) -> RawPoses:
    """Reads files NAME.pose.txt with a matrix, beside the photos."""

    def parse_frame(path: pathlib.Path) -> RawPose:
        name = path.relative_to(source.path).as_posix().removesuffix(POSE) + ending
        return RawPose(*_matrix(path), name, camera=camera)

    return RawPoses(each(paths, parse_frame, lambda path: path.name))


def is_scannet(head: Head) -> bool:
    return head.is_folder and (head.path / SCANNET_INTRINSICS).is_file()


def parse_scannet(source: Source) -> RawPoses:
    """Reads what ScanNet's reader exports: pose/17.txt and intrinsic/, beside color/17.jpg."""
    camera = functools.partial(_camera_of_matrix, read_numbers(source.path / SCANNET_INTRINSICS, 16))
    extrinsics = source.path / SCANNET_EXTRINSICS
    if extrinsics.is_file():
        _require_identity(extrinsics, "it", read_numbers(extrinsics, 16))

    def parse_pose(path: pathlib.Path) -> RawPose:
        return RawPose(*_matrix(path), f"color/{path.stem}.jpg", camera=camera)

    paths = sorted((source.path / "pose").glob("*.txt"), key=_number)
    return RawPoses(each(paths, parse_pose, lambda path: path.name))


def is_arkit_scenes(head: Head) -> bool:
    return (head.path / TRAJECTORY).is_file() if head.is_folder else head.name.endswith(".traj")


def parse_arkit_scenes(source: Source) -> RawPoses:
    """Reads the trajectory of a video, and the intrinsics of its photos from files `NAME_time.pincam`.

    A photo takes the intrinsics that are nearest in time to its pose, of the images of its size.
    """
    path = source.path / TRAJECTORY if source.path.is_dir() else source.path
    cameras = {} if source.camera is not None else _read_pincams(path.parent)

    def parse_line(line: tuple[int, str]) -> RawPose:
        time, *values = numbers(line[1], 7)
        camera = functools.partial(_nearest_camera, cameras, time) if cameras else None
        return RawPose(values[:3], values[3:], time=time, camera=camera)

    return RawPoses(each(read_entries(path), parse_line, lambda line: f"line {line[0]}"))


def _read_pincams(folder: pathlib.Path) -> Mapping[tuple[int, int], list[tuple[float, Camera]]]:
    """Returns the intrinsics in `..._intrinsics` with their times, by the size of the images."""
    found: dict[tuple[int, int], list[tuple[float, Camera]]] = {}

    def add(path: pathlib.Path) -> None:
        width, height, *pinhole = read_numbers(path, 6)
        camera = Camera("PINHOLE", int(width), int(height), tuple(pinhole))
        check_camera(camera)
        found.setdefault((camera.width, camera.height), []).append((float(path.stem.rpartition("_")[2]), camera))

    each_named(folder, sorted(folder.glob("*_intrinsics/*.pincam")), add, lambda path: path.name)
    return found


def _nearest_camera(
    cameras: Mapping[tuple[int, int], list[tuple[float, Camera]]], time: float, size_of_photo: SizeOfPhoto
) -> Camera:
    size = size_of_photo()
    if size not in cameras:
        raise ValueError(f"there are no intrinsics for {size[0]} x {size[1]} pixels: give them as --camera")
    return min(cameras[size], key=lambda item: abs(item[0] - time))[1]


def _matrix(path: pathlib.Path) -> tuple[Floats, Floats]:
    return matrix_parts(read_numbers(path, 16))


def _require_identity(path: pathlib.Path, title: str, matrix: list[float]) -> None:
    """Refuses a colour camera that is not where the poses are."""
    if not np.allclose(matrix, np.eye(4).ravel(), atol=MAX_EXTRINSIC):
        raise InputError(
            f"{path}: {title} moves the colour camera against the poses, and does not say in which direction: give "
            "the colour camera's own poses, with the identity there"
        )


def _camera_of_matrix(values: list[float], size_of_photo: SizeOfPhoto) -> Camera:
    """Returns the camera of a 4 x 4 matrix of intrinsics, for images of the size that it is for."""
    return brown_camera(size_of_photo(), (values[0], values[5]), (values[2], values[6]))
