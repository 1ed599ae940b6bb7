"""Tests of the progress display, on a terminal and elsewhere, and of Ctrl-C."""

import json
import os
import pty
import signal
import subprocess

import pytest

from colmap_lazyloc.testing import synthetic
from conftest import Run

NUM_QUERIES = 400


def progress_lines(stdout):
    return [json.loads(line) for line in stdout.splitlines()]


def test_a_json_line_per_query_on_the_standard_output(localize, noisy):
    run = localize(*noisy.arguments)
    lines = progress_lines(run.stdout)
    assert [line["done"] for line in lines] == [1, 2, 3] and {line["of"] for line in lines} == {3}
    assert {line["query"]: line["status"] for line in lines} == run.statuses
    assert all(line["seconds"] > 0 for line in lines)
    for line in lines:
        assert line["position"] == run.results[line["query"]]["position"]
        assert line["confidence"] == run.results[line["query"]]["confidence"]
    assert [line["seconds_left"] > 0 for line in lines] == [True, True, False]
    assert "\r" not in run.stdout and run.stderr == ""


def test_a_summary_ends_the_run(localize, noisy):
    summary = localize(*noisy.arguments).summary
    assert any(line.split() == ["LOCALIZED", "3"] for line in summary.splitlines()), summary


def run_on_terminal(colmap, noisy, output_path, stdout=None):
    """Runs the program with its standard error output on a terminal; returns what is shown there. stdout: default: the
    terminal, too."""
    try:
        parent, terminal = pty.openpty()
    except OSError as error:  # a chroot without /dev/pts
        pytest.skip(f"the machine has no terminals: {error}")
    process = subprocess.Popen(
        [colmap, "lazy_localizer", *noisy.arguments, "--output_path", output_path],
        stdout=terminal if stdout is None else stdout,
        stderr=terminal,
    )
    os.close(terminal)
    shown = b""
    try:
        while chunk := os.read(parent, 4096):
            shown += chunk
    except OSError:  # how Linux tells that the program has closed the terminal
        pass
    os.close(parent)
    assert process.wait(timeout=60) == 0
    return shown.decode()


def test_a_progress_bar_on_a_terminal(colmap, noisy, tmp_path):
    text = run_on_terminal(colmap, noisy, tmp_path / "output")
    assert text.count("\r[") == 3 and "3/3" in text and "#" * 20 in text and text.count(" left") == 3
    assert '{"query"' not in text
    assert len(Run(tmp_path / "output", 0, text, "").poses) == 3


def test_a_progress_bar_beside_lines_in_a_file_but_not_in_a_pipe(colmap, noisy, tmp_path):
    with (tmp_path / "lines").open("w") as lines:
        text = run_on_terminal(colmap, noisy, tmp_path / "output", lines)
    assert text.count("\r[") == 3 and len(progress_lines((tmp_path / "lines").read_text())) == 3
    text = run_on_terminal(colmap, noisy, tmp_path / "output", subprocess.PIPE)
    assert "\r[" not in text and "3 of 3 queries done" in text


def test_a_closed_pipe_does_not_end_the_run(colmap, noisy, tmp_path):
    command = [colmap, "lazy_localizer", *noisy.arguments, "--output_path", tmp_path / "output"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        process.stdout.close()
        assert process.wait(timeout=60) == 0
    assert len(Run(tmp_path / "output", 0, "", "").poses) == 3


@pytest.fixture(scope="module")
def long(tmp_path_factory, write_scene_files):
    """Makes hundreds of queries whose raw matches must be verified, so that a run takes seconds on any machine."""
    scene = synthetic.make_scene(
        synthetic.arc(6), synthetic.arc(NUM_QUERIES, radius=5, height=0.8), noise_px=0.5, outlier_ratio=0.3
    )
    return write_scene_files(tmp_path_factory.mktemp("long"), scene, geometry=None)


def interrupt(colmap, files, output_path, num_threads):
    """Sends SIGINT after the third query."""
    process = subprocess.Popen(
        [
            colmap,
            "lazy_localizer",
            *files.arguments,
            "--output_path",
            output_path,
            "--LazyLocalizer.num_threads",
            str(num_threads),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        bufsize=0,
    )  # communicate() would lose what readline() has read ahead
    stdout = b"".join(process.stdout.readline() for _ in range(3))
    process.send_signal(signal.SIGINT)
    rest, stderr = process.communicate(timeout=120)
    return Run(output_path, process.returncode, (stdout + rest).decode(), stderr.decode())


@pytest.mark.parametrize("num_threads", [1, 4])
def test_interrupted_run_writes_the_results_so_far(colmap, long, tmp_path, num_threads):
    run = interrupt(colmap, long, tmp_path / "output", num_threads)
    assert run.exit_code == 130
    lines = progress_lines(run.stdout)
    assert 3 <= len(lines) < NUM_QUERIES
    assert {line["query"]: line["status"] for line in lines} == run.statuses
    assert {name for name, status in run.statuses.items() if status == "LOCALIZED"} == set(run.poses)
    for name, pose in run.poses.items():
        assert pose.errors(long.scene.images[name].pose)[0] < 0.02
    assert set(run.model_images) == {*long.scene.database_names, *run.poses}
    assert sorted(path.name for path in run.output_path.iterdir()) == [
        "model",
        "options.ini",
        "poses.txt",
        "positions.csv",
        "results.jsonl",
        "unfinished",
    ]
    import pycolmap

    assert pycolmap.Reconstruction(run.output_path / "model").num_reg_images() == len(run.model_images)


def test_poses_of_an_interrupted_run_are_those_of_a_whole_one(colmap, localize, long, tmp_path):
    run = interrupt(colmap, long, tmp_path / "output", num_threads=2)
    (tmp_path / "list.txt").write_text("\n".join(run.results) + "\n")
    whole = localize(*long.arguments, "--query_list_path", tmp_path / "list.txt")
    assert whole.exit_code == 0
    assert whole.poses_bytes == run.poses_bytes
