"""Unpacks report pages for tests."""

import base64
import gzip
import json
import re
import struct

import numpy as np

from colmap_lazyloc.report.chunk import TYPES


class ReportPage:
    """The chunks and photos of a page, in one file or split."""

    def __init__(self, path):
        self.text = path.read_text(encoding="utf-8")
        if '<html lang="en" data-split>' in self.text:
            folder = path.parent
            calls = [file.read_text() for file in folder.glob("chunks/**/*.js")]
            packed = dict(map(_arguments, calls))
            self.photos = {int(file.stem): file.read_bytes() for file in folder.glob("photos/*.jpg")}
        else:
            packed = dict(re.findall(r'data-chunk="([^"]*)">([^<]*)<', self.text))
            photos = re.findall(r'data-photo="(\d+)">([^<]*)<', self.text)
            self.photos = {int(index): base64.b64decode(content) for index, content in photos}
        self.chunks = {name: unpack(base64.b64decode(content)) for name, content in packed.items()}
        self.summary, self.queries = self.chunks["summary"], self.chunks["queries"]
        self.scene = self.chunks["scene"]

    def index(self, name):
        """Returns the index of a query."""
        return self.queries["names"].index(name)

    def drawing(self, name):
        """Returns the drawing of a query."""
        return self.chunks[f"drawing/{self.index(name)}"]

    def rows(self, name):
        """Returns an array of the scene with a row for each camera or point."""
        return self.scene[name].reshape(-1, 4 if name.endswith(("Rotations", "Extents")) else 3)

    def points_of(self, query):
        """Returns the indices of the points that a query sees."""
        indices = np.cumsum(self.scene["pointDeltas"], dtype=np.uint32)
        return indices[self.scene["pointOffsets"][query] : self.scene["pointOffsets"][query + 1]]

    def warning(self, title):
        """Returns the names of the items of a warning; none if it is not in the page."""
        return [
            item["name"]
            for warning in self.summary["warnings"]
            if warning["title"] == title
            for item in warning["items"]
        ]


def _arguments(call):
    return re.fullmatch(r'report\.addChunk\("([^"]*)", "([^"]*)"\);\n', call).groups()


def unpack(content):
    """Returns the values and arrays of a chunk by name."""
    data = gzip.decompress(content)
    (length,) = struct.unpack_from("<I", data)
    header = json.loads(data[4 : 4 + length])
    arrays = {
        name: np.frombuffer(data, TYPES[kind], num, 4 + length + offset)
        for name, (kind, offset, num) in header["arrays"].items()
    }
    return header["values"] | arrays
