"""Tests that the tutorials say what is true: their commands run, in order, on scenes of the project's own."""

import os
import resource
import subprocess
import sys

import pytest

import tutorials
from conftest import PROJECT_PATH

MAX_CPU_SECONDS = 600  # of all pages: five minutes on two cores, twice what they take
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


def test_all_tutorials_take_at_most_five_minutes():
    print(used_seconds)
    assert sum(used_seconds.values()) < MAX_CPU_SECONDS


def test_every_block_is_run():
    """A page has no command that is only shown; the first one has those of the set-up."""
    first, *pages = tutorials.list_pages()
    assert [block.language for block in tutorials.read_blocks(first)] == ["console", "console"]
    for page in pages:
        blocks = tutorials.read_blocks(page)
        assert any(block.language == "sh" for block in blocks) and tutorials.find_unused(blocks) == [], page


def test_setup_in_a_checkout(colmap):
    _, commands = tutorials.read_setup()
    environment = {**os.environ, "BUILD_DIR": str(colmap.parents[1])}
    commands = commands.replace("$PWD/build", "$BUILD_DIR")  # which may be elsewhere
    done = subprocess.run(
        ["bash", "-euc", f"{commands}\ncommand -v colmap lazyloc; python -m colmap_lazyloc --version"],
        cwd=PROJECT_PATH,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.stdout.splitlines()[:2] == [str(colmap), str(PROJECT_PATH / "scripts" / "lazyloc")], done.stderr


def test_expected_output_is_compared():
    printed = "start\nerror 0.51 mm\n3 of 3\n"
    assert tutorials.find_missing("error 0.7 mm\n...\n3 of 3\n", printed) is None
    assert tutorials.find_missing("3 of 4\n", printed) == "3 of 4"
    assert tutorials.find_missing("3 of 3\nerror 0.51 mm\n", printed) == "error 0.51 mm"
