"""Reads reconstruction.json of OpenSfM and OpenDroneMap.

Rotations are axis-angle vectors, cam_from_world. Lengths of the image are relative to its longer side, from its centre.
The world is a local frame at `reference_lla`.
"""

from typing import Any

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.cameras import brown_camera, fisheye_camera
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.pose_formats.posed_images import PosedImage, PosedImages, Source, numbers
from colmap_lazyloc.pose_formats.text import read_json
from colmap_lazyloc.poses import Pose


def read(source: Source) -> PosedImages:
    reconstructions = read_json(source.path)
    # Take the largest, because parts that are not connected have coordinates of their own.
    reconstruction = max(reconstructions, key=lambda part: len(part["shots"]))
    cameras = {key: _camera(value) for key, value in reconstruction["cameras"].items()}
    images = []
    for key, shot in reconstruction["shots"].items():
        name = source.find_photo(key)
        if name is not None:
            images.append(PosedImage(name, source.camera or _known(cameras[shot["camera"]], key), _pose(shot)))
    reference = reconstruction.get("reference_lla")
    if reference is None:
        return PosedImages(images)
    return PosedImages(images, GeoOrigin(*(float(reference[key]) for key in ("latitude", "longitude", "altitude"))))


def _pose(shot: dict[str, Any]) -> Pose:
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_rotvec(numbers(shot["rotation"], 3)).as_matrix()
    return Pose.from_matrix(rotation, numbers(shot["translation"], 3))


def _known(camera: Camera | str, key: str) -> Camera:
    if isinstance(camera, str):
        raise InputError(f"'{key}' was taken by a camera of the type {camera}, which is not supported")
    return camera


def _camera(values: dict[str, Any]) -> Camera | str:
    """Returns a camera, or its type if it is not supported."""
    kind = values.get("projection_type", "perspective")
    width, height = int(values["width"]), int(values["height"])
    longer = max(width, height)
    focal_x = float(values.get("focal_x", values.get("focal", 0))) * longer
    focal_y = float(values.get("focal_y", values.get("focal", 0))) * longer
    centre = width / 2 + float(values.get("c_x", 0)) * longer, height / 2 + float(values.get("c_y", 0)) * longer
    k1, k2, k3, k4, p1, p2 = (float(values.get(key, 0)) for key in ("k1", "k2", "k3", "k4", "p1", "p2"))
    size, focal = (width, height), (focal_x, focal_y)
    if kind in ("perspective", "simple_radial", "radial"):
        return brown_camera(size, focal, centre, (k1, k2))
    if kind == "brown":
        return brown_camera(size, focal, centre, (k1, k2, k3), (p1, p2))
    if kind == "fisheye":
        return fisheye_camera(size, focal, centre, (k1, k2))
    if kind == "fisheye_opencv":
        return fisheye_camera(size, focal, centre, (k1, k2, k3, k4))
    return str(kind)
