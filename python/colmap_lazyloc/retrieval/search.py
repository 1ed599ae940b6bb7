"""Searches for the nearest database images of all queries."""

import argparse
import functools
import time
from collections.abc import Callable

import faiss
import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.retrieval import exact
from colmap_lazyloc.retrieval.descriptors import DescriptorSet, Value
from colmap_lazyloc.retrieval.plan import make_plan, peak_bytes


class Search:
    """A planned search: describes what it will take, runs, and reports what it took."""

    def __init__(self, queries: DescriptorSet, images: DescriptorSet, options: argparse.Namespace):
        self._queries, self._images, self._options = queries, images, options
        self._ranks = _ranks_by_name(images.names)
        rank_of_name = dict(zip(images.names, self._ranks.tolist()))
        self._own_ranks = np.array([rank_of_name.get(name, -1) for name in queries.names], np.int32)
        has_own = bool(np.any(self._own_ranks >= 0))
        # Find one image more if a query is a database image, because it finds itself.
        self._num_found = min(options.num_retrieved + has_own, len(images.names))
        self._seconds = {"read": 0.0, "search": 0.0}
        self._num_unsure = 0
        if options.num_threads > 0:
            faiss.omp_set_num_threads(options.num_threads)
        self._plan = make_plan(queries, images, self._num_found, int(options.memory_gb * 1e9))

    @property
    def description(self) -> str:
        """The plan, in one line."""
        plan = self._plan
        return (
            f"{len(self._queries.names)} queries x {len(self._images.names)} database images, "
            f"{self._images.dimension} dimensions; blocks of {plan.num_queries} x {plan.num_images}, reads the "
            f"database {plan.num_passes} time(s); at most {plan.max_bytes / 1e9:.2f} GB of memory"
        )

    @property
    def outcome(self) -> str:
        """What the search has taken, in one line."""
        times = {**self._seconds, "CPU": time.process_time()}
        seconds = ", ".join(f"{name} {value:.1f} s" for name, value in times.items())
        unsure = f", {self._num_unsure} block(s) of single queries compared in double precision"
        return f"peak memory {peak_bytes() / 1e9:.2f} GB; {seconds}{unsure}; done"

    def run(self) -> Array:
        """Returns the places of the nearest images in the order of their names, the nearest first; -1 is none."""
        ranks = np.full((len(self._queries.names), self._options.num_retrieved), -1, np.int32)
        for first in range(0, len(self._queries.names), self._plan.num_queries):
            nearest = self._search_all_blocks(first)
            self._without_themselves(first, nearest, ranks[first : first + len(nearest.ranks)])
        return ranks

    def _search_all_blocks(self, first: int) -> exact.Nearest:
        queries = self._timed("read", lambda: self._queries.read(first, first + self._plan.num_queries))
        nearest = exact.Nearest.empty(len(queries.rows), self._num_found)
        for begin in range(0, len(self._images.names), self._plan.num_images):
            end = begin + self._plan.num_images
            images = self._timed("read", functools.partial(self._images.read, begin, end))
            start = time.monotonic()
            self._num_unsure += exact.search_block(queries, images, self._ranks[begin:end], nearest)
            self._seconds["search"] += time.monotonic() - start
            del images  # before the next block is read, because the plan has memory for one
        return nearest

    def _timed(self, name: str, function: Callable[[], Value]) -> Value:
        start = time.monotonic()
        result = function()
        self._seconds[name] = self._seconds.get(name, 0.0) + time.monotonic() - start
        return result

    def _without_themselves(self, first: int, nearest: exact.Nearest, output: Array) -> None:
        """Copies the ranks of a block of queries, without those of the queries themselves."""
        own = self._own_ranks[first : first + len(nearest.ranks)]
        keep = (nearest.ranks != own[:, None]) & (nearest.ranks != exact.NO_RANK)
        order = np.argsort(~keep, axis=1, kind="stable")[:, : output.shape[1]]
        found = np.where(keep, nearest.ranks, -1)
        output[:, : order.shape[1]] = np.take_along_axis(found, order, axis=1)


def _ranks_by_name(names: list[str]) -> Array:
    """Returns the place of each image in the order of the names."""
    order = sorted(range(len(names)), key=names.__getitem__)
    ranks = np.empty(len(names), np.int32)
    ranks[order] = np.arange(len(names), dtype=np.int32)
    return ranks
