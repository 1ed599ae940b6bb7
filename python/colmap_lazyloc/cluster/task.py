"""Localizes one shard; runs on a worker.

Dask sends this module by value. Workers need only the standard library, the program and the shared folder.
"""

import ctypes
import pathlib
import signal
import subprocess
import sys
import time
from dataclasses import dataclass

PR_SET_PDEATHSIG = 1  # of Linux's prctl
NUM_ERROR_BYTES = 4096
INSTALLED_COMMAND = "import sys; from colmap_lazyloc import commands; sys.exit(getattr(commands, sys.argv.pop(1))())"


class ShardError(RuntimeError):
    """Raised if the program did not finish a shard; the message is the cause, in one line."""


@dataclass(frozen=True)
class ShardTask:
    """Everything that a worker needs to know."""

    program: str | None  # path of colmap; None: the installed package of the worker
    arguments: tuple[str, ...]  # options of lazy_localizer without those of the shard
    folder: str  # of the shard
    shard: str  # I/N
    working_folder: str  # for relative paths


def command_line(program: str | None, name: str) -> list[str]:
    """Returns the words that start a command of ours."""
    return [sys.executable, "-c", INSTALLED_COMMAND, name] if program is None else [program, name]


def localize_shard(task: ShardTask) -> float:
    """Begins or resumes the shard; returns the seconds that it took. The program's output goes to a log next to it."""
    start = time.monotonic()
    words = [*command_line(task.program, "lazy_localizer"), *task.arguments]
    words += ["--output_path", task.folder, "--shard", task.shard, "--resume", "1"]
    prctl = ctypes.CDLL(None).prctl
    with pathlib.Path(f"{task.folder}.log").open("ab") as log:
        log_begin = log.tell()
        try:
            # End the program with the worker, because a worker that takes over cannot write while it runs.
            done = subprocess.run(
                words,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                cwd=task.working_folder,
                check=False,
                preexec_fn=lambda: prctl(PR_SET_PDEATHSIG, signal.SIGKILL),
            )
        except OSError as error:
            raise ShardError(f"{words[0]}: cannot be run: {error.strerror}") from None
    if done.returncode != 0:
        ending = f"signal {-done.returncode}" if done.returncode < 0 else f"exit code {done.returncode}"
        raise ShardError(f"{_last_line(f'{task.folder}.log', log_begin)} ({ending})")
    return time.monotonic() - start


def _last_line(path: str, begin: int) -> str:
    """Returns the last line that the program has written."""
    with pathlib.Path(path).open("rb") as log:
        size = log.seek(0, 2)
        log.seek(max(begin, size - NUM_ERROR_BYTES))
        lines = log.read().decode(errors="backslashreplace").strip().splitlines()
    return lines[-1] if lines else "no message"
