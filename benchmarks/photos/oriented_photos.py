"""Photos as cameras store them: turned or mirrored, with the orientation in EXIF that displays them upright."""

import pathlib

import numpy as np
import PIL.Image

from colmap_lazyloc.model import Camera, num_focal_lengths
from colmap_lazyloc.poses import Pose

# What a program does with the stored pixels to display a photo, by the orientation in EXIF: counter-clockwise quarter
# turns, or a reflection.
TURNS = {1: 0, 3: 2, 6: 3, 8: 1}
MIRRORS = {
    2: PIL.Image.Transpose.FLIP_LEFT_RIGHT,
    4: PIL.Image.Transpose.FLIP_TOP_BOTTOM,
    5: PIL.Image.Transpose.TRANSPOSE,
    7: PIL.Image.Transpose.TRANSVERSE,
}
ORIENTATION = 0x0112


def write_oriented(path: pathlib.Path, source: pathlib.Path, orientation: int, width: int | None = None):
    """Writes a photo as a JPEG file whose pixels are stored in this orientation, so that it is displayed as before.
    With `width`, only the middle columns are kept."""
    with PIL.Image.open(source) as photo:
        upright = photo.convert("RGB")
    if width is not None:
        left = (upright.width - width) // 2
        upright = upright.crop((left, 0, left + width, upright.height))
    if orientation in MIRRORS:
        stored = upright.transpose(MIRRORS[orientation])  # each undoes itself
    else:
        stored = upright.rotate(-90 * TURNS[orientation], expand=True)
    exif = PIL.Image.Exif()
    exif[ORIENTATION] = orientation
    path.parent.mkdir(parents=True, exist_ok=True)
    stored.save(path, quality=97, subsampling=0, exif=exif)


def stored_camera(camera: Camera, orientation: int, crop_width: int | None = None) -> Camera:
    """Returns the camera of the stored pixels, for an upright one without tangential distortion."""
    num = num_focal_lengths(camera.model)
    focal_lengths, (x, y), distortion = camera.params[:num], camera.params[num : num + 2], camera.params[num + 2 :]
    width, height = camera.width, camera.height
    if crop_width is not None:
        x, width = x - (width - crop_width) // 2, crop_width
    for _ in range(-TURNS[orientation] % 4):
        focal_lengths, x, y, width, height = focal_lengths[::-1], y, width - x, height, width
    return Camera(camera.model, width, height, (*focal_lengths, x, y, *distortion))


def stored_pose(pose: Pose, orientation: int) -> Pose:
    """Returns cam_from_world of the stored pixels, for that of the upright ones."""
    return Pose.from_matrix(_turn(orientation) @ pose.rotation, _turn(orientation) @ pose.tvec)


def upright_pose(pose: Pose, orientation: int) -> Pose:
    """Returns cam_from_world of the upright pixels, for that of the stored ones."""
    return Pose.from_matrix(_turn(orientation).T @ pose.rotation, _turn(orientation).T @ pose.tvec)


def _turn(orientation: int) -> np.ndarray:
    """Returns the rotation from the upright camera's axes to those of the stored pixels."""
    quarter_turn = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    return np.linalg.matrix_power(quarter_turn, -TURNS[orientation] % 4)
