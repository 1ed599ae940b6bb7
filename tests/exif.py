"""Writes JPEG files with EXIF."""

import struct

import cv2

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
