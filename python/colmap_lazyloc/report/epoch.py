"""Makes what the scene shows of a second epoch: shifts by the joint adjustment, control points, and the overlap."""

import math

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.report.chunk import Values
from colmap_lazyloc.report.run import Run

LENGTH = 0.04  # of the lines of long residuals, as a fraction of the scene's size


def epoch_arrays(run: Run, origin: Array, size: float) -> tuple[Values, dict[str, Array]]:
    """Returns values and arrays of the chunk "scene"; without a second epoch, they are empty. Lines of shifts and
    residuals are as many times too long as the values say."""
    now = {result["name"]: pose.cam_in_world for result, pose in zip(run.queries, run.poses, strict=True) if pose}
    moved = [name for name in run.places_before if name in now]
    ends = np.array([now[name] for name in moved]).reshape(-1, 3)
    shift_factor, shifts = _exaggerated(
        ends, np.array([run.places_before[name] for name in moved]).reshape(-1, 3), size
    )
    residuals = [point for point in run.control if point["error"] is not None]
    places = np.array([point["surveyed"] for point in residuals]).reshape(-1, 3)
    errors = np.array([point["error"] for point in residuals]).reshape(-1, 3)
    control_factor, lines = _exaggerated(places, places + errors, size)
    shift = np.tile(origin, 2)
    return {"shiftFactor": shift_factor, "controlFactor": control_factor}, {
        "shifts": shifts - shift,
        "controlResiduals": lines - shift,
        "controlIsNew": np.array([point["photos"] == "new" for point in residuals], np.uint8),
        **_overlap(run),
    }


def _exaggerated(begins: Array, ends: Array, size: float) -> tuple[float, Array]:
    """Returns a factor (1, 2, 5, 10 and so on) and lines, n x 6, that are this many times as long."""
    lengths = np.linalg.norm(ends - begins, axis=1)
    typical = float(np.quantile(lengths, 0.9)) if len(lengths) else 0.0
    factor = 1.0
    if typical > 0:
        power = 10 ** math.floor(math.log10(max(LENGTH * size / typical, 1)))
        factor = max(step * power for step in (1, 2, 5) if step * power <= max(LENGTH * size / typical, 1))
    return factor, np.concatenate([begins, begins + factor * (ends - begins)], axis=1)


def _overlap(run: Run) -> dict[str, Array]:
    """Returns which new photos share matches with database images, and with each other: pairs of indices."""
    index = {name: i for i, name in enumerate(run.names)}
    with_database, with_others = [], set()
    for i, result in enumerate(run.queries):
        if run.poses[i] is None or "epoch" not in result:
            continue
        for pair in result["pairs"]:
            if pair["num_inliers"] == 0:
                continue  # a chain of matches leads there
            if pair["name"] in run.database_index:
                with_database.append((i, run.database_index[pair["name"]]))
            elif (other := index.get(pair["name"])) is not None:
                with_others.add((min(i, other), max(i, other)))
    return {
        "overlapDatabase": np.array(with_database, np.uint32).reshape(-1, 2),
        "overlapQueries": np.array(sorted(with_others), np.uint32).reshape(-1, 2),
    }
