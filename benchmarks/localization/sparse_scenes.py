"""Makes scenes in which each query has only K database images, with or without points in common.

Each query becomes a new image of a copy of the database, with its own matches, because an image that is a database
image of another query must keep its matches there.
"""

import dataclasses
import pathlib

import numpy as np
import pycolmap

from benchmarks.localization.colmap_files import copy_database
from benchmarks.localization.matches import MatchDatabase, PairMatches
from benchmarks.localization.scenes import Protocol, Scene

SUFFIX = ".query"  # of the names of the new images


@dataclasses.dataclass(frozen=True)
class SparseScene(Scene):
    """A scene whose queries have database images of their own."""

    chosen: dict[str, list[str]] = dataclasses.field(default_factory=dict)

    def database_names(self, query_name: str) -> list[str]:
        return self.chosen[query_name]


def make_sparse_scene(
    scene: Scene, num_images: int, is_star: bool, folder: pathlib.Path, max_num_queries: int | None = None
) -> SparseScene:
    """Writes the database into a folder. is_star: no keypoint of a query has matches in two database images, and these
    have no matches with each other. max_num_queries: of the scene, evenly spread; None for all."""
    images, chosen = dict(scene.images), {}
    path = folder / "database.db"
    copy_database(scene, path)
    (folder / "images").mkdir()  # COLMAP's mapper wants a folder, but reads no image
    with MatchDatabase(scene.database_path) as source, pycolmap.Database.open(path) as database:
        if is_star:
            database.clear_matches()
            database.clear_two_view_geometries()
        for name in _spread(scene.query_names, max_num_queries):
            pairs = source.query_matches(scene, name, num_images).pairs
            if len(pairs) < num_images:
                continue
            pairs = split_keypoints(pairs) if is_star else pairs
            _add_query(database, name, pairs)
            images[name + SUFFIX] = dataclasses.replace(scene.images[name], name=name + SUFFIX)
            chosen[name + SUFFIX] = sorted(pair.database_name for pair in pairs)
    return SparseScene(
        scene.name, folder, Protocol(leave_one_out=False), scene.cameras, images, tuple(sorted(chosen)), chosen=chosen
    )


def split_keypoints(pairs: list[PairMatches]) -> list[PairMatches]:
    """Keeps one match of each query keypoint: that in the image which has the fewest until then."""
    images_of_keypoint: dict[int, list[int]] = {}
    for i, pair in enumerate(pairs):
        for keypoint in pair.query_idxs.tolist():
            images_of_keypoint.setdefault(keypoint, []).append(i)
    owners, counts = {}, [0] * len(pairs)
    for keypoint, candidates in sorted(images_of_keypoint.items(), key=lambda item: (len(item[1]), item[0])):
        owner = min(candidates, key=lambda i: (counts[i], i))
        owners[keypoint] = owner
        counts[owner] += 1
    kept = [np.array([owners[k] == i for k in pair.query_idxs.tolist()], bool) for i, pair in enumerate(pairs)]
    return [
        PairMatches(pair.database_name, pair.query_idxs[mask], pair.database_idxs[mask])
        for pair, mask in zip(pairs, kept)
    ]


def _spread(names: list[str], max_num: int | None) -> list[str]:
    num = min(len(names), max_num or len(names))
    return [names[i * len(names) // num] for i in range(num)]


def _add_query(database: pycolmap.Database, name: str, pairs: list[PairMatches]):
    original = database.read_image_with_name(name)
    query_id = database.write_image(pycolmap.Image(name=name + SUFFIX, camera_id=original.camera_id))
    database.write_keypoints(query_id, database.read_keypoints(original.image_id))
    for pair in pairs:
        other_id = database.read_image_with_name(pair.database_name).image_id
        matches = np.column_stack([pair.query_idxs, pair.database_idxs]).astype(np.uint32)
        geometry = database.read_two_view_geometry(original.image_id, other_id)
        geometry.inlier_matches = matches
        database.write_matches(query_id, other_id, matches)
        database.write_two_view_geometry(query_id, other_id, geometry)
