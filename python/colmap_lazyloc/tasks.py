"""Runs tasks on threads and hands out their results in order of completion."""

import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, NoReturn

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.extras import missing_package
from colmap_lazyloc.result import Result

if TYPE_CHECKING:
    from tqdm import tqdm

NUM_WAITING = 4  # results per thread that may wait for the caller, so that a slow one does not fill the memory


def run_tasks(
    tasks: Sequence[Callable[[], list[Result]]], num_threads: int, num_results: int, progress: bool
) -> Iterator[Result]:
    """Runs the tasks; an exception of one is raised to the caller. No task begins once the generator is closed."""
    bar = _make_bar(num_results) if progress else None
    done: queue.SimpleQueue[list[Result] | BaseException | None] = queue.SimpleQueue()
    remaining, lock, stop = iter(tasks), threading.Lock(), threading.Event()
    num_threads = min(num_threads, len(tasks))
    slots = threading.Semaphore(NUM_WAITING * num_threads)

    def work() -> None:
        while True:
            slots.acquire()
            with lock:
                task = next(remaining, None)
            if task is None or stop.is_set():
                break
            try:
                done.put(task())
            except BaseException as error:
                done.put(error)
                break
        slots.release()  # for the next thread that waits
        done.put(None)

    threads = [threading.Thread(target=work, name=f"lazyloc {i}") for i in range(num_threads)]
    num_running, num_localized = num_threads, 0
    try:
        for thread in threads:
            thread.start()
        while num_running > 0:
            item = done.get()
            if item is None:
                num_running -= 1
                continue
            if isinstance(item, BaseException):
                raise item
            slots.release()
            for result in item:
                num_localized += result.is_localized
                if bar is not None:
                    bar.set_postfix_str(f"{num_localized} localized", refresh=False)
                    bar.update()
                yield result
    finally:
        stop.set()
        for _ in threads:
            slots.release()
        for thread in threads:
            if thread.is_alive():  # one whose start an interrupt cut short ends by itself
                thread.join()
        if bar is not None:
            bar.close()


def _make_bar(num_results: int) -> "tqdm[NoReturn]":
    try:
        from tqdm import tqdm
    except ImportError as error:
        raise InputError(f"progress: {missing_package(error)}") from None
    return tqdm(total=num_results, unit="query")
