"""Runs the tasks of shards on Dask."""

import argparse
import logging
from collections.abc import Callable

import cloudpickle
import dask
import distributed
from tqdm import tqdm

from colmap_lazyloc.cluster import task as task_module
from colmap_lazyloc.cluster.task import ShardTask, localize_shard
from colmap_lazyloc.errors import InputError

MAX_NUM_DEATHS = 10  # of workers that had the same shard, before it fails
CONNECT_SECONDS = 10


class Engine:
    """A client of a Dask cluster: of the given scheduler, or of one with workers on this machine."""

    def __init__(self, options: argparse.Namespace):
        self._retries = options.retries
        self._cluster = None if options.scheduler is not None else _start_workers(options)
        try:
            self._client = distributed.Client(self._cluster or options.scheduler, timeout=CONNECT_SECONDS)
        except (OSError, ValueError) as error:
            raise InputError(f"--scheduler {options.scheduler}: {str(error).splitlines()[0]}") from None

    def __enter__(self) -> "Engine":
        return self

    def __exit__(self, *_: object) -> None:
        self._client.close()
        if self._cluster is not None:
            self._cluster.close()

    @property
    def dashboard_link(self) -> str:
        return str(self._client.dashboard_link)

    def run(self, tasks: dict[int, ShardTask], total: int, num_done: int) -> dict[str, list[int]]:
        """Localizes shards; returns the indices of those that failed, by cause. The others finish all the same."""
        futures = {self._submit(task): index for index, task in tasks.items()}
        failed: dict[str, list[int]] = {}
        with tqdm(total=total, initial=num_done, unit="shard", disable=not tasks) as bar:
            for future in distributed.as_completed(futures):
                if future.status != "finished":
                    failed.setdefault(_cause(future), []).append(futures[future])
                bar.update()
        return {cause: sorted(indices) for cause, indices in failed.items()}

    def _submit(self, task: ShardTask) -> "distributed.Future[float]":
        # The key has the folder, because other runs may use the scheduler at the same time.
        key = f"{task.folder} {task.shard}"
        return self._client.submit(portable_call(task), key=key, retries=self._retries)


def portable_call(task: ShardTask) -> Callable[[], float]:
    """Returns a function without arguments for workers, which may not have our package."""
    cloudpickle.register_pickle_by_value(task_module)
    return lambda: localize_shard(task)  # not the function itself, because Dask sends that by its name


def _start_workers(options: argparse.Namespace) -> distributed.LocalCluster:
    """Starts worker processes on this machine, each of which localizes one shard at a time."""
    dask.config.set({"distributed.scheduler.allowed-failures": MAX_NUM_DEATHS})
    try:
        return distributed.LocalCluster(
            n_workers=options.num_workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=options.dashboard_address,
            memory_limit=None,
            silence_logs=logging.CRITICAL,  # failures are reported at the end
        )
    except RuntimeError as error:
        raise InputError(f"the workers cannot be started: {error}") from None


def _cause(future: "distributed.Future[float]") -> str:
    error = future.exception()
    if isinstance(error, distributed.KilledWorker):
        return f"{MAX_NUM_DEATHS} workers ended while they localized it"
    return str(error).splitlines()[0] if str(error) else type(error).__name__
