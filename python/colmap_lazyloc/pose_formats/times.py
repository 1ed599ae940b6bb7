"""Finds the poses of photos by time."""

import pathlib
import re
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.pose_formats.posed_images import Source
from colmap_lazyloc.text_files import read_entries

MAX_GAP_SECONDS = 0.2  # between the poses before and after a photo
EXACT_SECONDS = 1e-4  # a pose as near as this is taken as it is
UNITS = (1.0, 1e-3, 1e-6, 1e-9)  # of times, in seconds
IMAGE_LISTS = ("rgb.txt", "images.txt", "timestamps.txt")  # beside a trajectory, with lines `time name`

Array = NDArray[np.float64]


def photo_times(source: Source) -> dict[str, float]:
    """Returns the times of photos by name: of a list beside the trajectory, or else the numbers at their ends."""
    if source.photos.folder is None:
        raise InputError("--image_path is needed, because the file names no photos")
    for folder in (source.path.parent, source.photos.folder, source.photos.folder.parent):
        for path in (folder / name for name in IMAGE_LISTS):
            times = _read_list(path, source) if path.is_file() and path != source.path else {}
            if times:
                return times
    ends = {name: re.search(r"\d+(\.\d+)?$", pathlib.PurePosixPath(name).stem) for name in source.photos.names}
    return {name: float(match.group()) for name, match in ends.items() if match}


def interpolate(
    names: Mapping[str, float], times: Sequence[float], centres: Array, rotations: Array
) -> dict[str, tuple[Array, Array]]:
    """Returns rotation and centre of each photo between the poses around its time, by name; those in a gap have none.

    Times of both sides may have different units.
    """
    from scipy.spatial.transform import Rotation, Slerp

    order = np.argsort(times, kind="stable")
    _, first = np.unique(np.asarray(times, float)[order], return_index=True)
    order = order[first]
    known = np.asarray(times, float)[order]
    known, wanted = _in_seconds(known, np.array(list(names.values()), float))
    spline = Slerp(known, Rotation.from_matrix(rotations[order])) if len(known) > 1 else None
    poses = {}
    for name, time in zip(names, wanted):
        after = int(np.searchsorted(known, time))
        near = [index for index in (after - 1, after) if 0 <= index < len(known)]
        nearest = min(near, key=lambda index: abs(known[index] - time))
        if abs(known[nearest] - time) <= EXACT_SECONDS:
            poses[name] = rotations[order[nearest]], centres[order[nearest]]
        elif len(near) == 2 and spline is not None and known[after] - known[after - 1] <= MAX_GAP_SECONDS:
            weight = (time - known[after - 1]) / (known[after] - known[after - 1])
            centre = (1 - weight) * centres[order[after - 1]] + weight * centres[order[after]]
            poses[name] = np.asarray(spline(time).as_matrix()), centre
    return poses


def _in_seconds(known: Array, wanted: Array) -> tuple[Array, Array]:
    """Returns both in seconds, from the first pose on, with the units for which they overlap the most.

    Seconds are tried first, because names may have times in nanoseconds, but trajectories rarely do.
    """
    best = None
    for unit in UNITS:
        for other in UNITS:
            start = known[0] * unit
            seconds = known * unit - start
            photos = wanted * other - start
            count = int(np.sum((photos >= -EXACT_SECONDS) & (photos <= seconds[-1] + EXACT_SECONDS)))
            # A video or walk has at least a pose every ten seconds, and at most one in 0.1 ms.
            step = seconds[-1] / max(len(known) - 1, 1)
            key = (1e-4 <= step <= 10 or len(known) == 1, count)
            if best is None or key > best[0]:
                best = key, seconds, photos
    assert best is not None
    return best[1], best[2]


def _read_list(path: pathlib.Path, source: Source) -> dict[str, float]:
    """Reads lines `time name`; empty if the file has another form, as images.txt of a COLMAP model has."""
    times = {}
    for _, line in read_entries(path):
        words = line.replace(",", " ").split()
        name = source.find_photo(words[1]) if len(words) == 2 else None
        try:
            time = float(words[0])
        except ValueError:
            return {}
        if name is not None:
            times[name] = time
    return times
