"""Writes JPEG files with EXIF."""

import struct

import cv2
import numpy as np
import PIL.Image

from colmap_lazyloc.model import Camera
from colmap_lazyloc.poses import Pose

TIFF_HEADER = b"II*\0" + struct.pack("<I", 8)  # little-endian; the first directory follows


def _directory(offset, entries):
    """Returns a TIFF directory that starts at `offset`. Entries: (tag, text), or (tag, number of a short or long)."""
    table, data = struct.pack("<H", len(entries)), b""
    data_offset = offset + 2 + 12 * len(entries) + 4
    for tag, value in entries:
        if isinstance(value, str):
            text = value.encode() + b"\0"
            text += b"\0" * (5 - len(text))  # shorter texts would stand in the table itself
            table += struct.pack("<HHII", tag, 2, len(text), data_offset + len(data))
            data += text + b"\0" * (len(text) % 2)
        else:
            table += struct.pack("<HHII", tag, 4 if tag == 0x8769 else 3, 1, value)
    return table + struct.pack("<I", 0) + data


def write_jpeg(path, pixels, focal_length_35mm, make="Maker", model="Model"):
    """Writes a photo whose EXIF has the make, the model and the focal length in mm for a film of 35 mm."""
    main = [(0x010F, make), (0x0110, model)]
    pointer = len(TIFF_HEADER) + len(_directory(0, [*main, (0x8769, 0)]))
    block = TIFF_HEADER + _directory(len(TIFF_HEADER), [*main, (0x8769, pointer)])
    block += _directory(pointer, [(0xA405, focal_length_35mm)])
    segment = b"Exif\0\0" + block
    is_encoded, jpeg = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 97])
    assert is_encoded
    jpeg = jpeg.tobytes()
    path.write_bytes(jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment + jpeg[2:])


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


def write_oriented(path, source, orientation):
    """Writes a photo as a JPEG file whose pixels are stored in this orientation, so that it is displayed as before."""
    with PIL.Image.open(source) as photo:
        upright = photo.convert("RGB")
    if orientation in MIRRORS:
        stored = upright.transpose(MIRRORS[orientation])  # each undoes itself
    else:
        stored = upright.rotate(-90 * TURNS[orientation], expand=True)
    exif = PIL.Image.Exif()
    exif[ORIENTATION] = orientation
    path.parent.mkdir(parents=True, exist_ok=True)
    stored.save(path, quality=97, subsampling=0, exif=exif)


def stored_camera(camera, orientation):
    """Returns the camera of the stored pixels, for an upright one with one focal length and a principal point."""
    focal_length, x, y, *distortion = camera.params
    width, height = camera.width, camera.height
    for _ in range(-TURNS[orientation] % 4):
        x, y, width, height = y, width - x, height, width
    return Camera(camera.model, width, height, (focal_length, x, y, *distortion))


def stored_pose(pose, orientation):
    """Returns cam_from_world of the stored pixels, for that of the upright ones."""
    quarter_turn = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    rotation = np.linalg.matrix_power(quarter_turn, -TURNS[orientation] % 4)
    return Pose.from_matrix(rotation @ pose.rotation, rotation @ pose.tvec)
