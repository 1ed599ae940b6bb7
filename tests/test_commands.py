"""Tests of the package's commands: how they find colmap, how they end, and the scripts that start them."""

import argparse
import os
import shutil
import subprocess
import sys
import warnings

import PIL.Image
import pytest

from colmap_lazyloc import errors, program
from conftest import PROJECT_PATH, SCRIPTS_PATH


@pytest.mark.parametrize("text, line", [("a.txt: bad", "a.txt: bad"), ("a\nb: bad\x1b", "a\\nb: bad\\x1b")])
def test_bad_input_is_one_line(capsys, text, line):
    @errors.command
    def main(arguments):
        raise errors.InputError(text)

    assert main([]) == 1
    assert capsys.readouterr().err == f"test_commands: {line}\n"


def test_missing_file_is_one_line(capsys, tmp_path):
    @errors.command
    def main(arguments):
        (tmp_path / "none").read_text()

    assert main() == 1
    error = capsys.readouterr().err
    assert "none" in error and error.count("\n") == 1


def test_warnings_of_pillow_are_not_printed(tmp_path):
    exif = b"Exif\0\0MM\0*" + b"\xff" * 20  # damaged
    PIL.Image.new("RGB", (8, 8)).save(tmp_path / "photo.jpg", exif=exif)

    @errors.command
    def main(arguments):
        with PIL.Image.open(tmp_path / "photo.jpg") as photo:
            photo.getexif().get_ifd(0x8825)

    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always")
        assert main([]) == 0
    assert not shown


def test_bad_argument_has_the_exit_code_of_bad_input(capsys):
    @errors.command
    def main(arguments):
        argparse.ArgumentParser().parse_args(arguments)

    assert main(["--nonsense"]) == 1 and "--nonsense" in capsys.readouterr().err
    assert main(["--help"]) == 0


@pytest.mark.parametrize("words", [["evaluate", "--help"], ["doctor"]])
def test_closed_pipe_is_no_error(words):
    process = subprocess.Popen(
        [sys.executable, "-m", "colmap_lazyloc", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(PROJECT_PATH / "python")},
    )
    process.stdout.close()
    assert process.stderr.read() == b"" and process.wait(timeout=60) == 0


def test_colmap_is_that_of_the_environment(monkeypatch):
    monkeypatch.setenv("COLMAP", "/some/colmap")
    assert str(program.find_colmap()) == "/some/colmap"


def find_colmap_in_script(folder, path):
    """Returns what scripts/find_colmap.sh finds without a build."""
    command = ["bash", "-c", 'source "$1" && echo "$COLMAP"', "bash", SCRIPTS_PATH / "find_colmap.sh"]
    environment = {"PATH": f"{path}:/usr/bin:/bin", "BUILD_DIR": str(folder / "no build")}
    return subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout.strip()


def test_colmap_is_the_installed_package_without_a_build(monkeypatch, tmp_path):
    monkeypatch.delenv("COLMAP", raising=False)
    monkeypatch.setattr(program, "PACKAGE_PATH", tmp_path / "python" / "colmap_lazyloc")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert str(program.find_colmap()) == "colmap"
    wheel = program.PACKAGE_PATH / "bin" / "colmap"
    wheel.parent.mkdir(parents=True)
    wheel.touch(mode=0o755)
    assert program.find_colmap() == wheel
    installed = tmp_path / "colmap-lazyloc"
    installed.touch(mode=0o755)
    assert program.find_colmap() == installed
    built = tmp_path / "build" / "bin" / "colmap"
    built.parent.mkdir(parents=True)
    built.touch(mode=0o755)
    assert program.find_colmap() == built
    assert find_colmap_in_script(tmp_path, tmp_path) == str(installed)
    installed.unlink()
    if shutil.which("colmap-lazyloc", path="/usr/bin:/bin") is None:
        assert find_colmap_in_script(tmp_path, tmp_path) == "colmap"


def test_failing_program_leaves_a_log(tmp_path):
    with pytest.raises(RuntimeError, match="no such thing"):
        program.run_colmap("bash", "-c", "echo out; echo no such thing >&2; exit 3", log_path=tmp_path / "log")
    assert "out\nno such thing\n" in (tmp_path / "log").read_text()


@pytest.mark.parametrize(
    "name, option", [("feature_extractor", "Extraction.use_gpu"), ("exhaustive_matcher", "Matching.use_gpu")]
)
def test_gpu_option_in_python_and_in_shell(colmap, name, option):
    assert program.gpu_option(colmap, name).endswith(option)
    done = subprocess.run(
        [SCRIPTS_PATH / "gpu_option.sh", name],
        env={**os.environ, "COLMAP": str(colmap)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.strip() == program.gpu_option(colmap, name), done.stderr


def test_gpu_option_of_another_command_is_an_error(colmap, monkeypatch, capsys):
    monkeypatch.setenv("COLMAP", str(colmap))
    assert program.main(["database_creator"]) == 1
    assert "database_creator" in capsys.readouterr().err
