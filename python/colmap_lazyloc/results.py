"""Reads results.jsonl, which `colmap lazy_localizer` writes."""

import json

import numpy as np

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.text_files import read_lines


def read_results(path) -> dict[str, dict]:
    """Reads the results by query name, in the order of the file."""
    results = {}
    for line in read_lines(path):
        if not line:
            continue
        result = json.loads(line)
        if result["name"] in results:
            raise InputError(f"{path}: query '{result['name']}' has two results")
        results[result["name"]] = result
    return results


def pose_of(result: dict) -> Pose | None:
    """Returns the query's pose; None if it was not localized, even if the result has a rotation or a pose of low
    confidence."""
    pose = result["cam_from_world"]
    if result["status"] != "LOCALIZED" or pose is None:
        return None
    return Pose(np.array(pose["qvec"], float), np.array(pose["tvec"], float))
