"""Finds the database images whose global descriptors are most similar to each query, and writes a list of pairs.

    lazyloc retrieve --descriptors_path global.h5 --input_path model --output_path pairs.txt

The descriptors are in an HDF5 file of hloc, or in `NAME.npy` (n x d, float16 or float32) with one image name per row in
`NAME.txt`. `colmap lazy_localizer --pairs_path` and hloc read the list of pairs. The search is exact, not approximate.
"""

import argparse
import pathlib
import sys
import time
from collections.abc import Sequence

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.errors import InputError, Parser, command, logger, positive_int
from colmap_lazyloc.report.output import check_output, write_file
from colmap_lazyloc.retrieval.descriptors import DescriptorSet, describe_set
from colmap_lazyloc.retrieval.images import ImageSelection, parse_shard, select_images


def parse_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(
        prog="lazyloc retrieve",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--descriptors_path", type=pathlib.Path, required=True, help="descriptors of the queries")
    add(
        "--database_descriptors_path",
        type=pathlib.Path,
        help="descriptors of the database images; default: --descriptors_path",
    )
    add("--input_path", type=pathlib.Path, help="folder of a COLMAP model; its images are the database images")
    add("--database_list_path", type=pathlib.Path, help="file with one database image per line, instead of a model")
    add(
        "--query_list_path",
        type=pathlib.Path,
        help="file with one query per line, as for lazy_localizer; default: all images in --descriptors_path that "
        "are not database images",
    )
    add(
        "--leave_one_out",
        action="store_true",
        help="use each database image as a query, and compare it with all other database images",
    )
    add("--output_path", type=pathlib.Path, required=True, help="list of pairs to write: two names per line")
    add(
        "--ordered_query_list_path",
        type=pathlib.Path,
        help="also write the queries in an order in which lazy_localizer reads features less often",
    )
    add(
        "--num_retrieved",
        type=positive_int,
        default=20,
        help="number of database images per query; default: %(default)s",
    )
    add(
        "--shard",
        type=parse_shard,
        metavar="I/N",
        help="process only part I of N of the queries: the same queries as lazy_localizer --shard I/N",
    )
    add("--memory_gb", type=float, default=4, help="maximum memory in gigabytes; default: %(default)s")
    add("--num_threads", type=int, default=-1, help="number of threads; -1: all cores; default: %(default)s")
    return parser.parse_args(arguments)


@command(name="lazyloc retrieve", extra="retrieval")
def main(arguments: Sequence[str] | None = None) -> None:
    options = parse_arguments(arguments)
    _check_packages()
    for path in (options.output_path, options.ordered_query_list_path):
        if path is not None:
            check_output(path, is_folder=False)
    selection = select_images(options)
    ranks: Array = np.empty((0, 0), np.int32)
    if selection.query_names:  # a shard may be empty
        queries = describe_set(selection.query_file, selection.query_names)
        images = describe_set(selection.database_file, selection.database_names)
        if queries.dimension != images.dimension:
            raise InputError(
                f"{queries.file.path}: descriptors have {queries.dimension} elements, but those of the database "
                f"images in {images.file.path} have {images.dimension}"
            )
        ranks = _search(queries, images, options)
    _write(selection, ranks, options)


def _check_packages() -> None:
    """Raises ImportError early, because reading descriptors may take minutes."""
    import faiss  # noqa: F401
    import h5py  # noqa: F401


def _search(queries: DescriptorSet, images: DescriptorSet, options: argparse.Namespace) -> Array:
    """Returns the places of the nearest images in the order of their names, n x num_retrieved; -1 is none."""
    from colmap_lazyloc.retrieval.search import Search

    start = time.monotonic()
    search = Search(queries, images, options)
    logger.info(search.description)
    ranks = search.run()
    logger.info("%s in %.1f s", search.outcome, time.monotonic() - start)
    return ranks


def _write(selection: ImageSelection, ranks: Array, options: argparse.Namespace) -> None:
    """Writes the pairs, the queries ordered by their first retrieved image."""
    names = sorted(selection.database_names)
    queries = selection.query_names
    first_ranks = ranks[:, 0] if ranks.size else [0] * len(queries)
    order = sorted(range(len(queries)), key=lambda query: (first_ranks[query], queries[query]))
    pairs = (f"{queries[query]} {names[rank]}\n".encode() for query in order for rank in ranks[query] if rank >= 0)
    size = write_file(options.output_path, pairs)
    print(f"{options.output_path}: {len(queries)} queries ({size / 1e6:.1f} MB)")
    if options.ordered_query_list_path is not None:
        lines = (f"{selection.query_lines.get(queries[query], queries[query])}\n".encode() for query in order)
        write_file(options.ordered_query_list_path, lines)


if __name__ == "__main__":
    sys.exit(main())
