"""Chooses the sizes of blocks, so that a search stays within its memory."""

import dataclasses
import pathlib
import resource

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.retrieval.descriptors import CHUNK_BYTES, DescriptorSet
from colmap_lazyloc.retrieval.exact import NUM_QUERIES_AT_ONCE, num_candidates

MAX_NUM_IMAGES = 65536  # per block; larger blocks save no time
MIN_NUM_IMAGES = 1024
MIN_NUM_QUERIES = 256
FAISS_BYTES = 100 << 20  # buffers of faiss and of its linear algebra


@dataclasses.dataclass(frozen=True)
class Plan:
    """Sizes of blocks, and the most memory that the process takes with them."""

    num_queries: int
    num_images: int
    num_passes: int  # over the database images
    max_bytes: int


def make_plan(queries: DescriptorSet, images: DescriptorSet, num_retrieved: int, max_bytes: int) -> Plan:
    """Plans an exact search; throws InputError if the memory is too little."""
    # Count a row twice as in the file, because it may be mapped and copied, and once as a float32 unit vector.
    image_bytes = images.dimension * (2 * images.itemsize + 4) + 16
    query_bytes = queries.dimension * (2 * queries.itemsize + 4) + num_retrieved * 12 + 16
    fixed = used_bytes() + FAISS_BYTES + 3 * CHUNK_BYTES + len(queries.names) * num_retrieved * 4
    fixed += NUM_QUERIES_AT_ONCE * (num_candidates(num_retrieved) + num_retrieved) * 64
    total_queries, total_images = len(queries.names), len(images.names)
    least = fixed + min(MIN_NUM_IMAGES, total_images) * image_bytes + min(MIN_NUM_QUERIES, total_queries) * query_bytes
    if least > max_bytes:
        raise InputError(f"option --memory_gb is too little: at least {least / 1e9:.2f} GB are needed")
    available = max_bytes - fixed
    num_images = max(MIN_NUM_IMAGES, min(MAX_NUM_IMAGES, int(available / 3 / image_bytes)))
    num_images = min(num_images, total_images)
    most_queries = min(total_queries, int((available - num_images * image_bytes) / query_bytes))
    num_passes = -(-total_queries // most_queries)
    num_queries = -(-total_queries // num_passes)  # blocks of equal size
    planned = fixed + num_images * image_bytes + num_queries * query_bytes
    return Plan(num_queries, num_images, num_passes, planned)


def used_bytes() -> int:
    """Returns the memory that the process takes now."""
    pages = int(pathlib.Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize()


def peak_bytes() -> int:
    """Returns the most memory that the process has taken."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
