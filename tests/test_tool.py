"""Tests of the tool `lazyloc`: its commands, missing extras, bad options, closed pipes, and what doctor says."""

import os
import re
import subprocess
import sys
import tomllib

import PIL.Image
import pytest

from colmap_lazyloc import __main__ as tool
from colmap_lazyloc import doctor, extras
from colmap_lazyloc.extras import EXTRAS
from conftest import PROJECT_PATH, SCRIPTS_PATH

WITHOUT = """
import sys
from importlib.machinery import PathFinder

class Installed(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        module = name.partition(".")[0]
        return None if {is_missing} else super().find_spec(name, path, target)

sys.meta_path[sys.meta_path.index(PathFinder)] = Installed
from colmap_lazyloc.__main__ import main
sys.exit(main(sys.argv[1:]))
"""
ALL_BUT_NUMPY = "module not in (*sys.stdlib_module_names, 'numpy', 'colmap_lazyloc')"


def run_tool(*words, missing=()):
    """Runs the tool in a process in which modules are missing; `missing`: their names, or an expression."""
    program = WITHOUT.format(is_missing=missing if isinstance(missing, str) else f"module in {list(missing)}")
    environment = {**os.environ, "PYTHONPATH": str(PROJECT_PATH / "python")}
    command = [sys.executable, "-c", program, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=120)


@pytest.mark.parametrize("name", tool.COMMANDS)
def test_each_command_has_help_without_optional_packages(name):
    done = run_tool(name, "--help", missing=ALL_BUT_NUMPY)
    assert done.returncode == 0 and done.stdout.startswith(f"usage: lazyloc {name}"), done.stderr


def test_help_and_version(capsys):
    for words in ([], ["--help"], ["help"]):
        assert tool.main(words) == 0
        printed = capsys.readouterr().out
        assert all(re.search(rf"^  {name} ", printed, re.MULTILINE) for name in tool.COMMANDS)
    assert tool.main(["--version"]) == 0
    assert re.fullmatch(r"lazyloc \d+\.\d+\.\d+\n", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["reprot"], "unknown command 'reprot'; the nearest is report"),
        (["report"], "required"),
        (["evaluate", "none", "--ground_truth", "none"], "none"),
        (["import", "nothing", "file", "--output_path", "model"], "invalid choice"),
        (
            ["run", "--queries", "none", "--database_images", "none", "--output", "out"],
            "none: is neither a folder nor a video",
        ),
        (["demo", "--output_path", "demo", "--seed", "x"], "--seed"),
    ],
)
def test_bad_options_end_with_exit_code_1(words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert tool.main(words) == 1
    error = capsys.readouterr().err
    assert message in error.splitlines()[-1] and "Traceback" not in error
    assert not list(tmp_path.iterdir())


def test_endless_word_of_a_damaged_file_is_shortened(capsys, tmp_path):
    (tmp_path / "cameras.txt").write_text(f"1 PINHOLE 640 480 {'5' * 100_000}x 500 320 240\n")
    (tmp_path / "images.txt").write_text("")
    assert tool.main(["import", "colmap", str(tmp_path), "--output_path", str(tmp_path / "model")]) == 1
    error = capsys.readouterr().err
    assert "cameras.txt:1: " in error and "5...5555" in error and len(error) < 300


@pytest.mark.parametrize(
    ("words", "missing", "extra"),
    [
        (["changes", "{}"], "scipy", "changes"),
        (["demo", "--output_path", "{}/demo"], "cv2", "demo"),
        (["retrieve", "--descriptors_path", "a.h5", "--input_path", "m", "--output_path", "p"], "faiss", "retrieval"),
        (["cluster", "--num_shards", "2", "--output_path", "{}/a"], "distributed", "cluster"),
        (["run", "--database_images", "{}", "--queries", "{}/a.mp4", "--output", "{}/o"], "cv2", "run"),
        (["import", "opensfm", "{}/r.json", "--output_path", "{}/m"], "scipy", "import"),
        (["import", "csv", "{}/a.csv", "--output_path", "{}/m", "--camera", "PINHOLE 4 3 2 2 2 1"], "pyproj", "import"),
    ],
)
def test_missing_extra_is_one_line(words, missing, extra, tmp_path):
    shot = '{"rotation": [0, 0, 0], "translation": [0, 0, 0], "camera": "c"}'
    camera = '{"projection_type": "perspective", "width": 4, "height": 3, "focal": 1}'
    (tmp_path / "r.json").write_text(f'[{{"cameras": {{"c": {camera}}}, "shots": {{"a.jpg": {shot}}}}}]')
    (tmp_path / "a.mp4").touch()
    (tmp_path / "a.csv").write_text("name,lat,lon,alt,qw,qx,qy,qz\na.jpg,47,8,400,1,0,0,0\n")
    for modules in ([missing], ALL_BUT_NUMPY):
        done = run_tool(*(word.format(tmp_path) for word in words), missing=modules)
        assert done.returncode == 1
        assert done.stderr.count("\n") == 1 and f"pip install 'colmap-lazyloc[{extra}]'" in done.stderr, done.stderr


@pytest.mark.parametrize("words", ["--control_points points.csv", "--scale a.png:1,1 a.png:5,5 2"])
def test_package_for_marked_points_is_missed_before_any_work(tmp_path, words):
    PIL.Image.new("L", (8, 8)).save(tmp_path / "a.png")
    words = f"--database_images {tmp_path} --queries {tmp_path} --output {tmp_path}/o {words}"
    done = run_tool("run", *words.split(), missing=["pycolmap"])
    assert done.returncode == 1 and "pip install 'colmap-lazyloc[run]'" in done.stderr, done.stderr
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("module", ["hloc", "hloc_to_database"])
def test_missing_extra_of_a_module_is_one_line(module, tmp_path):
    flags = ["features_path", "matches_path", "pairs_path", "model_path", "query_list_path", "database_path"]
    if module == "hloc":
        flags = ["reference_sfm", "queries", "features", "matches", "retrieval", "results"]
    words = [word for flag in flags for word in (f"--{flag}", str(tmp_path / "none"))]
    program = f"import sys, runpy; sys.modules['h5py'] = None; sys.argv = ['x', *{words!r}]; "
    program += f"runpy.run_module('colmap_lazyloc.{module}', run_name='__main__')"
    environment = {**os.environ, "PYTHONPATH": str(PROJECT_PATH / "python")}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment)
    assert done.returncode == 1 and "colmap-lazyloc[hloc]" in done.stderr and done.stderr.count("\n") == 1, done.stderr


