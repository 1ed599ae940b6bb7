"""Shows how far a long step is, of this package or of a command of COLMAP."""

import re
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from colmap_lazyloc.errors import logger

Item = TypeVar("Item")

PROCESSED = re.compile(r"(?:file|image) \[(\d+)/(\d+)\]")  # extracted, indexed or matched
REGISTERED = re.compile(r"Registering image #\d+ \((?:num_reg_frames=)?(\d+)\)")  # of COLMAP 3 or 4
INITIALIZED = "Initializing with image pair"
BEGINNING = "Finding good initial image pair"
# What COLMAP's mapper does before the first photos have poses, by its log.
PREPARATIONS = {"Loading database": "loading the matches", BEGINNING: "looking for two photos to begin with"}
POSES = "photos have poses"
NEXT_MODEL = "photos have poses; trying to connect the others"
SECONDS_PER_LINE = 30.0  # where there is no bar
SECONDS_PER_TICK = 1.0


def terminal_bar() -> Any:
    """Returns the class tqdm, or None unless it is installed and there is a terminal.

    Elsewhere not even a hidden bar is made, because an interrupt while it is made leaves a traceback.
    """
    if not sys.stderr.isatty():
        return None
    try:
        from tqdm import tqdm
    except ImportError:
        return None
    return tqdm


def progress(items: Iterable[Item], text: str, total: int | None = None) -> Iterable[Item]:
    """Returns the items, with a bar on a terminal if tqdm is installed. `total`: their number, by default their length
    if they have one."""
    bar = terminal_bar()
    shown: Iterable[Item] = items if bar is None else bar(items, desc=text, total=total, leave=False)
    return shown


class ProgressBar:
    """Shows how far a step is, and the time that is left: on a terminal by a bar, elsewhere and without tqdm by a line
    from time to time. Use it in a `with` statement, in which time goes on while a program prints nothing."""

    def __init__(self, title: str, total: int = 0, what: str = ""):
        """`title`: a line that is written first, if it is not empty; `total`, `what`: how many of what the step has to
        do. Without a total, `what` may also say what is being done."""
        if title:
            logger.info(title)
        bar, form = terminal_bar(), _bar_format(total, what)
        self._bar = bar and bar(leave=False, total=total or None, postfix=what or None, bar_format=form)
        self._total = total
        self._shown = 0, total, what
        self._num_poses, self._is_next_model = 0, False  # in the largest model so far; whether there was one before
        self._begin = time.monotonic()
        self._time = self._begin
        self._lock = threading.RLock()
        self._has_ended = threading.Event()
        self._clock = threading.Thread(target=self._tick, daemon=True)

    def __enter__(self) -> "ProgressBar":
        self._clock.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._has_ended.set()
        self._clock.join()
        if self._bar is not None:
            self._bar.close()

    @contextmanager
    def hidden(self) -> Iterator[None]:
        """Takes the bar away while a line is written."""
        with self._lock:
            if self._bar is not None:
                self._bar.clear()
            yield
            if self._bar is not None:
                self._bar.refresh()

    def read(self, line: str, result: dict[str, Any]) -> None:
        """Reads a line of COLMAP, such as `Processed file [3/40]`, or the result of a query."""
        if match := PROCESSED.search(line):
            self.show(int(match[1]), int(match[2]), "photos")
        elif match := REGISTERED.search(line):
            self._show_poses(int(match[1]))
        elif INITIALIZED in line:
            self._show_poses(2)
        elif BEGINNING in line and self._num_poses > 2:  # the mapper has found more than two to begin with
            self._is_next_model = True
            self._show_poses(0)
        elif text := next((text for part, text in PREPARATIONS.items() if part in line), None):
            self.show(0, self._total, text)
        elif result:
            self.show(result["done"], result["of"], "queries")

    def _show_poses(self, count: int) -> None:
        """Shows how many photos have poses in the largest model; `count`: in the one that grows."""
        self._num_poses = max(self._num_poses, count)
        is_smaller = self._is_next_model and count < self._num_poses
        self.show(self._num_poses, self._total, NEXT_MODEL if is_smaller else POSES)

    def show(self, done: int, total: int, what: str) -> None:
        """Shows that this many are done; if none is, `what` may also say what is being done."""
        with self._lock:
            self._shown = done, total, what
            if self._bar is not None:
                self._bar.n, self._bar.total = done, total
                self._bar.bar_format = _bar_format(total, what)
                self._bar.set_postfix_str(what, refresh=True)
            else:
                self._write_line()

    def _tick(self) -> None:
        while not self._has_ended.wait(SECONDS_PER_TICK):
            with self._lock:
                if self._bar is not None:
                    self._bar.refresh()
                else:
                    self._write_line()

    def _write_line(self) -> None:
        """Writes a line, if the last one is not too recent."""
        now = time.monotonic()
        if now - self._time <= SECONDS_PER_LINE:
            return
        self._time, passed = now, now - self._begin
        done, total, what = self._shown
        if total == 0 or what in PREPARATIONS.values():
            logger.info("%s%s passed", f"{what}: " if what else "", _duration(passed))
            return
        has_end = 0 < done < total and what != NEXT_MODEL
        left = f", about {_duration(passed / done * (total - done))} left" if has_end else ""
        logger.info("%d of %d %s%s", done, total, what, left)


def _bar_format(total: int, what: str) -> str | None:
    """Returns the format of a bar without a total, in which only the time goes on; None for tqdm's own format."""
    return None if total else f"{what} [{{elapsed}}]".strip()


def _duration(seconds: float) -> str:
    minutes = round(seconds / 60)
    return f"{round(seconds)} s" if seconds < 90 else f"{minutes} min" if minutes < 90 else f"{minutes / 60:.1f} h"
