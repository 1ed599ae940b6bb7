"""Runs tasks on threads and hands out their results in order of completion."""

import queue
import sys
import threading
from collections.abc import Callable, Iterator, Sequence

from colmap_lazyloc.result import Result

NUM_WAITING = 4  # results per thread that may wait for the caller, so that a slow one does not fill the memory


def run_tasks(
    tasks: Sequence[Callable[[], list[Result]]], num_threads: int, num_results: int, progress: bool
) -> Iterator[Result]:
    """Runs the tasks; an exception of one is raised to the caller. No task begins once the generator is closed."""
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
    num_running, num_done, num_localized = num_threads, 0, 0
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
                num_done += 1
                num_localized += result.is_localized
                if progress:
                    line = f"\r{num_done} of {num_results}, {num_localized} localized"
                    print(line, end="", file=sys.stderr, flush=True)
                yield result
    finally:
        stop.set()
        for _ in threads:
            slots.release()
        for thread in threads:
            if thread.ident is not None:
                thread.join()
        if progress:
            print(file=sys.stderr)
