"""Runs COLMAP's commands with a progress bar and a log."""

import ctypes
import json
import logging
import pathlib
import re
import signal
import subprocess
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from typing import Any

from colmap_lazyloc.cluster.task import PR_SET_PDEATHSIG
from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.program import COLOUR
from colmap_lazyloc.progress import terminal_bar

GLOG_PREFIX = re.compile(r"^[IWEF]\d{8} \S+ +\d+ \S+\] ")
STACK_TRACE = re.compile(r"@ +0x|\*\*\* |PC: |terminate called|what\(\): ")  # what follows a failed check of COLMAP
PROCESSED = re.compile(r"(?:file|image) \[(\d+)/(\d+)\]")  # extracted, indexed or matched
REGISTERED = re.compile(r"Registering image #\d+ \((?:num_reg_frames=)?(\d+)\)")  # of COLMAP 3 or 4
INITIALIZED = "Initializing with image pair"
# What COLMAP's mapper does before the first photos have poses, by its log.
PREPARATIONS = {
    "Loading database": "loading the matches",
    "Finding good initial image pair": "looking for two photos to begin with",
}
WARNING = "WARNING: "  # at the beginning of a line
SECONDS_PER_LINE = 30.0  # where there is no bar
SECONDS_PER_TICK = 1.0


class ColmapRunner:
    """Runs commands; all that they print goes to the log."""

    def __init__(self, log_path: pathlib.Path):
        self._log_path = log_path

    def run(self, words: Sequence[object], bar: "ProgressBar | None" = None, shown: Sequence[str] = ()) -> None:
        """Runs a command; raises InputError with its last line, or the one before a stack trace, if it fails. Lines
        with one of the texts `shown` are shown to the user, too."""
        texts = [str(word) for word in words]
        last_line = ""
        prctl = getattr(ctypes.CDLL(None), "prctl", None)  # of Linux
        with self._log_path.open("a", encoding="utf-8", errors="backslashreplace") as log:
            log.write(f"$ {' '.join(texts)}\n")
            log.flush()
            try:
                process = subprocess.Popen(
                    texts,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT,
                    text=True,
                    errors="backslashreplace",
                    # End the command with this process, because the next run works on the same database.
                    preexec_fn=lambda: prctl and prctl(PR_SET_PDEATHSIG, signal.SIGKILL),
                )
            except OSError as error:
                raise InputError(f"{texts[0]}: cannot be run: {error.strerror}") from None
            has_pose = False
            try:
                assert process.stdout is not None
                for line in process.stdout:
                    log.write(line)
                    result = _result(line)
                    if bar is not None:
                        bar.read(line, result)
                    if result.get("position") and not has_pose:
                        has_pose = True
                        x, y, z = result["position"]
                        with nullcontext() if bar is None else bar.hidden():
                            logger.info(f"first pose: {result['query']} at {x:.3f} {y:.3f} {z:.3f}")
                    text = COLOUR.sub("", line).strip()
                    if any(part in text for part in shown):
                        with nullcontext() if bar is None else bar.hidden():
                            is_warning = text.startswith(WARNING)
                            logger.log(logging.WARNING if is_warning else logging.INFO, text.removeprefix(WARNING))
                    if text and not STACK_TRACE.match(text):
                        last_line = text
                code = process.wait()
            except BaseException:
                process.terminate()
                process.wait()
                raise
        if code != 0:
            cause = GLOG_PREFIX.sub("", last_line) or "no message"
            raise InputError(f"{pathlib.Path(texts[0]).name} {texts[1]} failed: {cause} (log: {self._log_path})")


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
            self.show(int(match[1]), self._total, "photos have poses")
        elif INITIALIZED in line:
            self.show(2, self._total, "photos have poses")
        elif text := next((text for part, text in PREPARATIONS.items() if part in line), None):
            self.show(0, self._total, text)
        elif result:
            self.show(result["done"], result["of"], "queries")

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
        left = f", about {_duration(passed / done * (total - done))} left" if 0 < done < total else ""
        logger.info("%d of %d %s%s", done, total, what, left)


def _bar_format(total: int, what: str) -> str | None:
    """Returns the format of a bar without a total, in which only the time goes on; None for tqdm's own format."""
    return None if total else f"{what} [{{elapsed}}]".strip()


def _duration(seconds: float) -> str:
    minutes = round(seconds / 60)
    return f"{round(seconds)} s" if seconds < 90 else f"{minutes} min" if minutes < 90 else f"{minutes / 60:.1f} h"


def _result(line: str) -> dict[str, Any]:
    """Returns a line of JSON of lazy_localizer, empty for any other line."""
    try:
        content = json.loads(line) if line.startswith("{") else {}
    except ValueError:
        return {}
    return content if {"query", "position", "done", "of"} <= content.keys() else {}
