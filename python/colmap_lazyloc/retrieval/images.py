"""Chooses which images are queries and which are database images."""

import argparse
import dataclasses

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import read_model
from colmap_lazyloc.queries import read_queries, read_query_lines
from colmap_lazyloc.retrieval.descriptors import HdfFile, NpyFile, open_file, read_name_list
from colmap_lazyloc.shards import Shard
from colmap_lazyloc.text_files import Path


@dataclasses.dataclass
class ImageSelection:
    """The images to compare, each list in the order in which descriptors are read."""

    query_file: HdfFile | NpyFile
    query_names: list[str]
    database_file: HdfFile | NpyFile
    database_names: list[str]
    query_lines: dict[str, str]  # of the query list, by name


def select_images(options: argparse.Namespace) -> ImageSelection:
    """Applies the options to the files; throws InputError if there is nothing to compare."""
    query_file = open_file(options.descriptors_path)
    database_file = query_file
    if options.database_descriptors_path is not None:
        database_file = open_file(options.database_descriptors_path)
    lines = {} if options.query_list_path is None else _read_query_list(options.query_list_path)
    database_names = _list_database(options, database_file)
    if options.leave_one_out:
        query_names = list(lines) or database_names
    else:
        database_names = [name for name in database_names if name not in lines]
        query_names = list(lines) or _list_others(query_file, database_names)
    if not database_names:
        raise InputError("no database image is left, because all of them are queries (see --leave_one_out)")
    if options.shard is not None:
        query_names = [name for name in query_names if options.shard.holds(name)]
    for name in [*query_names, *database_names]:
        if name.split() != [name]:
            raise InputError(f"image name '{name}' contains a blank, so that a file of pairs cannot hold it")
    return ImageSelection(query_file, query_names, database_file, database_names, lines)


def _read_query_list(path: Path) -> dict[str, str]:
    read_queries(path)  # checks the lines
    return read_query_lines(path)


def _list_database(options: argparse.Namespace, file: HdfFile | NpyFile) -> list[str]:
    if options.input_path is not None:
        names = sorted(read_model(options.input_path).images)
        if not names:
            raise InputError(f"{options.input_path}: has no images")
    elif options.database_list_path is not None:
        names = sorted(read_name_list(options.database_list_path))
    elif options.database_descriptors_path is not None or options.leave_one_out:
        names = file.list_names()
    else:
        raise InputError("name the database images: --input_path, --database_list_path or --database_descriptors_path")
    if not names:
        raise InputError(f"{file.path}: has no descriptors")
    return names


def _list_others(file: HdfFile | NpyFile, database_names: list[str]) -> list[str]:
    known = set(database_names)
    names = [name for name in file.list_names() if name not in known]
    if not names:
        raise InputError(f"{file.path}: has no descriptors of queries: all of its images are database images")
    return names


def parse_shard(text: str) -> Shard:
    """Parses the option; argparse reports an error as its own."""
    try:
        return Shard.parse(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