def test_report_without_opencv_is_one_line(exact, localize, tmp_path):
    run = localize(*exact.arguments)
    words = ["report", run.output_path, "--output", tmp_path / "page.html"]
    assert run_tool(*words, missing=["cv2", "tqdm", "matplotlib", "scipy", "pycolmap"]).returncode == 0
    (tmp_path / "photos").mkdir()
    for name in exact.scene.images:
        (tmp_path / "photos" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "photos" / name).touch()
    for options, missing, extra in (
        (["--image_path", "photos"], "cv2", "report"),
        (["--plots", "p"], "matplotlib", "plots"),
    ):
        done = run_tool(*words, options[0], tmp_path / options[1], missing=[missing])
        assert done.returncode == 1 and f"colmap-lazyloc[{extra}]" in done.stderr and done.stderr.count("\n") == 1


def test_script_of_the_checkout():
    done = subprocess.run([SCRIPTS_PATH / "lazyloc", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("lazyloc ")


def test_doctor_says_what_is_missing(capsys, monkeypatch, colmap):
    monkeypatch.setenv("COLMAP", str(colmap))
    assert doctor.main([]) == 0
    printed = capsys.readouterr().out
    assert str(colmap) in printed and re.search(r"COLMAP \d", printed) and "missing" not in printed
    monkeypatch.setattr(doctor, "is_installed", lambda module: module != "pyproj")
    monkeypatch.setenv("COLMAP", "/none/colmap")
    assert doctor.main([]) == 0
    printed = capsys.readouterr().out
    assert "program    not found" in printed
    assert "missing: pyproj; pip install 'colmap-lazyloc[import]' brings lazyloc import" in printed
    monkeypatch.setattr(doctor, "is_installed", lambda module: module != "matplotlib")
    assert doctor.main([]) == 0
    missing = [line for line in capsys.readouterr().out.splitlines() if "missing" in line]
    assert missing == [
        "  plots          missing: matplotlib; pip install 'colmap-lazyloc[plots]' brings lazyloc report --plots"
    ]


def test_debian_package_names_debian_packages(monkeypatch):
    monkeypatch.setattr(extras, "IS_DEBIAN_PACKAGE", True)
    assert extras.install_command("report", ["cv2", "tqdm"]) == "apt install python3-opencv python3-tqdm"
    by_both = "apt install python3-h5py, and pip install pycolmap in a virtual environment"
    assert extras.install_command("hloc", ["h5py", "pycolmap"]) == by_both
    assert extras.install_command("hloc", ["pycolmap"]) == "pip install pycolmap in a virtual environment"


def test_extras_are_those_of_the_package():
    project = tomllib.loads((PROJECT_PATH / "pyproject.toml").read_text())["project"]
    for name, extra in EXTRAS.items():
        assert set(project["optional-dependencies"][name]) == set(extra.modules)
    assert project["scripts"]["lazyloc"] == "colmap_lazyloc.__main__:main"
