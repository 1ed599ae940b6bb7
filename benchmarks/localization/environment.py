"""Describes the date, the machine and the commit of a run."""

import datetime
import os
import pathlib
import platform
import subprocess

import pycolmap


def describe_environment() -> list[str]:
    return [
        f"{datetime.datetime.now(datetime.UTC):%Y-%m-%d}, commit {_commit()}",
        f"{_processor()}, {os.cpu_count()} cores, {platform.system()}; Python {platform.python_version()}, "
        f"pycolmap {pycolmap.__version__}",
    ]


def _commit() -> str:
    folder = pathlib.Path(__file__).resolve().parent

    def git(*arguments):
        return subprocess.run(["git", "-C", folder, *arguments], capture_output=True, text=True, check=True).stdout

    try:
        commit = git("rev-parse", "--short=10", "HEAD").strip()
        return commit + (" with changes" if git("status", "--porcelain", "--untracked-files=no").strip() else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def _processor() -> str:
    cpuinfo = pathlib.Path("/proc/cpuinfo")
    for line in cpuinfo.read_text().splitlines() if cpuinfo.exists() else []:
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
