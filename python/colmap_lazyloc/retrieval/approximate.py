"""Finds candidates by an inverted file with product quantization (IVF/PQ) and compares them exactly.

For databases that are too large for exact search. Jégou, Douze, Schmid, Product Quantization for Nearest Neighbor
Search, PAMI 2011.
"""

import contextlib
import dataclasses
import hashlib
import os
import pathlib
from collections.abc import Iterator

import faiss
import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.report.output import replacing
from colmap_lazyloc.retrieval.descriptors import CHUNK_BYTES, Block, DescriptorSet
from colmap_lazyloc.retrieval.exact import NO_RANK, Nearest, cosines
from colmap_lazyloc.retrieval.plan import FAISS_BYTES, used_bytes

MAGIC = "colmap_lazyloc descriptor index 1"
MAX_CODE_BYTES = 64  # per image
BITS = 8  # of each part of a code
NUM_CODES = 1 << BITS
MIN_TRAINING_RATIO = 39  # descriptors per list; faiss warns below


@dataclasses.dataclass(frozen=True)
class ApproximatePlan:
    """Sizes of an index and of its search."""

    num_lists: int
    code_bytes: int  # per image
    num_training: int
    num_images: int  # per block
    num_candidates: int  # per query
    num_queries: int  # per block
    max_bytes: int


def make_approximate_plan(
    queries: DescriptorSet, images: DescriptorSet, num_retrieved: int, num_candidates: int, max_bytes: int
) -> ApproximatePlan:
    """Plans an approximate search; throws InputError if the memory is too little."""
    dimension, total = images.dimension, len(images.names)
    code_bytes = max(n for n in range(1, min(MAX_CODE_BYTES, dimension) + 1) if dimension % n == 0)
    num_candidates = min(total, max(num_candidates, num_retrieved + 1))
    image_bytes = dimension * (2 * images.itemsize + 4) + 16
    query_bytes = dimension * (2 * queries.itemsize + 4) + num_candidates * (image_bytes + 64)
    # Count the codes twice, because lists grow by doubling.
    fixed = used_bytes() + FAISS_BYTES + 3 * CHUNK_BYTES + 2 * total * (code_bytes + 8) + total * 8
    fixed += len(queries.names) * num_retrieved * 4
    least = fixed + max(query_bytes, MIN_TRAINING_RATIO * NUM_CODES * dimension * 8 + image_bytes)
    if least > max_bytes:
        raise InputError(f"option --memory_gb is too little: at least {least / 1e9:.2f} GB are needed")
    available = max_bytes - fixed
    num_training = min(total, available // (2 * dimension * 4 + image_bytes))
    num_lists = max(1, min(int(4 * total**0.5), num_training // MIN_TRAINING_RATIO))
    num_training = min(num_training, 64 * num_lists)
    available -= num_lists * dimension * 4
    return ApproximatePlan(
        num_lists,
        code_bytes,
        num_training,
        max(1, min(total, 65536, available // image_bytes)),
        num_candidates,
        max(1, min(len(queries.names), 4096, available // query_bytes)),
        max_bytes,
    )


def make_index(images: DescriptorSet, ranks: Array, plan: ApproximatePlan) -> faiss.IndexIVFPQ:
    """Trains an index on images drawn evenly from the database, and adds all of them. Its ids are places in `images`"""
    quantizer = faiss.IndexFlatIP(images.dimension)
    index = faiss.IndexIVFPQ(
        quantizer, images.dimension, plan.num_lists, plan.code_bytes, BITS, faiss.METRIC_INNER_PRODUCT
    )
    index.cp.spherical = True  # because the descriptors are unit vectors
    by_name = np.argsort(ranks)  # so that the index does not depend on the order in the file
    sample = by_name[np.linspace(0, len(ranks) - 1, plan.num_training).astype(np.int64)]
    training = np.empty((len(sample), images.dimension), np.float32)
    for first in range(0, len(sample), plan.num_images):
        places = sample[first : first + plan.num_images]
        training[first : first + len(places)] = images.read_places(places).units
    index.train(training)
    del training
    for first in range(0, len(images.names), plan.num_images):
        index.add(images.read(first, first + plan.num_images).units)
    return index


def open_index(
    path: pathlib.Path | None, images: DescriptorSet, ranks: Array, plan: ApproximatePlan
) -> faiss.IndexIVFPQ:
    """Reads the index from a file, or makes it and writes the file, if there is a path."""
    header = f"{MAGIC} {_fingerprint(images)}\n".encode()
    if path is not None and path.exists():
        return _read_index(path, header)
    index = make_index(images, ranks, plan)
    if path is not None:
        with replacing(path) as staged, staged.open("wb") as file:
            file.write(header)
            faiss.write_index(index, faiss.PyCallbackIOWriter(file.write))  # type: ignore[attr-defined]
            file.write(MAGIC.encode())
    return index


def _fingerprint(images: DescriptorSet) -> str:
    """Returns a hash of what the index is made from: names, their order, and the size of the file."""
    hashed = hashlib.sha256(f"{images.dimension} {os.path.getsize(images.file.path)}".encode())
    for name in images.names:
        hashed.update(f"\n{name}".encode())
    return hashed.hexdigest()


def _read_index(path: pathlib.Path, header: bytes) -> faiss.IndexIVFPQ:
    with path.open("rb") as file:
        found = file.readline(len(header))
        if not found.startswith(MAGIC.encode()):
            raise InputError(f"{path}: is not a descriptor index (delete it to make it)")
        if found != header:
            raise InputError(f"{path}: belongs to other descriptors (delete it to make it again)")
        with contextlib.suppress(RuntimeError):
            index = faiss.read_index(faiss.PyCallbackIOReader(file.read))  # type: ignore[attr-defined]
            if isinstance(index, faiss.IndexIVFPQ) and file.read() == MAGIC.encode():
                return index
    raise InputError(f"{path}: is truncated or damaged (delete it to make it again)")


def search(
    index: faiss.IndexIVFPQ,
    queries: DescriptorSet,
    images: DescriptorSet,
    ranks: Array,
    plan: ApproximatePlan,
    num_probes: int,
) -> Iterator[tuple[int, Nearest]]:
    """Yields the index of the first query of each block, and the nearest images of the block's queries."""
    index.nprobe = min(num_probes, plan.num_lists)
    for first in range(0, len(queries.names), plan.num_queries):
        yield first, _search_block(index, queries.read(first, first + plan.num_queries), images, ranks, plan)


def _search_block(
    index: faiss.IndexIVFPQ, queries: Block, images: DescriptorSet, ranks: Array, plan: ApproximatePlan
) -> Nearest:
    _, places = index.search(queries.units, plan.num_candidates)
    return _compare(queries, places, images, ranks)


def _compare(queries: Block, places: Array, images: DescriptorSet, ranks: Array) -> Nearest:
    """Sorts the candidates of each query by their exact similarities; -1 in `places` is none."""
    distinct, rows = np.unique(places, return_inverse=True)
    rows = rows.reshape(places.shape)
    if distinct[0] < 0:
        distinct, rows = distinct[1:], rows - 1
    candidates = images.read_places(distinct)
    query_rows, columns = np.nonzero(places >= 0)
    nearest = Nearest.empty(*places.shape)
    similarities = np.full(places.shape, -np.inf)
    candidate_ranks = np.full(places.shape, NO_RANK, np.int32)
    similarities[query_rows, columns] = cosines(queries, query_rows, candidates, rows[query_rows, columns])
    candidate_ranks[query_rows, columns] = ranks[places[query_rows, columns]]
    nearest.update(np.arange(len(places)), similarities, candidate_ranks)
    return nearest
