"""Tests of scripts/checks: each fails on a tree that breaks its rule, names the place, and passes otherwise."""

import pathlib
import re
import subprocess
import sys

import pytest

CHECKS_PATH = pathlib.Path(__file__).resolve().parents[1] / "scripts" / "checks"
SOURCE = "src/colmap_lazyloc"
IDENTITY = ("-c", "user.name=Test", "-c", "user.email=test@localhost")


@pytest.fixture
def write(tmp_path):
    def write_file(name, text):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    return write_file


@pytest.fixture
def check(tmp_path):
    """Runs a check on the test's tree; returns the exit code and what it printed."""

    def run(name):
        command = [sys.executable, CHECKS_PATH / f"{name}.py", "--root", tmp_path]
        done = subprocess.run(command, capture_output=True, text=True)
        assert "Traceback" not in done.stderr, done.stderr
        return done.returncode, done.stdout + done.stderr

    return run


@pytest.mark.parametrize(
    ("file", "included", "is_allowed"),
    [
        ("rotation/a.cc", "math/so3.h", True),
        ("rotation/a.cc", "rotation/b.h", True),
        ("rotation/a.cc", "translation/b.h", False),
        ("refinement/a.h", "structure/b.h", False),
        ("refinement/a.h", "paper/b.h", False),
        ("two_view/a.cc", "bridge/two_view_estimation.h", True),
        ("scene/a.h", "scene/b.h", True),
        ("math/a.h", "scene/b.h", False),
        ("pipeline/a.cc", "refinement/b.h", True),
        ("pipeline/a.cc", "paper/b.h", True),
        ("pipeline/a.cc", "priors/b.h", True),
        ("priors/a.cc", "pipeline/b.h", False),
        ("noise/a.cc", "uncertainty/b.h", False),
        ("pipeline/a.cc", "loading/b.h", False),
        ("pipeline/a.cc", "files/b.h", False),
        ("features/a.cc", "files/b.h", True),
        ("pipeline/a.cc", "cli/b.h", False),
        ("loading/a.cc", "cli/b.h", False),
        ("queries/a.cc", "loading/b.h", False),
        ("runs/a.cc", "results/b.h", False),
        ("structure/a.cc", "testing/b.h", False),
        ("structure/a_test.cc", "testing/b.h", True),
        ("structure/a_test.cc", "pipeline/b.h", False),
        ("priors/a_test.cc", "pipeline/b.h", True),
        ("priors/a_test.cc", "loading/b.h", False),
        ("unheard_of/a.cc", "math/so3.h", False),
    ],
)
def test_layers_are_those_of_the_table(write, check, file, included, is_allowed):
    write(f"{SOURCE}/{file}", f'#pragma once\n#include "colmap_lazyloc/{included}"\n')
    code, text = check("layers")
    assert code == (0 if is_allowed else 1), text
    assert is_allowed or f"{file}:2: " in text


def test_files_of_a_folder_include_each_other_on_at_most_8_levels(write, check):
    write(f"{SOURCE}/noise/a.h", '#include "colmap_lazyloc/noise/a.h"\n')
    for file, included in zip("bcdefgh", "abcdefg", strict=True):
        write(f"{SOURCE}/noise/{file}.h", "")
        write(f"{SOURCE}/noise/{file}.cc", f'#include "colmap_lazyloc/noise/{included}.h"\n')
    assert check("layers")[0] == 0
    write(f"{SOURCE}/noise/i.cc", '#include "colmap_lazyloc/noise/h.h"\n')
    code, text = check("layers")
    assert code == 1 and "noise/i includes files of noise/ on more than 8 levels" in text


@pytest.mark.parametrize("file", [f"{SOURCE}/structure/a.cc", f"{SOURCE}/cli/a.cc", "benchmarks/runtime/a.cc"])
def test_layers_keep_colmap_in_the_bridge(write, check, file):
    write(f"{SOURCE}/bridge/a.cc", "#include <colmap/scene/camera.h>\n")
    assert check("layers")[0] == 0
    write(file, "#include <colmap/scene/camera.h>\n")
    code, text = check("layers")
    assert code == 1 and "COLMAP's headers" in text and f"{file}:1" in text


def test_links_to_files_and_headings_that_are_there_pass(write, check):
    write(
        "docs/a.md",
        "# The `a_b` option, twice\n\n## Same\n\n## Same\n\n```\n# no heading\n[no link](nowhere.md)\n```\n",
    )
    write(
        "README.md",
        "[a](docs/a.md), [b](docs/a.md#the-a_b-option-twice), [c](docs/a.md#same-1), [d](#here), [e](https://x.y/z)\n"
        "`[code](nowhere.md)` ![image](docs/)\n\n# Here\n",
    )
    assert check("links") == (0, "links: 0 problem(s), 2 files\n")


