"""Verified matches of a COLMAP database, which is opened read-only: the same for every method."""

import dataclasses

import numpy as np

from benchmarks.localization.scenes import Scene
from colmap_lazyloc.database import DatabaseReader

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


class MatchDatabase(DatabaseReader):
    def query_matches(self, scene: Scene, query_name: str, num_retrieved: int) -> QueryMatches:
        """Returns the `num_retrieved` pairs of the query and a database image with the most verified inliers."""
        num_inliers = {name: self.num_inliers(query_name, name) for name in scene.database_names(query_name)}
        names = [name for name in num_inliers if num_inliers[name] >= MIN_NUM_INLIERS]
        names = sorted(names, key=lambda name: (-num_inliers[name], name))[:num_retrieved]
        pairs = []
        for name in names:
            matches = self.inlier_matches(query_name, name)
            pairs.append(PairMatches(name, matches[:, 0], matches[:, 1]))
        return QueryMatches(self.keypoints(query_name), pairs, {name: self.keypoints(name) for name in names})
