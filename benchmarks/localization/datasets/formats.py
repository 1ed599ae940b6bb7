"""Readers of formats that several datasets share: hloc's lists, VisualSFM's NVM, COLMAP models, image sizes."""

import dataclasses
import pathlib
import struct

import cv2
import numpy as np
import pycolmap

from datasets.scene_source import InputError, SourceImage, numbers
from geometry import Pose
from scenes import Camera


@dataclasses.dataclass(frozen=True)
class NvmCamera:
    focal_length_px: float
    cam_from_world: Pose
    radial_distortion: float

    def camera(self, width: int, height: int) -> Camera:
        """VisualSFM undistorts, x_u = x_d (1 + r |x_d|^2) on the normalized plane, with the principal point in the
        middle; COLMAP's RADIAL model distorts. Its inverse is x_d = x_u (1 - r |x_u|^2 + 3 r^2 |x_u|^4 - ...).
        """
        r = self.radial_distortion
        return Camera("RADIAL", width, height, (self.focal_length_px, width / 2, height / 2, -r, 3 * r * r))


def lines_of(path: pathlib.Path) -> list[str]:
    """Lines that are neither empty nor comments."""
    lines = (line.strip() for line in path.read_text().splitlines())
    return [line for line in lines if line and not line.startswith("#")]


def read_query_list(path: pathlib.Path) -> dict[str, Camera]:
    """`name MODEL width height params...` a line, as visuallocalization.net and hloc have it."""
    cameras = {}
    for line in lines_of(path):
        words = line.split()
        if len(words) < 5:
            raise InputError(f"{path}: expected `name MODEL width height params...`, found '{line}'")
        width, height, *params = numbers(path, " ".join(words[2:]))
        cameras[_without_dot(words[0])] = Camera(words[1], int(width), int(height), tuple(params))
    return cameras


def read_pairs(path: pathlib.Path) -> list[tuple[str, str]]:
    """Two names a line; what follows them, such as a score, is not used."""
    pairs = [tuple(line.split()[:2]) for line in lines_of(path)]
    if any(len(pair) < 2 for pair in pairs):
        raise InputError(f"{path}: expected two image names a line")
    return pairs


def read_nvm(path: pathlib.Path) -> dict[str, NvmCamera]:
    """The cameras of a VisualSFM file: `NVM_V3`, their number, then a line each: name, focal length, quaternion w x y z
    (of cam_from_world), projection centre, radial distortion, 0. Points are not read.
    """
    with path.open() as file:
        lines = (line.strip() for line in file)
        lines = (line for line in lines if line)
        header = next(lines, "")
        if not header.startswith("NVM_V3"):
            raise InputError(f"{path}: not an NVM_V3 file")
        cameras = {}
        for _ in range(int(numbers(path, next(lines, ""), 1)[0])):
            name, _, values = next(lines, "").replace("\t", " ").partition(" ")
            focal_length_px, *values = numbers(path, values, 10)
            pose = pose_of_centre(values[:4], values[4:7])
            cameras.setdefault(_without_dot(name), NvmCamera(focal_length_px, pose, values[7]))
        return cameras


def pose_of_centre(qvec, cam_in_world) -> Pose:
    """cam_from_world of its rotation (w x y z, normalized here) and the projection centre."""
    rotation = Pose.from_qvec_tvec(qvec, np.zeros(3)).rotation
    return Pose(rotation, -rotation @ np.asarray(cam_in_world, dtype=float))


def pose_of_matrix(world_from_cam: np.ndarray) -> Pose:
    """cam_from_world of a 3x4 or 4x4 matrix; its rotation, which text rounds, is made orthonormal again."""
    u, _, vt = np.linalg.svd(world_from_cam[:3, :3])
    rotation = (u @ vt).T
    return Pose(rotation, -rotation @ world_from_cam[:3, 3])


def read_model(path: pathlib.Path) -> dict[str, SourceImage]:
    """The posed images of a COLMAP model, text or binary."""
    try:
        model = pycolmap.Reconstruction(path)
    except Exception as error:
        raise InputError(f"{path}: no readable COLMAP model: {str(error).strip().splitlines()[-1]}") from None
    cameras = {camera_id: Camera(camera.model.name, camera.width, camera.height, tuple(map(float, camera.params)))
               for camera_id, camera in model.cameras.items()}
    return {image.name: SourceImage(cameras[image.camera_id], Pose.from_rigid3d(image.cam_from_world()))
            for image in model.images.values() if image.has_pose}


def image_size(path: pathlib.Path) -> tuple[int, int]:
    """Width and height; of a PNG from its header alone."""
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
