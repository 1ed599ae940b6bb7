"""Verified matches of a COLMAP database, which is opened read-only: the same for every method."""

import dataclasses
import pathlib
import sqlite3
import urllib.parse

import numpy as np

from scenes import Scene

MAX_NUM_IMAGES = 2147483647  # COLMAP's, in the ids of image pairs
MIN_NUM_INLIERS = 15  # a pair with fewer verified inliers is not used: COLMAP's and the program's default


@dataclasses.dataclass(frozen=True)
class PairMatches:
    """Verified matches of the query with one database image: rows of their keypoints, one row a match."""

    database_name: str
    query_idxs: np.ndarray
    database_idxs: np.ndarray


@dataclasses.dataclass(frozen=True)
class QueryMatches:
    """All that a pose stage starts from: keypoints (x, y in pixels) and the pairs, the best one first."""

    query_points: np.ndarray
    pairs: list[PairMatches]
    database_points: dict[str, np.ndarray]


class MatchDatabase:
    def __init__(self, path: pathlib.Path):
        uri = f"file:{urllib.parse.quote(str(path.resolve()))}?mode=ro"
        self._connection = sqlite3.connect(uri, uri=True)
        self.image_ids = dict(self._connection.execute("SELECT name, image_id FROM images"))
        rows = self._connection.execute("SELECT pair_id, rows FROM two_view_geometries WHERE rows > 0")
        self._num_inliers = dict(rows)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._connection.close()

    def num_inliers(self, name1: str, name2: str) -> int:
        return self._num_inliers.get(self._pair_id(name1, name2), 0)

    def keypoints(self, name: str) -> np.ndarray:
        """x, y of the keypoints, n x 2."""
        query = "SELECT rows, cols, data FROM keypoints WHERE image_id = ?"
        row = self._connection.execute(query, (self.image_ids[name],)).fetchone()
        if row is None or row[0] == 0:
            return np.empty((0, 2))
        return np.frombuffer(row[2], dtype=np.float32).reshape(row[0], row[1])[:, :2].astype(np.float64)

    def inlier_matches(self, name1: str, name2: str) -> np.ndarray:
        """Keypoint rows, m x 2: of the first image, of the second one."""
        query = "SELECT rows, data FROM two_view_geometries WHERE pair_id = ? AND rows > 0"
        row = self._connection.execute(query, (self._pair_id(name1, name2),)).fetchone()
        if row is None:
            return np.empty((0, 2), dtype=np.int64)
        matches = np.frombuffer(row[1], dtype=np.uint32).reshape(row[0], 2).astype(np.int64)
        return matches if self.image_ids[name1] < self.image_ids[name2] else matches[:, ::-1]

    def query_matches(self, scene: Scene, query_name: str, num_retrieved: int) -> QueryMatches:
        """Of the query's pairs with its database images, the `num_retrieved` with the most verified inliers."""
        num_inliers = {name: self.num_inliers(query_name, name) for name in scene.database_names(query_name)}
        names = [name for name in num_inliers if num_inliers[name] >= MIN_NUM_INLIERS]
        names = sorted(names, key=lambda name: (-num_inliers[name], name))[:num_retrieved]
        pairs = []
        for name in names:
            matches = self.inlier_matches(query_name, name)
            pairs.append(PairMatches(name, matches[:, 0], matches[:, 1]))
        return QueryMatches(self.keypoints(query_name), pairs, {name: self.keypoints(name) for name in names})

    def _pair_id(self, name1: str, name2: str) -> int:
        ids = sorted((self.image_ids[name1], self.image_ids[name2]))
        return MAX_NUM_IMAGES * ids[0] + ids[1]
