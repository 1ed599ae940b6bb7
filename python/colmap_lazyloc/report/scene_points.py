"""Chooses the points that a scene shows, and which query sees which."""

import dataclasses

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.report.run import Run

NUM_SUBSETS = 61


@dataclasses.dataclass(frozen=True)
class ScenePoints:
    """Points of the scene, and those of each query."""

    chosen: Array  # p: indices of the run's points
    xyz: Array  # p x 3, in the world
    colors: Array  # p x 3, or empty
    offsets: Array  # n + 1: query i has indices[offsets[i] : offsets[i + 1]]
    indices: Array


def choose_points(run: Run, max_num_points: int) -> ScenePoints:
    """Chooses at most this many points, evenly over the queries; every 61st of the run comes first, and so on, so that
    any number of the first ones shows the whole scene."""
    owners, indices = _observed_points(run)
    is_shown = _thinned(owners, indices, len(run.points), max_num_points)
    chosen = np.flatnonzero(is_shown)
    chosen = chosen[np.argsort(np.arange(len(chosen)) % NUM_SUBSETS, kind="stable")]
    place = np.full(len(run.points), -1)
    place[chosen] = np.arange(len(chosen))
    kept = is_shown[indices]
    owners, indices = owners[kept], place[indices[kept]]
    order = np.lexsort((indices, owners))
    offsets = np.searchsorted(owners, np.arange(len(run.queries) + 1))
    return ScenePoints(
        chosen,
        run.points.xyz[chosen],
        np.empty((0, 3), np.uint8),
        offsets.astype(np.uint32),
        indices[order].astype(np.uint32),
    )


def _observed_points(run: Run) -> tuple[Array, Array]:
    """Returns (query, index of a point that it sees), by query."""
    owners, ids = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    for i, result in enumerate(run.queries):
        if result["status"] != "LOCALIZED":
            continue
        seen = run.model.images[result["name"]].points2d["point3d_id"]
        seen = seen[seen != -1]
        ids.append(seen)
        owners.append(np.full(len(seen), i))
    indices = run.points.find(np.concatenate(ids))
    if np.any(indices < 0):
        raise InputError(f"{run.path / 'model'}: images.bin names points that points3D.bin does not have")
    return np.concatenate(owners), indices


def _thinned(owners: Array, indices: Array, num_points: int, max_num_points: int) -> Array:
    """Returns which points are kept: at most as many of each query as all of them leave room for."""
    if num_points <= max_num_points:
        return np.ones(num_points, bool)
    order = np.lexsort((np.random.default_rng(0).random(len(owners)), owners))
    rank = np.empty(len(owners), np.int64)
    rank[order] = np.arange(len(owners)) - np.searchsorted(owners, owners[order])
    # A point that several queries see is kept if any of them keeps it.
    best_rank = np.full(num_points, np.iinfo(np.int64).max)
    np.minimum.at(best_rank, indices, rank)
    limit = np.sort(best_rank)[max_num_points]  # this rank and higher ones leave too many points
    is_kept: Array = best_rank < limit
    return is_kept
