"""Writes poses in the format of the TUM benchmark, for evo."""

import re
from collections.abc import Iterable

from colmap_lazyloc.report.run import Run


def tum_text(run: Run) -> str:
    """Returns lines `timestamp tx ty tz qx qy qz qw` of the localized queries: world_from_cam, by their times."""
    poses = {
        result["name"]: pose for result, pose in zip(run.queries, run.poses) if pose and result["status"] == "LOCALIZED"
    }
    lines = ["# timestamp tx ty tz qx qy qz qw: poses world_from_cam of the localized queries"]
    for timestamp, name in timestamps(poses):
        w, x, y, z = poses[name].qvec
        numbers = (*poses[name].cam_in_world, -x, -y, -z, w)
        lines.append(" ".join([timestamp, *(f"{number:.17g}" for number in numbers)]))
    return "\n".join(lines) + "\n"


def timestamps(names: Iterable[str]) -> list[tuple[str, str]]:
    """Returns (time, name) by time: the last number in the file's name, if these numbers are unique; or else 0, 1, 2...
    in the order of the names."""
    names = sorted(names)
    stems = [re.sub(r"\.[A-Za-z]\w*$", "", name.rsplit("/", 1)[-1]) for name in names]
    found = [re.findall(r"\d+(?:\.\d+)?", stem, re.ASCII) for stem in stems]
    if all(found) and len({float(numbers[-1]) for numbers in found}) == len(names):
        return sorted(((numbers[-1], name) for numbers, name in zip(found, names)), key=lambda item: float(item[0]))
    return [(str(i), name) for i, name in enumerate(names)]
