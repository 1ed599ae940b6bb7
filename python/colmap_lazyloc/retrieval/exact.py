"""Finds the database images with the most similar descriptors by exact search in blocks.

faiss finds candidates in single precision. Those that its rounding errors cannot rule out are compared in double
precision, so that the result does not depend on blocks, shards or threads. The similarity is the cosine of the angle
between two descriptors. Of equally similar images, those whose names come first are taken.
"""

import dataclasses

import faiss
import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.retrieval.descriptors import CHUNK_BYTES, Block

NUM_QUERIES_AT_ONCE = 4096  # per call of faiss
NO_RANK = np.iinfo(np.int32).max


@dataclasses.dataclass
class Nearest:
    """The most similar database images of each query so far, the best first: n x number retrieved."""

    similarities: Array  # float64, -inf for none
    ranks: Array  # int32, the places of the images in the order of their names; NO_RANK for none

    @staticmethod
    def empty(num_queries: int, num_retrieved: int) -> "Nearest":
        shape = (num_queries, num_retrieved)
        return Nearest(np.full(shape, -np.inf), np.full(shape, NO_RANK, np.int32))

    def update(self, queries: Array, similarities: Array, ranks: Array) -> None:
        """Merges candidates of some queries, which are given by their indices."""
        similarities = np.concatenate([self.similarities[queries], similarities], axis=1)
        ranks = np.concatenate([self.ranks[queries], ranks], axis=1)
        order = np.lexsort((ranks, -similarities), axis=1)[:, : self.ranks.shape[1]]
        self.similarities[queries] = np.take_along_axis(similarities, order, axis=1)
        self.ranks[queries] = np.take_along_axis(ranks, order, axis=1)


def num_candidates(num_retrieved: int) -> int:
    """Returns how many candidates faiss finds per query and block: some more than needed, because of its rounding."""
    return 2 * num_retrieved + 16


def search_block(queries: Block, images: Block, ranks: Array, nearest: Nearest) -> int:
    """Updates `nearest` by a block of database images; returns how many queries had more candidates than faiss gave.

    `ranks`: the places of the block's images in the order of the names of all database images.
    """
    num_unsure = 0
    for first in range(0, len(queries.rows), NUM_QUERIES_AT_ONCE):
        part = np.arange(first, min(first + NUM_QUERIES_AT_ONCE, len(queries.rows)))
        num_unsure += _search_part(queries, part, images, ranks, nearest)
    return num_unsure


def _search_part(queries: Block, part: Array, images: Block, ranks: Array, nearest: Nearest) -> int:
    num_retrieved, num_images = nearest.ranks.shape[1], len(images.rows)
    count = min(num_candidates(num_retrieved), num_images)
    found, places = faiss.knn(queries.units[part[0] : part[-1] + 1], images.units, count, faiss.METRIC_INNER_PRODUCT)
    error = max_rounding_error(images.rows.shape[1])
    bound = nearest.similarities[part, -1]
    if num_retrieved <= count:
        bound = np.maximum(bound, found[:, num_retrieved - 1].astype(np.float64) - error)
    is_candidate = found >= (bound - error)[:, None]
    is_unsure = is_candidate[:, -1] & (count < num_images)
    is_candidate[is_unsure] = False
    rows, columns = np.nonzero(is_candidate)
    similarities = np.full(found.shape, -np.inf)
    candidate_ranks = np.full(found.shape, NO_RANK, np.int32)
    similarities[rows, columns] = cosines(queries, part[rows], images, places[rows, columns])
    candidate_ranks[rows, columns] = ranks[places[rows, columns]]
    concerned = np.flatnonzero(is_candidate.any(axis=1))
    nearest.update(part[concerned], similarities[concerned], candidate_ranks[concerned])
    for query in part[is_unsure]:
        _search_completely(queries, query, images, ranks, nearest)
    return int(is_unsure.sum())


def _search_completely(queries: Block, query: int, images: Block, ranks: Array, nearest: Nearest) -> None:
    """Compares a query with the whole block in double precision."""
    num_images = len(images.rows)
    similarities = cosines(queries, np.full(num_images, query), images, np.arange(num_images))
    nearest.update(np.array([query]), similarities[None, :], ranks[None, :])


def max_rounding_error(dimension: int) -> float:
    """Bounds the error of a scalar product of unit vectors that were rounded to single precision, in any order."""
    return (dimension + 8) * 2.0**-24


def cosines(queries: Block, query_rows: Array, images: Block, image_rows: Array) -> Array:
    """Returns the cosines between pairs of descriptors in double precision.

    Sums the products of each pair by itself, because a matrix product would depend on the size of the block.
    """
    result = np.empty(len(query_rows))
    step = max(1, CHUNK_BYTES // (16 * images.rows.shape[1]))
    for first in range(0, len(result), step):
        q, i = query_rows[first : first + step], image_rows[first : first + step]
        products = queries.rows[q].astype(np.float64)
        products *= images.rows[i]
        result[first : first + step] = products.sum(axis=1) / (queries.norms[q] * images.norms[i])
    return result
