"""Packs the data of a report page into chunks, which python/viewer/src/chunk.ts unpacks.

A chunk is gzip of: the length of a header (4 bytes, little-endian), the header in JSON (UTF-8), blanks up to a multiple
of 8 bytes, and the arrays, each padded to a multiple of 8 bytes. The header is

    {"values": {...}, "arrays": {name: [type, offset, length]}}

with values of any JSON type, types u8, u16, u32, i32, f32 and f64, offsets in bytes from the first array, and lengths
in elements. Arrays of several dimensions are flattened, row by row.
"""

import gzip
import json
import struct

import numpy as np

from colmap_lazyloc.array_types import Array

Values = dict[str, object]  # what JSON can hold
TYPES = {"u8": "|u1", "u16": "<u2", "u32": "<u4", "i32": "<i4", "f32": "<f4", "f64": "<f8"}
ALIGNMENT = 8


def pack(values: Values, arrays: dict[str, Array]) -> bytes:
    """Returns a chunk with JSON values and arrays of one of TYPES; the same input gives the same bytes."""
    header, data, offset = {}, [], 0
    for name, array in arrays.items():
        kind = next(kind for kind, dtype in TYPES.items() if np.dtype(dtype) == array.dtype)
        content = np.ascontiguousarray(array).tobytes()
        header[name] = [kind, offset, array.size]
        data.append(_padded(content))
        offset += len(data[-1])
    text = json.dumps({"values": values, "arrays": header}, ensure_ascii=False, allow_nan=False).encode()
    text += b" " * (-(len(text) + 4) % ALIGNMENT)
    return gzip.compress(struct.pack("<I", len(text)) + text + b"".join(data), mtime=0)


def _padded(content: bytes) -> bytes:
    return content + bytes(-len(content) % ALIGNMENT)
