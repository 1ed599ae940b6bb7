"""Tests that the program has every command of COLMAP and lazy_localizer, and explains each option."""

import pathlib
import re
import sqlite3
import subprocess

import pytest

# COLMAP 3.10 and 4 have these.
SOME_COMMANDS = {
    "automatic_reconstructor",
    "database_creator",
    "exhaustive_matcher",
    "feature_extractor",
    "image_registrator",
    "mapper",
    "matches_importer",
    "model_converter",
    "point_triangulator",
}


def upstream_commands(colmap):
    """Reads COLMAP's commands in the source tree that the program was built against: (those in every build, all). The
    second set also has the commands inside #if, because a build may lack them. Both are empty without a source tree."""
    cache = colmap.parent.parent / "CMakeCache.txt"
    match = re.search(r"^COLMAP_SOURCE_DIR:\w+=(.+)$", cache.read_text() if cache.exists() else "", re.MULTILINE)
    if match is None:
        return set(), set()
    text = (pathlib.Path(match[1]) / "src" / "colmap" / "exe" / "colmap.cc").read_text()
    unconditional = re.sub(r"^#if .*?^#endif", "", text, flags=re.MULTILINE | re.DOTALL)
    required, every = (
        set(re.findall(r'(?:commands\.emplace_back\(\s*|\bcommand == )"(\w+)"', part)) for part in (unconditional, text)
    )
    assert len(required) > 30
    return required, every


OUR_COMMANDS = [
    "lazy_epoch",
    "lazy_exhaustive_matcher",
    "lazy_feature_extractor",
    "lazy_indexer",
    "lazy_localizer",
    "lazy_matches_importer",
    "lazy_merger",
    "lazy_sequential_matcher",
    "lazy_spatial_matcher",
    "lazy_transitive_matcher",
    "lazy_vocab_tree_matcher",
]


