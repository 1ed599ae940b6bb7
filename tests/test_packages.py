"""Tests of the packages: files of the wheel, the wheel alone; man pages and completion of the Debian package."""

import hashlib
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tarfile
import venv
import zipfile

import numpy as np
import pytest

import photo_scene
import tutorials
from colmap_lazyloc import __main__ as tool
from colmap_lazyloc.poses import read_poses
from conftest import PROJECT_PATH

# Libraries of the system that the policy manylinux allows, among those in use.
MANYLINUX = tuple(f"lib{name}.so" for name in ("c", "dl", "expat", "gcc_s", "m", "pthread", "rt", "stdc++", "z"))
LICENCES = PROJECT_PATH / "scripts" / "licences.py"
HELP_PAGES = PROJECT_PATH / "scripts" / "help_pages.py"
COMPLETION = PROJECT_PATH / "python" / "colmap_lazyloc" / "completion.sh"
COMPLETE = {
    "bash": """
source "$1"
shift
COMP_WORDS=("$@") COMP_CWORD=$(($# - 1))
_lazyloc
printf '%s\\n' "${COMPREPLY[@]}"
""",
    # Zsh's own functions work in a terminal only.
    "zsh": """
compdef() {}
_files() {}
compadd() { shift; for name in "$@"; do [[ $name != ${words[CURRENT]}* ]] || echo $name; done; }
source "$1"
shift
words=("$@") CURRENT=$#
_lazyloc
""",
}


def run(*command, **options):
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, check=True, **options).stdout


def all_options(colmap, command="lazy_localizer", flag="--help-all"):
    return set(re.findall(r"^ +(?:-h \[ )?(--[\w.-]+)", run(colmap, command, flag), re.MULTILINE))


def test_long_steps_of_setup_show_how_far_they_are(tmp_path):
    """Runs a command as setup.sh runs ninja, with seconds in place of half minutes."""
    script = """
        source scripts/environment.sh; source scripts/apt.sh
        sleep() { command sleep 0.4; }
        build() { command sleep 0.6; echo '[3/12] Building a.o'; command sleep 0.7; return 5; }
        log=$1/log
        touch "$log"
        share_of_all() { share_of_build everything "$log"; }
        with_progress "$log" share_of_all build
    """
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    command = ["bash", "-c", script, "setup.sh", str(tmp_path)]
    done = subprocess.run(command, cwd=PROJECT_PATH, env=environment, capture_output=True, text=True, check=False)
    lines = done.stderr.splitlines()
    assert done.returncode == 5 and done.stdout == ""
    assert lines[0] == "setup.sh: building everything: 0 of 0 steps, 0 %"
    assert lines[-1] == "setup.sh: building everything: 3 of 12 steps, 25 %"


def test_share_is_at_most_everything():
    script = "source scripts/environment.sh; source scripts/apt.sh; share unpacking 122 121 packages"
    assert run("bash", "-c", script, cwd=PROJECT_PATH) == "unpacking: 121 of 121 packages, 100 %\n"


def test_wheel_holds_every_file_of_the_package(tmp_path):
    """Builds the wheel without its extension module, because the rules that choose its files are the same."""
    settings = ["wheel.cmake=false", "wheel.py-api=", f"build-dir={tmp_path / 'build'}"]
    flags = [word for setting in settings for word in ("--config-settings", setting)]
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", *flags]
    run(*pip, "--wheel-dir", tmp_path, PROJECT_PATH)
    (wheel,) = tmp_path.glob("*.whl")
    packed = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    listed = run("git", "ls-files", "python/colmap_lazyloc", cwd=PROJECT_PATH).splitlines()
    names = {name.removeprefix("python/") for name in listed}
    assert packed == {name for name in names if not name.startswith("colmap_lazyloc/testing/")}
    assert len(packed) > 50


