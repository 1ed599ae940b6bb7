"""Runs COLMAP's commands with a progress bar and a log."""

import ctypes
import json
import pathlib
import re
import signal
import subprocess
import time
from collections.abc import Sequence
from typing import Any

from colmap_lazyloc.cluster.task import PR_SET_PDEATHSIG
from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.program import COLOUR
from colmap_lazyloc.progress import terminal_bar

GLOG_PREFIX = re.compile(r"^[IWEF]\d{8} \S+ +\d+ \S+\] ")
STACK_TRACE = re.compile(r"@ +0x|\*\*\* |PC: |terminate called|what\(\): ")  # what follows a failed check of COLMAP


REGISTERED = re.compile(r"Registering image #\d+ \((?:num_reg_frames=)?(\d+)\)")  # of COLMAP 3 or 4
SECONDS_PER_LINE = 30.0  # where there is no bar


class ColmapRunner:
    """Runs commands; all that they print goes to the log."""

    def __init__(self, log_path: pathlib.Path):
        self._log_path = log_path

    def run(self, words: Sequence[object], title: str = "", num_images: int = 0) -> None:
        """Runs a command; raises InputError with its last line, or the one before a stack trace, if it fails.

        `num_images`: that the mapper may register.
        """
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
            bar = ProgressBar(title, num_images)
            has_pose = False
            try:
                assert process.stdout is not None
                for line in process.stdout:
                    log.write(line)
                    result = _result(line)
                    bar.read(line, result)
                    if result.get("position") and not has_pose:
                        has_pose = True
                        x, y, z = result["position"]
                        logger.info(f"first pose: {result['query']} at {x:.3f} {y:.3f} {z:.3f}")
                    text = COLOUR.sub("", line).strip()
                    if text and not STACK_TRACE.match(text):
                        last_line = text
                code = process.wait()
            except BaseException:
                process.terminate()
                process.wait()
                raise
            finally:
                bar.close()
        if code != 0:
            cause = GLOG_PREFIX.sub("", last_line) or "no message"
            raise InputError(f"{pathlib.Path(texts[0]).name} {texts[1]} failed: {cause} (log: {self._log_path})")


class ProgressBar:
    """Shows how far a command is: on a terminal by a bar, elsewhere and without tqdm by a line from time to time."""

    def __init__(self, title: str, num_images: int = 0):
        """`num_images`: that the mapper may register."""
        if title:
            logger.info(title)
        bar = terminal_bar()
        self._bar = None if bar is None else bar(leave=False)
        self._num_images, self._time = num_images, time.monotonic()

    def read(self, line: str, result: dict[str, Any]) -> None:
        """Reads a line of COLMAP, such as `Processed file [3/40]`, or the result of a query."""
        if match := re.search(r"Processed file \[(\d+)/(\d+)\]", line):
            self._show(int(match[1]), int(match[2]), "photos")
        elif match := REGISTERED.search(line):
            self._show(int(match[1]), self._num_images, "photos have poses")
        elif match := re.search(r"\[(\d+)/(\d+)\]", line):
            self._show(int(match[1]), int(match[2]), "blocks")
        elif result:
            self._show(result["done"], result["of"], "queries")

    def _show(self, done: int, total: int, what: str) -> None:
        if self._bar is not None:
            self._bar.n, self._bar.total = done, total
            self._bar.set_postfix_str(what, refresh=True)
        elif time.monotonic() - self._time > SECONDS_PER_LINE:
            self._time = time.monotonic()
            logger.info("%d of %d %s", done, total, what)

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()


def _result(line: str) -> dict[str, Any]:
    """Returns a line of JSON of lazy_localizer, empty for any other line."""
    try:
        content = json.loads(line) if line.startswith("{") else {}
    except ValueError:
        return {}
    return content if {"query", "position", "done", "of"} <= content.keys() else {}