def run(colmap, *arguments):
    return subprocess.run([colmap, *arguments], capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize("arguments", [["help"], ["-h"], ["--help"], []])
def test_help_lists_every_command(colmap, arguments):
    done = run(colmap, *arguments)
    assert done.returncode == 0
    listed = done.stdout.split("Available commands:")[1].split()
    assert len(listed) == len(set(listed))
    assert {*OUR_COMMANDS, *SOME_COMMANDS} <= set(listed)
    required, every = upstream_commands(colmap)
    if every:
        assert required <= set(listed) - set(OUR_COMMANDS) <= every


def test_an_upstream_command_works(colmap, tmp_path):
    assert run(colmap, "database_creator", "--database_path", tmp_path / "database.db").returncode == 0
    with sqlite3.connect(tmp_path / "database.db") as connection:
        tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    assert {"cameras", "images", "keypoints", "matches", "two_view_geometries"} <= tables


def test_an_upstream_command_has_its_own_help(colmap):
    done = run(colmap, "mapper", "-h")
    assert done.returncode == 0
    assert "--Mapper.ba_refine_focal_length" in done.stdout + done.stderr


def test_an_unknown_command_fails(colmap):
    done = run(colmap, "lazy_localiser")
    assert done.returncode == 1
    assert "lazy_localiser" in done.stdout + done.stderr


def test_help_of_the_indexer_explains_its_options(colmap):
    done = run(colmap, "lazy_indexer", "-h")
    assert (done.returncode, done.stderr) == (0, "")
    options = set(re.findall(r"--[\w.]+", done.stdout))
    assert {"--database_path", "--index_path", "--LazyIndexer.num_visual_words"} <= options


GROUPS = {
    "What you need": ["database_path", "input_path", "output_path"],
    "Queries": ["query_list_path", "pairs_path", "LazyLocalizer.leave_one_out", "LazyLocalizer.intrinsics"],
    "Photos": ["image_path", "retrieval_index_path", "onnx_path"],
    "Several at once": ["rig_config_path", "query_trajectory_path", "LazyLocalizer.group_size"],
    "Further measurements": ["query_position_path", "query_gravity_path", "depth_path"],
    "Output": ["LazyLocalizer.min_confidence", "LazyLocalizer.num_threads", "resume", "strict"],
}
MAX_NUM_LINES = 80  # two screens
MAX_NUM_OPTIONS = 53


def explained_options(help_text):
    """Returns the help text of each option that takes a value, by name; checks that every option has one."""
    options = re.findall(
        r"^  (?:-h \[ --help \]|--help-all|--version|--([\w.]+) arg(?: \(=[^)]*\))?)\s+(.*?)(?=^  -|^\S|\Z)",
        help_text,
        re.MULTILINE | re.DOTALL,
    )
    assert len(options) == len(re.findall(r"^  -", help_text, re.MULTILINE))
    explained = {name: " ".join(text.split()) for name, text in options if name}
    for name, text in explained.items():
        assert len(text.split()) >= 3 and text[0].isupper(), f"{name}: '{text}'"
    return explained


@pytest.mark.parametrize("flag", ["-h", "--help"])
def test_help_of_the_command_explains_the_options_by_topic(colmap, flag):
    done = run(colmap, "lazy_localizer", flag)
    assert (done.returncode, done.stderr) == (0, "")
    titled = re.split(r"^([A-Z][\w ]+):$", done.stdout, flags=re.MULTILINE)
    parts = dict(zip(titled[1::2], titled[2::2], strict=True))
    assert len(re.findall(r"^  colmap lazy_localizer --database_path", parts.pop("Examples"), re.MULTILINE)) == 2
    assert {title: list(explained_options(part)) for title, part in parts.items()} == GROUPS
    assert done.stdout.count("\n") <= MAX_NUM_LINES and max(map(len, done.stdout.splitlines())) <= 110
    assert "--LazyLocalizer.num_threads arg (=-1)" in done.stdout and "--help-all" in done.stdout


def test_help_of_all_options_has_those_of_colmap_and_the_advanced_ones_too(colmap):
    done = run(colmap, "lazy_localizer", "--help-all")
    assert (done.returncode, done.stderr) == (0, "")
    explained = explained_options(done.stdout)
    assert set(explained) > {name for names in GROUPS.values() for name in names}
    assert len(explained) <= MAX_NUM_OPTIONS
    basic, advanced = done.stdout.split("\nAdvanced options:\n")
    assert "--LazyLocalizer.Advanced" not in basic and "--LazyLocalizer.seed" in basic
    prefixes = ("LazyLocalizer.Advanced.", "ImageReader.", "SiftExtraction.", "Aliked", "FeatureMatching.")
    assert [name for name in explained_options(advanced) if not name.startswith(prefixes)] == []


@pytest.mark.parametrize("command", ["lazy_localizer", "lazy_epoch", "lazy_indexer", "lazy_merger"])
def test_version_is_that_of_the_program_and_of_colmap(colmap, command):
    done = run(colmap, command, "--version")
    assert (done.returncode, done.stderr) == (0, "")
    assert re.fullmatch(r"colmap_lazyloc \d+\.\d+\.\d+, COLMAP [34]\.\S+.*\n", done.stdout), done.stdout


def test_closed_pipe_is_no_error(colmap):
    with subprocess.Popen([colmap, "lazy_localizer", "--help-all"], stdout=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.wait(timeout=60) == 0


def test_help_writes_nothing(colmap, tmp_path):
    subprocess.run([colmap, "lazy_localizer", "-h"], cwd=tmp_path, check=True, capture_output=True)
    assert list(tmp_path.iterdir()) == []


def test_help_breaks_no_option_across_lines(colmap):
    # boost breaks a word that begins in the left half of a line and does not fit into it.
    text = run(colmap, "lazy_localizer", "--help-all").stdout
    names = [name.rstrip(".") for name in re.findall(r"--([\w.]+)", text)]
    options = set(re.findall(r"^ +--([\w.]+)", text, re.MULTILINE)) | {"help"}
    assert len(names) > 20
    assert set(names) <= options
