"""Tests that the tutorials say what is true: their commands run, in order, on scenes of the project's own."""

import os
import resource
import sys

import pytest

import tutorials
from conftest import PROJECT_PATH

MAX_CPU_SECONDS = 600  # of all pages: five minutes on two cores
used_seconds = {}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Returns the folder in which a reader types everything, one tutorial after the other."""
    return tmp_path_factory.mktemp("tutorials")


@pytest.fixture(scope="module")
def environment(colmap, tmp_path_factory):
    """Returns an environment with the commands colmap, lazyloc and python."""
    commands = tmp_path_factory.mktemp("bin")
    lines = {
        "colmap": f'exec "{colmap}" "$@"',
        "python": f'exec "{sys.executable}" "$@"',
        "lazyloc": f'exec "{sys.executable}" -m colmap_lazyloc "$@"',
    }
    for name, line in lines.items():
        (commands / name).write_text(f"#!/bin/sh\n{line}\n")
        (commands / name).chmod(0o755)
    build = os.environ.get("BUILD_DIR", str(PROJECT_PATH / "build"))
    own = {"COLMAP": str(colmap), "BUILD_DIR": build, "PYTHONPATH": str(PROJECT_PATH / "python")}
    return {**os.environ, **own, "PATH": f"{commands}:{os.environ['PATH']}"}


def cpu_seconds():
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


@pytest.mark.parametrize("page", tutorials.list_pages(), ids=lambda path: path.stem)
def test_page(page, folder, environment):
    before = cpu_seconds()
    for block in tutorials.read_blocks(page):
        tutorials.run_block(block, folder, environment)
    used_seconds[page.stem] = cpu_seconds() - before


def test_all_tutorials_take_at_most_five_minutes_on_two_cores():
    print(used_seconds)
    assert sum(used_seconds.values()) < MAX_CPU_SECONDS


def test_every_tutorial_has_commands():
    for page in tutorials.list_pages():
        assert any(block.language == "sh" for block in tutorials.read_blocks(page)) or page.stem == "index", page


def test_expected_output_is_compared():
    printed = "start\nerror 0.51 mm\n3 of 3\n"
    assert tutorials.find_missing("error 0.7 mm\n...\n3 of 3\n", printed) is None
    assert tutorials.find_missing("3 of 4\n", printed) == "3 of 4"
    assert tutorials.find_missing("3 of 3\nerror 0.51 mm\n", printed) == "error 0.51 mm"