def test_source_distribution_needs_the_source_of_colmap(tmp_path):
    """Makes a source distribution, which has the files of the build, and builds it where COLMAP is missing."""
    make = f"from scikit_build_core.build import build_sdist; build_sdist({str(tmp_path)!r})"
    run(sys.executable, "-c", make, cwd=PROJECT_PATH)
    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as files:
        names = {name.partition("/")[2] for name in files.getnames()}
    assert names >= set(run("git", "ls-files", "src", "cmake", "python/colmap_lazyloc", "scripts").splitlines())
    environment = {**os.environ, "COLMAP_SOURCE_DIR": str(tmp_path)}
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    done = subprocess.run([*pip, archive], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    expected = f"COLMAP_SOURCE_DIR='{tmp_path}' contains no COLMAP source tree; 'scripts/setup.sh source' fetches one"
    assert done.returncode != 0 and expected in done.stdout + done.stderr


@pytest.fixture(scope="module")
def wheel():
    """Returns the wheel that scripts/build_wheel.sh has made."""
    path = os.environ.get("LAZYLOC_WHEEL")
    if path is None:
        pytest.skip("needs the wheel, which scripts/test.sh makes and names in LAZYLOC_WHEEL")
    return pathlib.Path(path)


@pytest.fixture(scope="module")
def environment(wheel, tmp_path_factory):
    """Makes a virtual environment that has nothing but the wheel and numpy."""
    folder = tmp_path_factory.mktemp("wheel") / "venv"
    venv.create(folder)
    run(sys.executable, "-m", "pip", "--python", folder, "install", "--no-deps", "--no-index", "--quiet", wheel)
    (packages,) = folder.glob("lib/python*/site-packages")
    for path in pathlib.Path(np.__file__).parents[1].glob("numpy*"):
        (packages / path.name).symlink_to(path)
    return folder


def test_wheel_alone_goes_from_photos_to_the_report(environment, photos, tmp_path):
    def lazyloc(*words):
        return run(environment / "bin" / "lazyloc", *words, cwd=tmp_path, env={"PATH": str(environment / "bin")})

    printed = lazyloc("doctor")
    for word in (r"program +{}/\S+/colmap_lazyloc/bin/colmap \(COLMAP 3", r"extension +{}/", "run +missing: opencv"):
        assert re.search(word.format(environment), printed), printed
    assert not (environment / "bin" / "colmap").exists()
    commands = {f"lazy_{name}.1" for name in ("epoch", "indexer", "localizer", "merger")}
    assert {page.name for page in (environment / "share" / "man" / "man1").iterdir()} == {"lazyloc.1", *commands}
    words = ["--database_images", photos.image_path / "database", "--poses", photos.model_path]
    lazyloc("run", *words, "--queries", photos.image_path / "query", "--output", "out", *photo_scene.SIFT)
    poses = read_poses(tmp_path / "out" / "localized" / "poses.txt")
    assert sorted(poses) == photos.query_names
    for name, pose in poses.items():
        position_error, rotation_error_deg = pose.errors(photos.poses[name])
        assert position_error < 0.05 and rotation_error_deg < 0.3, name
    lazyloc("report", "out/localized", "--output", "page.html")
    for page in ("out/report.html", "page.html"):
        assert (tmp_path / page).stat().st_size > 100000


def test_commands_that_the_tutorials_need(environment):
    """Types what their first page says about the wheel; packages of others are not installed here."""
    commands, _ = tutorials.read_setup()
    pip = f'pip() {{ "{sys.executable}" -m pip --python "{environment}" "$@" --no-deps --no-index; }}'
    words = ["bash", "-euc", f"{pip}\n{commands}\ncommand -v colmap lazyloc python"]
    own = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    own["PATH"] = f"{environment / 'bin'}:{own['PATH']}"
    done = subprocess.run(words, capture_output=True, text=True, env=own, check=True)
    assert "does not provide" not in done.stdout + done.stderr
    *_, colmap, lazyloc, python = done.stdout.splitlines()
    assert colmap.startswith(str(environment)) and colmap.endswith("colmap_lazyloc/bin/colmap")
    assert [lazyloc, python] == [str(environment / "bin" / name) for name in ("lazyloc", "python")]


@pytest.fixture
def components(wheel, tmp_path):
    """Returns a function that writes the wheel's components, but for those of some names, to a list of their own."""

    def write(*left_out):
        with zipfile.ZipFile(wheel) as files:
            (name,) = (name for name in files.namelist() if name.endswith("/sboms/colmap-lazyloc.cdx.json"))
            listed = json.loads(files.read(name))
        listed["components"] = [found for found in listed["components"] if found["name"] not in left_out]
        path = tmp_path / "components.json"
        path.write_text(json.dumps(listed))
        return path, {found["name"]: found for found in listed["components"]}

    return write


def check_licences(path):
    return subprocess.run([sys.executable, LICENCES, "check", path], capture_output=True, text=True, check=False)


def test_wheel_lists_all_that_it_holds(environment, wheel, components):
    _, listed = components()
    assert {"ceres-solver", "colmap", "eigen3", "freeimage", "nanobind", "tiff", "VLFeat"} <= set(listed)
    with zipfile.ZipFile(wheel) as files:
        bundled = {name.rpartition("/")[2]: files.read(name) for name in files.namelist() if ".libs/lib" in name}
        texts = {pathlib.Path(name).stem for name in files.namelist() if "/licenses/bundled/" in name}
        (metadata,) = (files.read(name).decode() for name in files.namelist() if name.endswith("/METADATA"))
    digests = {
        file["name"]: file["hashes"][0]["content"] for found in listed.values() for file in found.get("components", ())
    }
    assert digests == {name: hashlib.sha256(content).hexdigest() for name, content in bundled.items()}
    assert texts == set(listed)
    stated = set(re.search(r"^License-Expression: (.*)$", metadata, re.MULTILINE)[1].split(" AND "))
    licences = {licence for found in listed.values() for licence in found["licenses"][0]["expression"].split(" AND ")}
    assert stated == licences | {"BSD-3-Clause"}
    # Functions of CHOLMOD and JBIG-KIT, and an error message of COLMAP's line detector, which is under the AGPL.
    (packages,) = environment.glob("lib/python*/site-packages")
    programs = [packages / "colmap_lazyloc" / "bin" / "colmap", *packages.glob("colmap_lazyloc/_core*.so")]
    assert len(programs) == 2
    contents = [*bundled.values(), *(program.read_bytes() for program in programs)]
    for word, name in ((b"cholmod_", "suitesparse"), (b"jbg_dec", "jbigkit"), (b"LSD Error", "LSD")):
        assert any(word in content for content in contents) == (name in listed), name
    for program in programs:
        for library, path in re.findall(r"(\S+) => (\S+)", run("ldd", program)):
            assert library.startswith(MANYLINUX) or "/colmap_lazyloc.libs/" in path, (library, path)


def test_check_of_licences_fails_on_the_gpl(wheel, components):
    gpl = {"jbigkit", "suitesparse"} & set(components()[1])
    done = check_licences(wheel)
    assert set(re.findall(r"(\w+) \(", done.stderr)) == gpl and done.returncode == bool(gpl)
    path, listed = components(*gpl)
    assert check_licences(path).returncode == 0
    listed["VLFeat"]["licenses"] = [{"expression": "MIT AND AGPL-3.0-or-later"}]
    path.write_text(json.dumps({"components": list(listed.values())}))
    done = check_licences(path)
    assert done.returncode == 1 and done.stderr.endswith("contains VLFeat (MIT AND AGPL-3.0-or-later)\n")


def test_option_tables_are_those_of_the_program(colmap):
    page = (PROJECT_PATH / "docs" / "command_line.md").read_text()
    tables = run(sys.executable, HELP_PAGES, "tables", colmap)
    assert len(tables.splitlines()) > 60 and tables in page, "see the end of docs/command_line.md"


@pytest.mark.parametrize(
    ("command", "flag"),
    [
        ("lazy_localizer", "--help-all"),
        ("lazy_epoch", "--help"),
        ("lazy_indexer", "--help"),
        ("lazy_merger", "--help"),
    ],
)
def test_man_page_has_every_option(colmap, tmp_path, command, flag):
    run(sys.executable, HELP_PAGES, "man", colmap, tmp_path)
    assert {page.name for page in tmp_path.iterdir()} == {
        "colmap-lazyloc.1",
        "lazy_localizer.1",
        "lazy_epoch.1",
        "lazy_indexer.1",
        "lazy_merger.1",
        "lazyloc.1",
    }
    page = tmp_path / f"{command}.1"
    options = re.findall(r"^\.TP\n\\fB\\-\\-(.*?)\\fR", page.read_text(), re.MULTILINE)
    assert {"--" + option.replace("\\-", "-") for option in options} == all_options(colmap, command, flag)
    text = " ".join(run(colmap, command, flag).split()[-5:])
    assert text in page.read_text().replace("\\-", "-"), "lines of the help are joined"
    if shutil.which("man"):
        done = subprocess.run(["man", "--warnings", "-l", page], capture_output=True, text=True, env=os.environ)
        assert (done.returncode, done.stderr) == (0, "")


@pytest.fixture(params=COMPLETE)
def complete(colmap, tmp_path, request):
    """Returns a function that completes the last of its words, as a shell does in the installed package."""
    shell = shutil.which(request.param)
    if shell is None:
        pytest.skip(f"needs {request.param}")
    (tmp_path / "colmap-lazyloc").symlink_to(colmap)
    (tmp_path / "lazyloc").symlink_to(PROJECT_PATH / "scripts" / "lazyloc")
    (tmp_path / "lazy_localizer").write_text('#!/bin/sh\nexec colmap-lazyloc lazy_localizer "$@"\n')
    (tmp_path / "lazy_localizer").chmod(0o755)
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    words = [shell, *(["-f"] if request.param == "zsh" else []), "-c", COMPLETE[request.param], shell, COMPLETION]
    return lambda *typed: run(*words, *typed, env=environment).split()


def test_completion_knows_commands_and_options(complete, colmap):
    assert {"lazy_localizer", "lazy_matches_importer"} < set(complete("colmap-lazyloc", "lazy_"))
    assert "feature_extractor" in complete("colmap-lazyloc", "")
    assert set(complete("colmap-lazyloc", "lazy_localizer", "")) == all_options(colmap)
    assert set(complete("lazy_localizer", "--strict", "1", "--")) == all_options(colmap)
    assert complete("lazy_localizer", "--LazyLocalizer.group_") == ["--LazyLocalizer.group_size"]
    assert "--Mapper.min_num_matches" in complete("colmap-lazyloc", "mapper", "--Mapper.min")


def test_completion_knows_the_tool(complete):
    assert complete("lazyloc", "re") == ["report", "retrieve"]
    assert complete("lazyloc", "control") == ["control_points"]
    assert complete("lazyloc", "import", "--out") == ["--output_path"]
    assert complete("lazyloc", "run", "--poses_format", "metash") == ["metashape"]
    assert complete("lazyloc", "run", "--epoch", "") == ["new", "both"]
    assert complete("lazyloc", "import", "metash") == ["metashape"]
    assert {"auto", "exif", "panoramas", "tum", "7scenes"} < set(complete("lazyloc", "import", ""))
    assert complete("lazyloc", "export", "--format", "kit") == ["kitti"]


def test_completion_leaves_values_to_file_names(complete):
    assert complete("lazy_localizer", "--database_path", "data") == []
    assert complete("lazyloc", "run", "--queries", "") == []


def test_completion_is_printed_by_the_tool(capsys):
    assert tool.main(["completion"]) == 0
    assert capsys.readouterr().out == COMPLETION.read_text()
