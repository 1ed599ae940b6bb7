"""Finds the poses of photos by time."""

import math
import pathlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from colmap_lazyloc.errors import logger
from colmap_lazyloc.pose_formats.naming import Names, natural_key
from colmap_lazyloc.pose_formats.posed_images import Source
from colmap_lazyloc.text_files import read_entries

MAX_GAP_SECONDS = 0.2  # between the poses before and after a photo
EXACT_SECONDS = 1e-4  # a pose as near as this is taken as it is
UNITS = (1.0, 1e-3, 1e-6, 1e-9)  # of times, in seconds
# Lists in the folder of a trajectory, or of the photos as EuRoC has them: lines `time name`, or a time for each photo.
IMAGE_LISTS = ("rgb.txt", "images.txt", "timestamps.txt", "times.txt", "data.csv")

Array = NDArray[np.float64]


def listed_times(source: Source) -> dict[str, float]:
    """Returns the times of photos by name from a list next to the trajectory or the photos; empty if there is none."""
    assert source.photos.folder is not None
    for folder in (source.path.parent, source.photos.folder, source.photos.folder.parent):
        for path in (folder / name for name in IMAGE_LISTS):
            times = _read_list(path, source) if path.is_file() and path != source.path else {}
            if times:
                return times
    return {}


def places_between(
    photos: Sequence[float], known: Sequence[float]
) -> tuple[list[tuple[int, int, float] | None], float]:
    """Returns for each photo two poses and how far it is between them in time, 0 to 1; None for one in a gap. Also
    returns how far photos are from the nearest pose in the median, in seconds.

    `known`: the times of the poses. Times of both sides may have different units.
    """
    order = np.argsort(known, kind="stable")
    times, first = np.unique(np.asarray(known, float)[order], return_index=True)
    order = order[first]
    times, wanted = _in_seconds(times, np.asarray(photos, float))
    places: list[tuple[int, int, float] | None] = []
    distances = []
    for time in wanted.tolist():
        after = int(np.searchsorted(times, time))
        near = [index for index in (after - 1, after) if 0 <= index < len(times)]
        nearest = min(near, key=lambda index: abs(times[index] - time))
        place = None
        if abs(times[nearest] - time) <= EXACT_SECONDS:
            place = int(order[nearest]), int(order[nearest]), 0.0
        elif len(near) == 2 and times[after] - times[after - 1] <= MAX_GAP_SECONDS:
            weight = (time - times[after - 1]) / (times[after] - times[after - 1])
            place = int(order[after - 1]), int(order[after]), float(weight)
        places.append(place)
        if place is not None:
            distances.append(abs(float(times[nearest]) - time))
    return places, float(np.median(distances)) if distances else np.inf


def _in_seconds(known: Array, wanted: Array) -> tuple[Array, Array]:
    """Returns both in seconds, from the first pose on, with the units for which they overlap the most.

    The same unit is taken if they overlap with it at all: with others, times from 0 on overlap always.
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
            key = (1e-4 <= step <= 10 or len(known) == 1, unit == other and count > 0, count)
            if best is None or key > best[0]:
                best = key, seconds, photos
    assert best is not None
    return best[1], best[2]


def _read_list(path: pathlib.Path, source: Source) -> dict[str, float]:
    """Reads lines `time name` or `name time`, or a time for each photo; empty if the file has another form."""
    rows = [line.replace(",", " ").split() for _, line in read_entries(path)]
    try:
        if all(len(row) == 1 for row in rows):
            values = [float(row[0]) for row in rows]
            photos = sorted(source.photos.names, key=natural_key)
            if len(values) != len(photos):
                logger.warning(
                    "%s: is not used, because it has %d times for %d photos in %s",
                    path,
                    len(values),
                    len(photos),
                    source.photos.folder,
                )
                return {}
            return dict(zip(photos, values))
    except ValueError:
        return {}
    rows = [row for row in rows if len(row) == 2]
    time = max((0, 1), key=lambda column: sum(_is_number(row[column]) for row in rows))
    good = [row for row in rows if _is_number(row[time])]
    if 2 * len(good) <= len(rows):
        return {}
    if len(good) < len(rows):
        logger.warning("%s: %d of %d lines have no time", path, len(rows) - len(good), len(rows))
    times = {row[1 - time]: float(row[time]) for row in good}
    found = Names.match(list(times), source.photos)
    if not found.photos:
        logger.warning("%s: is not used, because it names no photo in %s", path, source.photos.folder)
    values = list(times.values())
    return {name: values[index] for index, name in found.photos.items()}


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
