"""Finds out which shards are finished, from the files in their folders."""

import json
import pathlib

from colmap_lazyloc.errors import InputError

Manifest = dict[str, object]  # what the results of a shard depend on

UNFINISHED, MANIFEST = "unfinished", "shard/manifest.json"  # names that lazy_localizer gives


def read_manifest(folder: pathlib.Path) -> Manifest | None:
    """Returns what the results of a finished shard depend on; None if the shard is not finished."""
    path = folder / MANIFEST
    if not path.exists() or (folder / UNFINISHED).exists():
        return None
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
        contents = {name: entry["content"] for name, entry in manifest["inputs"].items()}
        same = {key: manifest[key] for key in ("program", "options", "num_queries", "num_groups")}
        return {**same, "inputs": contents, "shard": manifest["shard"]}
    except (ValueError, KeyError, AttributeError, TypeError):
        raise InputError(f"{path}: is not a manifest, or is damaged") from None


def is_same_run(manifest: Manifest, other: Manifest | None) -> bool:
    """True if both shards are parts of one run."""
    return other is not None and {**manifest, "shard": None} == {**other, "shard": None}


def as_ranges(indices: list[int]) -> str:
    """Returns ascending numbers as ranges, for example 3,7-9."""
    ranges: list[list[int]] = []
    for index in indices:
        if ranges and index == ranges[-1][1] + 1:
            ranges[-1][1] = index
        else:
            ranges.append([index, index])
    return ",".join(str(first) if first == last else f"{first}-{last}" for first, last in ranges)
