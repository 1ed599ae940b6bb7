"""Reads and writes cameras and poses of COLMAP models, text and binary."""

import dataclasses
import difflib
import math
import mmap
import os
import pathlib
import struct
from collections.abc import Iterable, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.poses import Pose, PosedLike, PoseLike, find_pose
from colmap_lazyloc.text_files import Path, parse_numbers

# COLMAP's camera models in the order of their ids: name and number of parameters.
CAMERA_MODELS = (
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    ("SIMPLE_DIVISION", 4),
    ("DIVISION", 5),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
    ("EUCM", 6),
    ("EQUIRECTANGULAR", 2),
)
CAMERA_MODEL_IDS = {name: model_id for model_id, (name, _) in enumerate(CAMERA_MODELS)}
POINT2D = np.dtype([("x", "<f8"), ("y", "<f8"), ("point3d_id", "<i8")])
NO_POINTS = np.empty(0, POINT2D)


def num_focal_lengths(model: str) -> int:
    """Returns how many parameters of a camera model, its first ones, are focal lengths; of EQUIRECTANGULAR, these are
    width and height."""
    return 1 if model.startswith(("SIMPLE_", "RADIAL")) else 2


class CameraLike(Protocol):
    """The attributes of pycolmap.Camera that are read: the model is a name, or has one."""

    @property
    def model(self) -> Any: ...

    @property
    def width(self) -> int: ...

    @property
    def height(self) -> int: ...

    @property
    def params(self) -> Iterable[float]: ...


class ImageLike(PosedLike, Protocol):
    """The attributes of pycolmap.Image that are read."""

    @property
    def name(self) -> str: ...

    @property
    def camera_id(self) -> int: ...


class ReconstructionLike(Protocol):
    """The attributes of pycolmap.Reconstruction that are read: both are by id."""

    @property
    def cameras(self) -> Mapping[int, CameraLike]: ...

    @property
    def images(self) -> Mapping[int, ImageLike]: ...


@dataclasses.dataclass(frozen=True)
class Camera:
    """Intrinsics: COLMAP's camera model and parameters, and the image size in pixels."""

    model: str
    width: int
    height: int
    params: tuple[float, ...]

    @staticmethod
    def of(camera: CameraLike) -> "Camera":
        """Returns the intrinsics of a pycolmap.Camera; a Camera is returned unchanged."""
        if isinstance(camera, Camera):
            return camera
        model = getattr(camera.model, "name", camera.model)
        return Camera(str(model), int(camera.width), int(camera.height), tuple(map(float, camera.params)))

    def text(self) -> str:
        """Returns the text `MODEL width height params...`, with enough digits for `parse` to read exactly the same
        numbers."""
        return " ".join([self.model, str(self.width), str(self.height), *(repr(float(param)) for param in self.params)])

    @staticmethod
    def parse(path: Path, text: str) -> "Camera":
        """Parses a text `MODEL width height params...`, the output of the method `text`. Error messages name `path`."""
        words = text.split(maxsplit=3)
        if len(words) < 4 or not (words[1].isdecimal() and words[2].isdecimal()):
            raise InputError(f"{path}: expected `MODEL width height params...`, found '{text}'")
        camera = Camera(words[0], int(words[1]), int(words[2]), tuple(parse_numbers(path, words[3])))
        if problem := camera._problem():
            raise InputError(f"{path}: {problem}")
        return camera

    def _problem(self) -> str:
        """Returns why this is no camera, empty if it is one."""
        if self.model not in CAMERA_MODEL_IDS:
            near = difflib.get_close_matches(self.model.upper(), CAMERA_MODEL_IDS, 1)
            return f"unknown camera model '{self.model}'; " + (
                f"the nearest is {near[0]}" if near else f"expected one of {', '.join(CAMERA_MODEL_IDS)}"
            )
        num_params = CAMERA_MODELS[CAMERA_MODEL_IDS[self.model]][1]
        if len(self.params) != num_params:
            return f"camera model {self.model} takes {num_params} parameters, not {len(self.params)}"
        if not all(map(math.isfinite, self.params)):
            return "a camera parameter is not a finite number"
        if self.width == 0 or self.height == 0:
            return f"expected an image size in pixels, found {self.width} x {self.height}"
        focal_lengths = self.params[: num_focal_lengths(self.model)]
        if min(focal_lengths) <= 0:
            return f"expected a positive focal length, found {min(focal_lengths):g}"
        return ""


@dataclasses.dataclass(frozen=True, eq=False)
class Image:
    """An image of a model. cam_from_world may be None, for example for a query that is not localized."""

    name: str
    camera_id: int
    cam_from_world: Pose | None
    image_id: int = 0
    points2d: NDArray[np.void] = dataclasses.field(default_factory=NO_POINTS.copy)  # rows x, y, point3d_id

    @property
    def pose(self) -> Pose:
        """Returns cam_from_world of an image that has a pose."""
        if self.cam_from_world is None:
            raise InputError(f"image '{self.name}' has no pose")
        return self.cam_from_world


