"""What clients can use: the bounds of a request, and the places of photos that run, wait and are in memory."""

import asyncio
import concurrent.futures
import dataclasses
import functools
import math
import time
from collections.abc import Callable
from typing import TypeVar

from fastapi import HTTPException, Request
from starlette.requests import ClientDisconnect

_T = TypeVar("_T")


@dataclasses.dataclass(frozen=True)
class Limits:
    """What one request, and all together, may use."""

    max_bytes: int  # of a request's body
    max_pixels: int  # of a photo
    max_queue: int  # photos that wait for a localization
    max_seconds: float  # from the head of a request to its answer


class Queue:
    """Lets as many localizations run as there are threads, and as many photos wait as the limits allow.

    Bodies in memory are bounded by what running and waiting photos may have, whoever sends them, and pixels by the
    number of threads.
    """

    def __init__(self, num_threads: int, limits: Limits):
        self.num_threads, self._limits = num_threads, limits
        self._threads = concurrent.futures.ThreadPoolExecutor(num_threads, "lazyloc")
        self._slots = asyncio.Semaphore(num_threads)
        self._num_running = self._num_waiting = self._num_bytes = 0
        self._last_seconds = 0.0  # of a localization

    def close(self) -> None:
        """Waits for the localizations that run."""
        self._threads.shutdown()

    def gauges(self) -> dict[str, tuple[str, float]]:
        """Returns help and value of what the metrics show."""
        return {
            "running": ("Localizations that run.", self._num_running),
            "queue_length": ("Photos that wait for a localization.", self._num_waiting),
            "queue_limit": ("Photos that may wait.", self._limits.max_queue),
            "received_bytes": ("Bytes of the requests in memory.", self._num_bytes),
        }

    def receive(self, num_bytes: int) -> None:
        """Counts bytes of a body that come into memory; raises if there are too many of all requests."""
        if self._num_bytes + num_bytes > (self.num_threads + self._limits.max_queue) * self._limits.max_bytes:
            raise self.busy("too many photos are being sent")
        self._num_bytes += num_bytes

    def release(self, num_bytes: int) -> None:
        """Counts bytes that are no longer in memory."""
        self._num_bytes -= num_bytes

    def busy(self, text: str) -> HTTPException:
        """Returns an error that asks to try again when the photos that wait now have been localized."""
        seconds = math.ceil(self._num_waiting * self._last_seconds / self.num_threads)
        return HTTPException(503, text, {"Retry-After": str(max(1, seconds))})

    def check(self) -> None:
        """Raises if no photo may wait any more."""
        if self._slots.locked() and self._num_waiting >= self._limits.max_queue:
            raise self.busy("too many photos are waiting")

    async def run(self, request: Request, localize: Callable[[], _T], deadline: float) -> _T:
        """Waits for a free thread and localizes."""
        self.check()
        self._num_waiting += 1
        try:
            async with asyncio.timeout_at(deadline):
                await self._slots.acquire()
        except TimeoutError:
            raise self.busy("the photo has waited too long") from None
        finally:
            self._num_waiting -= 1
        if await request.is_disconnected():
            self._slots.release()
            raise ClientDisconnect
        self._num_running += 1
        loop, start = asyncio.get_running_loop(), time.monotonic()
        running = loop.run_in_executor(self._threads, localize)
        running.add_done_callback(functools.partial(self._finish, start))
        try:
            async with asyncio.timeout_at(deadline):
                return await asyncio.shield(running)  # a thread cannot be stopped, and keeps its place until it ends
        except TimeoutError:
            raise HTTPException(504, "the localization takes too long") from None

    def _finish(self, start: float, running: asyncio.Future[_T]) -> None:
        self._last_seconds = time.monotonic() - start
        self._num_running -= 1
        self._slots.release()
        if not running.cancelled():
            running.exception()  # is known, even if the request has ended before
