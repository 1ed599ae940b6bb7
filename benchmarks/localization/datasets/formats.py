"""Reads formats that several datasets share: hloc's lists, VisualSFM's NVM, COLMAP models, image sizes."""

import dataclasses
import pathlib
import struct

import cv2
import numpy as np

from benchmarks.localization.datasets.scene_source import SourceImage
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera, read_model
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.queries import read_query_cameras
from colmap_lazyloc.text_files import parse_numbers, read_entries


@dataclasses.dataclass(frozen=True)
class NvmCamera:
    focal_length_px: float
    cam_from_world: Pose
    radial_distortion: float

    def camera(self, width: int, height: int) -> Camera:
        """Converts to COLMAP's RADIAL model, with the principal point in the middle.

        VisualSFM undistorts, x_u = x_d (1 + r |x_d|^2) on the normalized plane; COLMAP distorts, which is the inverse:
        x_d = x_u (1 - r |x_u|^2 + 3 r^2 |x_u|^4 - ...).
        """
        r = self.radial_distortion
        return Camera("RADIAL", width, height, (self.focal_length_px, width / 2, height / 2, -r, 3 * r * r))


def lines_of(path: pathlib.Path) -> list[str]:
    """Reads the lines that are neither empty nor comments."""
    return [line for _, line in read_entries(path)]


def read_query_list(path: pathlib.Path) -> dict[str, Camera]:
    """Reads lines `name MODEL width height params...`, as in files of visuallocalization.net and hloc."""
    return {_without_dot(name): camera for name, camera in read_query_cameras(path).items()}


def read_nvm(path: pathlib.Path) -> dict[str, NvmCamera]:
    """Reads the cameras of a VisualSFM file, without its points.

    The file has `NVM_V3`, the number of cameras, then one line per camera: name, focal length, quaternion w x y z
    (of cam_from_world), projection centre, radial distortion, 0.
    """
    with path.open() as file:
        lines = (line.strip() for line in file)
        lines = (line for line in lines if line)
        header = next(lines, "")
        if not header.startswith("NVM_V3"):
            raise InputError(f"{path}: not an NVM_V3 file")
        cameras = {}
        for _ in range(int(parse_numbers(path, next(lines, ""), 1)[0])):
            name, _, values = next(lines, "").replace("\t", " ").partition(" ")
            focal_length_px, *values = parse_numbers(path, values, 10)
            pose = pose_of_centre(values[:4], values[4:7])
            cameras.setdefault(_without_dot(name), NvmCamera(focal_length_px, pose, values[7]))
        return cameras


def pose_of_centre(qvec, cam_in_world) -> Pose:
    """Makes a pose from a quaternion (cam_from_world: w, x, y, z; normalized here) and the projection centre."""
    return Pose.from_centre(Pose(np.array(qvec), np.zeros(3)).rotation, cam_in_world)


def pose_of_matrix(world_from_cam: np.ndarray) -> Pose:
    """Makes a pose from a 3x4 or 4x4 matrix; makes its rotation orthonormal, because the text is rounded."""
    u, _, vt = np.linalg.svd(world_from_cam[:3, :3])
    return Pose.from_centre((u @ vt).T, world_from_cam[:3, 3])


def read_source_images(path: pathlib.Path) -> dict[str, SourceImage]:
    """Reads the posed images of a COLMAP model, text or binary."""
    model = read_model(path)
    return {
        name: SourceImage(model.cameras[image.camera_id], image.cam_from_world) for name, image in model.images.items()
    }


def image_size(path: pathlib.Path) -> tuple[int, int]:
    """Returns width and height; reads only the header of a PNG."""
    if not path.exists():
        raise InputError(f"{path} is missing")
    with path.open("rb") as file:
        head = file.read(24)
    if head[:8] == b"\x89PNG\r\n\x1a\n":
        return struct.unpack(">II", head[16:24])
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None:
        raise InputError(f"{path}: not a readable image")
    return image.shape[1], image.shape[0]


def _without_dot(name: str) -> str:
    return name.removeprefix("./")
