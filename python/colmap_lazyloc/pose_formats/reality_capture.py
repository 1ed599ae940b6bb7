"""Reads the CSV file "Internal/External camera parameters" of RealityCapture (RealityScan).

At heading, pitch and roll 0 a camera looks down, with the top of its image to +y (north). The focal length is that of a
film 36 mm wide, and the principal point is relative to the longer side, from the centre.
"""

import numpy as np

from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.angles import rotation_of_angles
from colmap_lazyloc.pose_formats.cameras import brown_camera
from colmap_lazyloc.pose_formats.geo import Georeference
from colmap_lazyloc.pose_formats.posed_images import OPENGL_FROM_COLMAP, Photos, PosedImage, PosedImages, Source
from colmap_lazyloc.pose_formats.text import Entry, Table
from colmap_lazyloc.poses import Pose

FILM_MM = 36.0


def read(source: Source) -> PosedImages:
    rows = [(source.find_photo(entry.text("name")), entry) for entry in Table(source.path).entries()]
    found = [(name, entry) for name, entry in rows if name is not None]
    if not found:
        return PosedImages([])
    positions = np.array([[entry.number("x"), entry.number("y"), entry.number("alt", "z")] for _, entry in found])
    place = None if source.crs is None else Georeference(positions, source.crs, source.origin)
    images = []
    for index, (name, entry) in enumerate(found):
        rotation = rotation_of_angles(*entry.numbers("heading pitch roll")) @ OPENGL_FROM_COLMAP
        if place is not None:
            rotation = place.axes(index) @ rotation
        centre = positions[index] if place is None else place.positions[index]
        camera = source.camera or _camera(entry, name, source.photos)
        images.append(PosedImage(name, camera, Pose.from_centre(rotation.T, centre)))
    return PosedImages(images, None if place is None else place.origin)


def _camera(entry: Entry, name: str, photos: Photos) -> Camera:
    width, height = photos.size(name)
    longer = max(width, height)
    focal = entry.number("f") / FILM_MM * longer
    centre = (
        width / 2 + entry.number("px", default=0) * longer,
        height / 2 + entry.number("py", default=0) * longer,
    )
    radial = tuple(entry.number(key, default=0) for key in ("k1", "k2", "k3", "k4"))
    tangential = entry.number("t1", default=0), entry.number("t2", default=0)
    return brown_camera((width, height), (focal, focal), centre, radial, tangential)
