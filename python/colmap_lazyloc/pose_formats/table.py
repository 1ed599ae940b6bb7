"""Reads a table with a row for each photo: its name, where the camera was, how it was turned, and its intrinsics.

Positions are x, y, z or latitude, longitude, height. Rotations are quaternions of the camera's axes in the world
(world_from_cam), or yaw (clockwise from north), pitch (up from the horizon, -90 looks down) and roll in degrees.
"""

import numpy as np
from numpy.typing import NDArray

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.angles import LEVEL_CAMERA, rotation_of_angles
from colmap_lazyloc.pose_formats.cameras import brown_camera
from colmap_lazyloc.pose_formats.geo import Georeference
from colmap_lazyloc.pose_formats.posed_images import PosedImage, PosedImages, Source, quaternion_rotation
from colmap_lazyloc.pose_formats.text import Entry, Table
from colmap_lazyloc.poses import Pose

NAME = ("name", "image", "image_name", "file", "filename", "file_name", "label", "sourcefile", "photo")
LATITUDE = ("latitude", "lat", "gpslatitude")
LONGITUDE = ("longitude", "lon", "lng", "long", "gpslongitude")
HEIGHT = ("height_m", "altitude", "alt", "elevation", "ellipsoidal_height", "gpsaltitude", "z")
YAW = ("yaw", "heading", "azimuth", "gimbalyawdegree", "yaw_deg")
PITCH = ("pitch", "gimbalpitchdegree", "pitch_deg")
ROLL = ("roll", "gimbalrolldegree", "roll_deg")
X, Y, Z = (("x", "tx", "px"), ("y", "ty", "py"), ("z", "tz", "pz"))


def read(source: Source) -> PosedImages:
    table = Table(source.path)
    if not table.columns:
        raise InputError(f"{source.path}: has no row with the names of its columns")
    rows = [(source.find_photo(entry.text(*NAME)), entry) for entry in table.entries()]
    found = [(name, entry) for name, entry in rows if name is not None]
    if not found:
        return PosedImages([])
    is_geographic = found[0][1].has(LATITUDE, LONGITUDE)
    # Beside a width, the height is that of the image.
    heights = HEIGHT if found[0][1].has("width") else (*HEIGHT, "height")
    columns = (LATITUDE, LONGITUDE, heights) if is_geographic else (X, Y, Z)
    positions = np.array([[entry.number(*names) for names in columns] for _, entry in found])
    place = None
    if is_geographic or source.crs is not None:
        place = Georeference(positions, None if is_geographic else source.crs, source.origin)
        positions = place.positions
    images = []
    for index, (name, entry) in enumerate(found):
        camera = source.camera or camera_of_entry(entry) or _missing_camera(source)
        images.append(PosedImage(name, camera, Pose.from_centre(_rotation(entry, place, index).T, positions[index])))
    return PosedImages(images, None if place is None else place.origin)


def camera_of_entry(entry: Entry) -> Camera | None:
    """Returns the intrinsics in the row of a table; None if it has none."""
    if not entry.has(("width", "w"), ("height_px", "height", "h"), ("fx", "fl_x", "f")):
        return None
    width, height = entry.number("width", "w"), entry.number("height_px", "height", "h")
    focal_x = entry.number("fx", "fl_x", "f")
    focal = focal_x, entry.number("fy", "fl_y", default=focal_x)
    centre = entry.number("cx", default=width / 2), entry.number("cy", default=height / 2)
    k1, k2, k3, p1, p2 = (entry.number(key, default=0) for key in ("k1", "k2", "k3", "p1", "p2"))
    return brown_camera((int(width), int(height)), focal, centre, (k1, k2, k3), (p1, p2))


def _rotation(entry: Entry, place: Georeference | None, index: int) -> NDArray[np.float64]:
    """Returns the camera's axes in the world."""
    if entry.has("qw", "qx", "qy", "qz"):
        return quaternion_rotation(*entry.numbers("qw qx qy qz"))
    if not entry.has(YAW, PITCH):
        raise InputError("there is neither a quaternion (qw, qx, qy, qz) nor yaw, pitch and roll")
    angles = entry.number(*YAW), entry.number(*PITCH), entry.number(*ROLL, default=0)
    rotation = rotation_of_angles(*angles) @ LEVEL_CAMERA
    return rotation if place is None else np.asarray(place.axes(index) @ rotation)


def _missing_camera(source: Source) -> Camera:
    raise InputError(f"{source.path}: has no intrinsics (columns width, height, fx, fy, cx, cy): give them as --camera")