@pytest.mark.parametrize("link", ["docs/b.md", "docs/a.md#none", "#none", "docs/a.md#no-heading"])
def test_links_that_lead_nowhere_fail(write, check, link):
    write("docs/a.md", "# A\n\n```\n# no heading\n```\n")
    write("README.md", f"# Here\n\nSee [this]({link}).\n")
    code, text = check("links")
    assert code == 1 and "README.md:3: no such" in text and link in text


def test_links_include_the_source_files_that_texts_name(write, check):
    write(f"{SOURCE}/rotation/a.cc", "")
    write("scripts/b.py", "")
    write("CHANGELOG.md", "New: `scripts/former.py`.\n")
    write("docs/a.md", "See `rotation/a.cc`, `scripts/b.py`, `configs/NAME.py` and `c.cc`.\n\n```\nmy/own.py\n```\n")
    assert check("links")[0] == 0
    write("docs/a.md", "See\n`rotation/moved.cc`.\n")
    code, text = check("links")
    assert code == 1 and "a.md:2: no such source file: rotation/moved.cc" in text


ROW = '{"date": "2026-01-02", "commit": "0123456789", "machine": "EPYC", "cells": ["1", "x"]}'
RESULTS = f'{{"walls": {{"columns": ["a", ""], "rows": [{ROW}]}}}}'
TABLE = """<!-- results: page/walls -->

| a |  | measured |
|---|---|---|
| 1 | x | 2026-01-02 0123456 EPYC, earlier method |
"""


@pytest.mark.parametrize(
    ("page", "problem"),
    [
        (TABLE, None),
        (TABLE.replace("| 1 |", "| 2 |"), "differs from its results"),
        (TABLE.replace(", earlier method", ""), "differs from its results"),
        (TABLE.replace("walls", "doors"), "no results page/doors"),
        (TABLE.split("|", maxsplit=1)[0], "without a table"),
        ("Nothing.\n", "no page shows walls"),
    ],
)
def test_tables_are_those_of_the_results(write, check, page, problem):
    write("benchmarks/results/page.json", RESULTS)
    write("docs/page.md", page)
    code, text = check("tables")
    assert (code, problem is None or problem in text) == (0 if problem is None else 1, True), text


def test_tables_take_the_rows_of_a_run(write, tmp_path):
    """Takes a run of a new row: the row that is in the results stays. A table that the page lacks is left out."""
    write("docs/page.md", TABLE)
    write("benchmarks/results/page.json", RESULTS)
    walls = "## Walls\n\n| a | |\n|---|---|\n| 2 | z |\n| PoseLib | y |\n"
    write("run.md", f"# Run\n\n{walls}\n## Doors\n\n| a |\n|---|\n| 1 |\n")
    for command in (["git", "init", "-q"], ["git", "add", "."], ["git", *IDENTITY, "commit", "-q", "-m", "x"]):
        subprocess.run(command, cwd=tmp_path, check=True)
    command = [sys.executable, CHECKS_PATH / "tables.py", "--root", tmp_path, "--take", tmp_path / "run.md"]
    subprocess.run([*command, "--page", "page"], check=True)
    rows = (tmp_path / "docs/page.md").read_text().splitlines()[4:]
    assert rows[0] == "| 1 | x | 2026-01-02 0123456 EPYC, earlier method |"
    assert rows[1].startswith("| 2 | z | 20") and not rows[1].endswith(", earlier method |")
    assert rows[2].startswith("| PoseLib | y | 20") and not rows[2].endswith(", earlier method |")
    assert len(rows) == 3 and "doors" not in (tmp_path / "benchmarks/results/page.json").read_text()


def test_tables_show_which_rows_are_of_an_earlier_method(write, check, tmp_path):
    code = "int Sum(int x) { return x; }\n"
    write(f"{SOURCE}/noise/a.cc", code)
    write("docs/page.md", TABLE)
    write("benchmarks/results/page.json", RESULTS)
    method = re.search(r"0 of 1 rows of the present method (\w{10})\n", check("tables")[1]).group(1)
    write("benchmarks/results/page.json", RESULTS.replace('"cells"', f'"method": "{method}", "cells"'))
    write("docs/page.md", TABLE.replace(", earlier method", ""))
    assert "1 of 1 rows" in check("tables")[1]
    (tmp_path / SOURCE / "noise" / "a.cc").unlink()
    write(f"{SOURCE}/group/b.cc", f'#include "b.h"\n\n// Returns x.\n  {code}')
    write(f"{SOURCE}/group/b_test.cc", "int x;\n")
    write(f"{SOURCE}/cli/c.cc", "int x;\n")
    assert check("tables")[0] == 0, "names, comments, tests and other folders are no part of the method"
    write(f"{SOURCE}/group/b.cc", code.replace("x;", "x + 1;"))
    assert "differs from its results" in check("tables")[1]
    command = [sys.executable, CHECKS_PATH / "tables.py", "--root", tmp_path]
    subprocess.run([*command, "--write"], check=True)
    assert (tmp_path / "docs/page.md").read_text() == TABLE
    subprocess.run([*command, "--same-figures", method], check=True)
    assert (tmp_path / "docs/page.md").read_text() == TABLE.replace(", earlier method", "")
