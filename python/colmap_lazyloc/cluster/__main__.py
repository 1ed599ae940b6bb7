"""Divides the queries into shards, localizes the shards on a Dask cluster, and merges the results.

    lazyloc cluster --num_shards 64 --database_path database.db --input_path model \\
        --output_path localized [options of lazy_localizer]

Each shard is a run of `colmap lazy_localizer --shard I/N --resume 1` on a worker. Without --scheduler, the workers are
processes on this machine. All workers must see all files at the same paths. After an interruption, the same command
continues with the unfinished queries.
"""

import argparse
import os
import pathlib
import shutil
import subprocess
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from colmap_lazyloc.cluster.folders import as_ranges, is_same_run, read_manifest
from colmap_lazyloc.cluster.task import ShardTask, command_line
from colmap_lazyloc.errors import InputError, Parser, command, logger, positive_int
from colmap_lazyloc.program import find_colmap

if TYPE_CHECKING:
    from colmap_lazyloc.cluster.engine import Engine

OWN_OPTIONS = ("shard", "resume", "overwrite", "strict", "log_path")  # of lazy_localizer, not for one of many shards


def parse_arguments(arguments: Sequence[str] | None) -> tuple[argparse.Namespace, list[str]]:
    """Returns our options, and the words for lazy_localizer."""
    parser = Parser(
        prog="lazyloc cluster",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
        is_foreign=lambda name: True,  # an option of lazy_localizer, which checks it
    )
    add = parser.add_argument
    add(
        "--num_shards",
        type=positive_int,
        required=True,
        help="number of shards; several shards per worker balance the load",
    )
    add("--output_path", type=pathlib.Path, required=True, help="folder for the merged results")
    add(
        "--shards_path",
        type=pathlib.Path,
        help="folder for the results of the shards; default: the path of --output_path followed by .shards",
    )
    add(
        "--num_workers",
        type=positive_int,
        default=os.cpu_count(),
        help="without --scheduler: number of processes on this machine; default: number of cores",
    )
    add("--scheduler", metavar="ADDRESS", help="address of a Dask scheduler, for example tcp://node1:8786")
    add("--retries", type=int, default=2, help="number of times that a failed shard is run again; default: %(default)s")
    add(
        "--dashboard_address",
        default=":8787",
        help="without --scheduler: address of Dask's dashboard; default: %(default)s",
    )
    add(
        "--program",
        help="path of colmap on the workers; default: the same path as on this machine, or the program in the Python "
        "package",
    )
    options, words = parser.parse_known_args(arguments)
    for word in words:
        name = word.removeprefix("--").split("=")[0]
        if word.startswith("--") and name in OWN_OPTIONS:
            raise InputError(f"option --{name} is not for shards on a cluster")
    return options, words


@command(name="lazyloc cluster", extra="cluster")
def main(arguments: Sequence[str] | None = None) -> int:
    options, words = parse_arguments(arguments)
    import distributed  # noqa: F401, so that it is missed before the packages that it brings

    from colmap_lazyloc.cluster.engine import Engine

    program = options.program or shutil.which(find_colmap())
    if options.shards_path is None:
        options.shards_path = options.output_path.with_name(options.output_path.name + ".shards")
    options.shards_path.mkdir(parents=True, exist_ok=True)
    if options.scheduler is None and not any(word.startswith("--LazyLocalizer.num_threads") for word in words):
        num_threads = max(1, (os.cpu_count() or 1) // options.num_workers)
        words += ["--LazyLocalizer.num_threads", str(num_threads)]
    tasks = make_tasks(options, program, words)
    with Engine(options) as engine:
        logger.info("dashboard: %s", engine.dashboard_link)
        causes = run_shards(engine, tasks)
    for cause, indices in causes.items():
        logger.error("shard%s %s of %d: %s", "s" * (len(indices) > 1), as_ranges(indices), len(tasks), cause)
    return 1 if causes else _merge(options, program)


def make_tasks(options: argparse.Namespace, program: str | None, words: list[str]) -> dict[int, ShardTask]:
    """Returns the tasks by index of the shard."""
    count = options.num_shards
    return {
        index: ShardTask(
            program=program,
            arguments=tuple(words),
            folder=str(options.shards_path.absolute() / str(index)),
            shard=f"{index}/{count}",
            working_folder=os.getcwd(),
        )
        for index in range(1, count + 1)
    }


def run_shards(engine: "Engine", tasks: dict[int, ShardTask]) -> dict[str, list[int]]:
    """Localizes the shards that are not finished; returns the indices of those that failed, by cause."""
    finished = {index: read_manifest(pathlib.Path(task.folder)) for index, task in tasks.items()}
    probe = next((index for index, manifest in finished.items() if manifest is not None), None)
    rest = tasks
    if probe is not None:
        # Ask the program about one finished shard: it does it again if options or files have changed.
        causes = engine.run({probe: tasks[probe]}, len(tasks), 0)
        if causes:
            return causes
        current = read_manifest(pathlib.Path(tasks[probe].folder))
        done = {index for index, manifest in finished.items() if manifest and is_same_run(manifest, current)} | {probe}
        rest = {index: task for index, task in tasks.items() if index not in done}
        logger.info("finished before: %d of %d shards", len(done), len(tasks))
    return engine.run(rest, len(tasks), len(tasks) - len(rest))


def _merge(options: argparse.Namespace, program: str | None) -> int:
    words = command_line(program, "lazy_merger")
    words += ["--input_path", str(options.shards_path), "--output_path", str(options.output_path)]
    return subprocess.run(words, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
