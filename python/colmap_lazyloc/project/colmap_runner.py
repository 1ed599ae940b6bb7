"""Runs COLMAP's commands with a progress bar and a log."""

import ctypes
import json
import logging
import pathlib
import re
import signal
import subprocess
from collections.abc import Sequence
from contextlib import nullcontext
from typing import Any

from colmap_lazyloc.cluster.task import PR_SET_PDEATHSIG
from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.program import COLOUR
from colmap_lazyloc.progress import ProgressBar

GLOG_PREFIX = re.compile(r"^[IWEF]\d{8} \S+ +\d+ \S+\] ")
STACK_TRACE = re.compile(r"@ +0x|\*\*\* |PC: |terminate called|what\(\): ")  # what follows a failed check of COLMAP
WARNING = "WARNING: "  # at the beginning of a line


class ColmapRunner:
    """Runs commands; all that they print goes to the log."""

    def __init__(self, log_path: pathlib.Path):
        self._log_path = log_path

    def run(self, words: Sequence[object], bar: ProgressBar | None = None, shown: Sequence[str] = ()) -> None:
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


def _result(line: str) -> dict[str, Any]:
    """Returns a line of JSON of lazy_localizer, empty for any other line."""
    try:
        content = json.loads(line) if line.startswith("{") else {}
    except ValueError:
        return {}
    return content if {"query", "position", "done", "of"} <= content.keys() else {}