@dataclasses.dataclass(frozen=True)
class Model:
    """The cameras of a model by id, and its images by name."""

    cameras: dict[int, Camera]
    images: dict[str, Image]

    @staticmethod
    def of(model: "ModelLike") -> "Model":
        """Returns the cameras and the posed images of a pycolmap.Reconstruction; a Model is returned unchanged."""
        if isinstance(model, Model):
            return model
        images = {}
        for image_id, image in model.images.items():
            pose = find_pose(image)
            if pose is not None:
                images[image.name] = Image(image.name, int(image.camera_id), pose, int(image_id))
        return Model({int(camera_id): Camera.of(camera) for camera_id, camera in model.cameras.items()}, images)


ModelLike = Model | ReconstructionLike  # a Model or a pycolmap.Reconstruction


def is_reconstruction(value: object) -> bool:
    """True for a Model and for a pycolmap.Reconstruction, which have cameras and images."""
    return hasattr(value, "cameras") and hasattr(value, "images")


def poses_of(poses: ModelLike | Mapping[str, PoseLike]) -> dict[str, Pose]:
    """Returns {image name: pose} with all poses of a model, of a pycolmap.Reconstruction or of a dict."""
    if isinstance(poses, Mapping):
        return {name: Pose.of(pose) for name, pose in poses.items()}
    images = Model.of(poses).images
    return {name: image.cam_from_world for name, image in images.items() if image.cam_from_world is not None}


def is_model(path: Path) -> bool:
    """True if the folder holds a COLMAP model, text or binary."""
    return any((pathlib.Path(path) / f"images.{suffix}").exists() for suffix in ("bin", "txt"))


def read_model(path: Path) -> Model:
    """Reads the cameras and images of a COLMAP model. Like COLMAP, reads the binary files if the folder contains binary
    and text files."""
    # Let the program's reader do it, so that both read the same files and refuse the others with the same line. Import
    # it here, because few users of this module read models.
    from colmap_lazyloc.extension import core

    cameras, names, numbers, poses, images_path = core.read_model(os.fspath(path))
    data: mmap.mmap | bytes = b""
    if numbers[:, 3].any():
        with pathlib.Path(images_path).open("rb") as file:
            data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)  # mapped, because points may take gigabytes
    images: dict[str, Image] = {}
    rows = zip(names, numbers.tolist(), poses[:, :4], poses[:, 4:], strict=True)
    for name, (image_id, camera_id, offset, num_bytes), qvec, tvec in rows:
        text = name.decode(errors="backslashreplace")
        if images_path.endswith(".bin"):
            points = np.frombuffer(data, POINT2D, num_bytes // POINT2D.itemsize, offset) if num_bytes > 0 else NO_POINTS
        else:
            points = _points_of_text(data[offset : offset + num_bytes])
        images[text] = Image(text, camera_id, Pose(qvec, tvec), image_id, points)
    by_id = {
        camera_id: Camera(model, width, height, tuple(params)) for camera_id, model, width, height, params in cameras
    }
    return Model(by_id, images)


def _points_of_text(line: bytes) -> NDArray[np.void]:
    return np.array([tuple(point) for point in np.array(line.split(), float).reshape(-1, 3)], POINT2D)


def write_model(
    path: Path, cameras: Mapping[int, Camera], images: Iterable[Image], binary: bool = False
) -> pathlib.Path:
    """Writes a COLMAP model with the posed images and their cameras, without points. Returns the model's folder."""
    path, posed = pathlib.Path(path), [(image, image.cam_from_world) for image in images if image.cam_from_world]
    path.mkdir(parents=True, exist_ok=True)
    used = {camera_id: cameras[camera_id] for camera_id in sorted({image.camera_id for image, _ in posed})}
    if binary:
        (path / "cameras.bin").write_bytes(
            struct.pack("<Q", len(used))
            + b"".join(
                struct.pack(
                    f"<IiQQ{len(camera.params)}d",
                    camera_id,
                    CAMERA_MODEL_IDS[camera.model],
                    camera.width,
                    camera.height,
                    *camera.params,
                )
                for camera_id, camera in used.items()
            )
        )
        (path / "images.bin").write_bytes(
            struct.pack("<Q", len(posed))
            + b"".join(
                struct.pack("<I", image.image_id)
                + pose.bits()
                + struct.pack("<I", image.camera_id)
                + image.name.encode()
                + bytes(9)
                for image, pose in posed
            )
        )
        (path / "points3D.bin").write_bytes(bytes(8))
        return path
    (path / "cameras.txt").write_text(
        "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n"
        + "".join(f"{camera_id} {camera.text()}\n" for camera_id, camera in used.items())
    )
    (path / "images.txt").write_text(
        "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, and a line of points\n"
        + "".join(f"{image.image_id} {pose.text()} {image.camera_id} {image.name}\n\n" for image, pose in posed),
        encoding="utf-8",
    )
    (path / "points3D.txt").write_text("# no points\n")
    return path
