"""Tests of scripts/checks: each fails on a tree that breaks its rule, names the place, and passes otherwise."""

import pathlib
import shutil
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


def function(num_lines, head="int Sum()"):
    return head + " {\n" + "  ++x;\n" * num_lines + "}\n"


@pytest.mark.parametrize(
    ("file", "included", "is_allowed"),
    [
        ("rotation/a.cc", "math/so3.h", True),
        ("rotation/a.cc", "rotation/b.h", True),
        ("rotation/a.cc", "translation/b.h", False),
        ("refinement/a.h", "structure/b.h", False),
        ("refinement/a.h", "paper/b.h", False),
        ("two_view/a.cc", "bridge/two_view_geometry.h", True),
        ("scene/a.h", "scene/b.h", True),
        ("math/a.h", "scene/b.h", False),
        ("pipeline/a.cc", "refinement/b.h", True),
        ("pipeline/a.cc", "paper/b.h", True),
        ("pipeline/a.cc", "priors/b.h", True),
        ("priors/a.cc", "pipeline/b.h", False),
        ("noise/a.cc", "uncertainty/b.h", False),
        ("pipeline/a.cc", "loading/b.h", False),
        ("pipeline/a.cc", "files/b.h", False),
        ("matching/a.cc", "files/b.h", True),
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


@pytest.mark.parametrize(
    "head",
    [
        "int Sum()",
        "TEST(Sum, IsRight)",
        "Sum::Sum(const Options& options = {})\n    : options_(options), x_{1}",
        "std::vector<std::function<void(int)>> Sum(int x) const noexcept",
        "template <typename T>\nbool operator==(const T& a, const T& b)",
    ],
)
def test_sizes_of_functions_have_a_limit(write, check, head):
    write("a.cc", f'namespace lazyloc {{\nconst char* brace = "{{";  // {{\n{function(50, head)}}}\n')
    assert check("sizes")[0] == 0
    write("a.cc", f'namespace lazyloc {{\nconst char* brace = "{{";  // {{\n{function(51, head)}}}\n')
    code, text = check("sizes")
    assert code == 1 and "has 51 lines, of at most 50" in text


def test_sizes_of_python_functions_have_a_limit(write, check):
    write("a.py", "def f():\n" + "    x = 1\n" * 51)
    code, text = check("sizes")
    assert code == 1 and "a.py:1: f has 51 lines" in text


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


@pytest.mark.parametrize(
    ("file", "old", "new", "found"),
    [
        ("docs/method.md", "", "", None),
        ("docs/method.md", "= 20", "= 30", "the default is 20"),
        ("docs/faq.md", "short", "short: `--LazyLocalizer.num_retrieved` (30)", "the default is 20"),
        (f"{SOURCE}/uncertainty/confidence_factors.h", "0.24", "0.34", "kPlaceOdds is 0.34"),
        (f"{SOURCE}/noise/database_priors.cc", "kExactProbability", "kOther", "kExactProbability is not found"),
        ("docs/method.md", "0.5 %", "1 %", "kMaxRightErrorRatio is 0.005"),
        ("docs/method.md", "exceeds 0.2,", "exceeds 0.3,", "kMaxStddev is 0.2"),
        ("docs/faq.md", "short", "short, " + "and a word " * 17, "words in a sentence"),
        ("docs/faq.md", "short", "a rival", "write competing pose"),
    ],
)
def test_prose_is_short_plain_and_true(write, check, tmp_path, file, old, new, found):
    """Changes something in the project's own code, options and page on the method, or in two other pages."""
    project = CHECKS_PATH.parents[1]
    shutil.copytree(project / SOURCE, tmp_path / SOURCE)
    for name in ("docs/method.md", "docs/command_line.md"):
        write(name, (project / name).read_text(encoding="utf-8"))
    write("docs/faq.md", "This is short.\n")
    write(file, (tmp_path / file).read_text(encoding="utf-8").replace(old, new))
    code, text = check("prose")
    assert code == (found is not None) and (found or "") in text, text


FUNCTION = "int Sum(int x);"
DATA = "double noise_px = 0.5;"
STRUCT = "struct Sum {};"
STATEMENT = "void F() {\n  // Zero.\n  int x = 0;\n}"


@pytest.mark.parametrize(
    ("comment", "code"),
    [
        ("Returns the sum.", FUNCTION),
        ("True if the pose is unobservable.", FUNCTION),
        ("COLMAP stores numbers as the machine holds them.", FUNCTION),
        ("What was removed stays in the inverted files.", FUNCTION),
        ("In COLMAP 3 zeros stand for a matrix that is not set.", FUNCTION),
        ("path: must not exist yet.", FUNCTION),
        ("rho = log(1 + r^2).", FUNCTION),
        ("Matches the query with each of the images.", FUNCTION),
        ("Sets priors as the options state them.", FUNCTION),
        ("Renders rough stone of a pillar.", FUNCTION),
        ("Models that COLMAP 4 added must work if COLMAP knows them.", FUNCTION),
        ("The identity counts as unset, because hloc stores it.", FUNCTION),
        ("If the images fit so badly that noise is not the reason, the estimate starts higher.", FUNCTION),
        ("What the solver changes.", STRUCT),
        ("Standard deviation of its image points, per coordinate.", DATA),
        ("A rig at one moment.", STRUCT),
    ],
)
def test_comments_that_open_with_a_sentence_pass(write, check, comment, code):
    write("a.h", f"// {comment}\n{code}\n")
    assert check("comments")[0] == 0


@pytest.mark.parametrize(
    ("comment", "code"),
    [
        ("Of the query, in pixels.", FUNCTION),
        ("None where COLMAP has set no pose.", FUNCTION),
        ("The same without noise.", FUNCTION),
        ("Median distance of the points.", FUNCTION),
        ("Matches of the query that fit.", FUNCTION),
        ("As the options state them.", FUNCTION),
        ("Whether the pose is known.", FUNCTION),
        ("Of the first step, which may be far off: it would go too far.", DATA),
        ("By which the lengths have been multiplied.", DATA),
        ("Those that the solver changes.", STRUCT),
        ("Query keypoint 0 seen at keypoint 10 of image 1.", FUNCTION),
        ("Cameras in a chain, each of which shares points.", FUNCTION),
        ("COLMAP's logging set-up for a program.", FUNCTION),
    ],
)
def test_comments_that_open_with_a_fragment_fail(write, check, comment, code):
    write("a.h", f"// {comment}\n{code}\n")
    exit_code, text = check("comments")
    assert exit_code == 1 and "a.h:1: " in text and "1 of 1 blocks" in text


def test_comments_may_be_fragments_in_less_than_three_percent(write, check):
    fragment, sentence = f"// Of it.\n{FUNCTION}\n", f"// Returns it.\n{FUNCTION}\n"
    write("a.h", fragment + 33 * sentence)
    assert check("comments")[0] == 0
    write("a.h", fragment + 32 * sentence)
    assert check("comments")[0] == 1


def test_comments_of_statements_count_but_not_those_at_the_end_of_a_line(write, check):
    write("a.cc", STATEMENT + "\nint y = 0;  // of the query\n")
    code, text = check("comments")
    assert code == 1 and "a.cc:2: (statement) Zero." in text and "1 of 1 blocks" in text


@pytest.mark.parametrize(
    "text",
    [
        '"""Of the query."""\n',
        'def f():\n    """Of the query."""\n',
        'def f():\n    """Median distance of the points."""\n',
        "# Of the query.\nx = 1\n",
        "# Of the query.\n\nx = 1\n",
        "def f():\n    # Zero.\n    return 0\n",
    ],
)
def test_comments_of_python_that_open_with_a_fragment_fail(write, check, text):
    write("a.py", text)
    code, printed = check("comments")
    assert code == 1 and "a.py:" in printed and "Python: 1 of 1 blocks" in printed


@pytest.mark.parametrize(
    "text",
    [
        '"""Poses of the queries."""\n',
        'def f():\n    """Returns the median distance."""\n',
        '@property\ndef f(self):\n    """Median distance of the points."""\n',
        "# Median distance of the points.\nx = 1\n",
        "# Scenes\n\n# Returns the scene.\ndef f():\n    pass\n",
        "x = 1  # of the query\n",
    ],
)
def test_comments_of_python_that_open_with_a_sentence_pass(write, check, text):
    write("a.py", text)
    assert check("comments")[0] == 0


def test_each_language_may_have_less_than_three_percent_of_fragments(write, check):
    write("a.h", 99 * f"// Returns it.\n{FUNCTION}\n")
    write("a.py", "# Of it.\nx = 1\n")
    code, text = check("comments")
    assert code == 1 and "comments: Python comments must open" in text and "C++: 0 of 99" in text


def test_metrics_count(write, check):
    write(
        f"{SOURCE}/pipeline/a.h",
        "struct A {\n  int x = 0;\n  std::vector<int> y;\n  int F() const;\n private:\n  int z;\n};\n",
    )
    write(f"{SOURCE}/cli/options.cc", 'void F() {\n  add("a", 1);\n  add("b", 2);\n}\n')
    write(f"{SOURCE}/cli/options_test.cc", function(20))
    code, text = check("metrics")
    assert code == 0
    assert "lines of src/ without tests: 11\n" in text and "files of src/ without tests: 2\n" in text
    assert f"longest function: 2 lines, {SOURCE}/cli/options.cc: F\n" in text
    assert "options registered: 2\n" in text and "pipeline/*.h: 2 (A 2)" in text


ROW = '{"date": "2026-01-02", "commit": "0123456789", "machine": "EPYC", "cells": ["1", "x"]}'
RESULTS = f'{{"walls": {{"columns": ["a", ""], "rows": [{ROW}]}}}}'
TABLE = """<!-- results: page/walls -->

| a |  | measured |
|---|---|---|
| 1 | x | 2026-01-02 0123456 EPYC, earlier |
"""


@pytest.mark.parametrize(
    ("page", "problem"),
    [
        (TABLE, None),
        (TABLE.replace("| 1 |", "| 2 |"), "differs from its results"),
        (TABLE.replace(", earlier", ""), "differs from its results"),
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
    assert rows[0] == "| 1 | x | 2026-01-02 0123456 EPYC, earlier |"
    assert rows[1].startswith("| 2 | z | 20") and rows[1].endswith(", earlier |")
    assert rows[2].startswith("| PoseLib | y | 20") and not rows[2].endswith(", earlier |")
    assert len(rows) == 3 and "doors" not in (tmp_path / "benchmarks/results/page.json").read_text()
