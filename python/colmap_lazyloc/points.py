"""Reads the points of COLMAP models."""

import dataclasses
import mmap
import pathlib
import struct

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.text_files import Path

_HEAD = np.dtype([("id", "<u8"), ("xyz", "<f8", 3), ("color", "u1", 3), ("error_px", "<f8"), ("track_length", "<u8")])
_TRACK_ELEMENT_SIZE = 8  # bytes: image id and index of the keypoint


@dataclasses.dataclass(frozen=True)
class Points:
    """Points of a model, sorted by id."""

    ids: Array  # int64
    xyz: Array  # n x 3, float64

    def __len__(self) -> int:
        return len(self.ids)

    def find(self, ids: Array) -> Array:
        """Returns the index of each id; -1 if there is no such point."""
        if len(self) == 0:
            return np.full(len(ids), -1)
        index = np.minimum(np.searchsorted(self.ids, ids), len(self) - 1)
        return np.where(self.ids[index] == ids, index, -1)


def read_points(path: Path) -> Points:
    """Reads points3D.bin of a model's folder, without tracks, which images.bin has as well."""
    path = pathlib.Path(path) / "points3D.bin"
    try:
        with path.open("rb") as file:
            data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        heads = _read_heads(data)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, struct.error):
        raise InputError(f"{path}: is damaged or cut off") from None
    order = np.argsort(heads["id"], kind="stable")
    ids, xyz = heads["id"][order].astype(np.int64), heads["xyz"][order]
    if len(ids) > 0 and not (np.all(np.diff(ids) > 0) and np.all(np.isfinite(xyz))):
        raise InputError(f"{path}: a point appears twice or has no finite position")
    return Points(ids, xyz)


def _read_heads(data: mmap.mmap) -> Array:
    """Returns the points without their tracks."""
    (num_points,), offset = struct.unpack_from("<Q", data), 8
    if num_points > len(data) // _HEAD.itemsize:
        raise ValueError("more points than the file can hold")
    offsets = np.empty(num_points, np.int64)
    # Follow the lengths of the tracks here, and read all else at once, because this loop is slow.
    read_length, length_offset = struct.Struct("<Q").unpack_from, _HEAD.itemsize - 8
    for i in range(num_points):
        offsets[i] = offset
        offset += _HEAD.itemsize + _TRACK_ELEMENT_SIZE * read_length(data, offset + length_offset)[0]
    if offset != len(data):
        raise ValueError("the points end elsewhere than the file")
    if num_points == 0:
        return np.empty(0, _HEAD)
    windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(data, np.uint8), _HEAD.itemsize)
    return np.ascontiguousarray(windows[offsets]).view(_HEAD)[:, 0]
