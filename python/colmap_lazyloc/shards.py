"""Divides queries into shards, as `colmap lazy_localizer --shard I/N` does."""

import dataclasses
import re
import zlib

from colmap_lazyloc.errors import InputError


@dataclasses.dataclass(frozen=True)
class Shard:
    """The part `index` of `count` parts; they are counted from 1."""

    index: int
    count: int

    @staticmethod
    def parse(text: str) -> "Shard":
        match = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text)
        if match is None or not 1 <= int(match[1]) <= int(match[2]):
            raise InputError(f"option --shard must be I/N with 1 <= I <= N, but is '{text}'")
        return Shard(int(match[1]), int(match[2]))

    def holds(self, group_name: str) -> bool:
        """True if a group belongs to the shard. A single query is a group of its own name."""
        return zlib.crc32(group_name.encode(errors="surrogateescape")) % self.count == self.index - 1
