"""Divides queries into shards, as `colmap lazy_localizer --shard I/N` does."""

import dataclasses
import re

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

    def holds(self, name: str) -> bool:
        """True if a query (or a group of queries) of this name belongs to the shard."""
        return name_hash(name) % self.count == self.index - 1


def name_hash(name: str) -> int:
    """Returns the 64-bit FNV-1a hash of a name."""
    value = 14695981039346656037
    for byte in name.encode(errors="surrogateescape"):
        value = ((value ^ byte) * 1099511628211) & 0xFFFFFFFFFFFFFFFF
    return value
