"""Reads verified matches, the same for every method, from a COLMAP database, which is opened read-only."""

import dataclasses

import numpy as np

from benchmarks.localization.scenes import Scene
from colmap_lazyloc.database import DatabaseReader

MIN_NUM_INLIERS = 15  # minimum number of verified matches of a pair; the default of COLMAP and of lazy_localizer


@dataclasses.dataclass(frozen=True)
class PairMatches:
    """Verified matches of the query with one database image: keypoint indices, one row per match."""

    database_name: str
    query_idxs: np.ndarray
    database_idxs: np.ndarray


@dataclasses.dataclass(frozen=True)
class QueryMatches:
    """The input of a pose stage: keypoints (x, y in pixels) and pairs, the best one first."""

    query_points: np.ndarray
    pairs: list[PairMatches]
    database_points: dict[str, np.ndarray]


class MatchDatabase(DatabaseReader):
    def query_matches(self, scene: Scene, query_name: str, num_retrieved: int) -> QueryMatches:
        """Returns the `num_retrieved` pairs of the query and a database image with the most verified matches."""
        num_inliers = {name: self.num_inliers(query_name, name) for name in scene.database_names(query_name)}
        names = [name for name in num_inliers if num_inliers[name] >= MIN_NUM_INLIERS]
        names = sorted(names, key=lambda name: (-num_inliers[name], name))[:num_retrieved]
        pairs = []
        for name in names:
            matches = self.inlier_matches(query_name, name)
            pairs.append(PairMatches(name, matches[:, 0], matches[:, 1]))
        return QueryMatches(self.keypoints(query_name), pairs, {name: self.keypoints(name) for name in names})
