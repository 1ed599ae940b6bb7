"""Tests of `lazyloc report` with bad input: one clear line, exit code 1, nothing written."""

import contextlib
import json
import os
import pathlib
import shutil
import signal
import sqlite3
import subprocess
import sys

import numpy as np
import pytest

from colmap_lazyloc.report import __main__ as report
from colmap_lazyloc.testing import synthetic
from colmap_lazyloc.testing.synthetic_run import RunShape, write_run
from report_pages import ReportPage

LOCALIZED = "query/000020.jpg"


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("original") / "run", RunShape(num_points=600, has_photos=True))


@pytest.fixture
def run_path(original, tmp_path):
    return shutil.copytree(original, tmp_path / "run")


def assert_refused(capsys, message, *arguments):
    """Checks that the command writes one line, and no file."""
    output = pathlib.Path(arguments[-1])
    before = sorted(output.parent.rglob("*")) if output.parent.exists() else []
    assert report.main(list(map(str, arguments))) == 1
    captured = capsys.readouterr()
    assert captured.err.startswith("lazyloc report: ") and captured.err.count("\n") == 1
    assert message in captured.err and captured.out == ""
    assert (sorted(output.parent.rglob("*")) if output.parent.exists() else []) == before


def change_result(run_path, name, **fields):
    """Changes fields of a line of results.jsonl."""
    path = run_path / "results.jsonl"
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    changed = [line | fields if line["name"] == name else line for line in lines]
    path.write_text("".join(json.dumps(line) + "\n" for line in changed))


# The run


@pytest.mark.parametrize("length", [1, 200, 5000])
def test_truncated_results(run_path, capsys, length):
    path = run_path / "results.jsonl"
    path.write_bytes(path.read_bytes()[:-length])
    if length == 1:  # only the last newline is missing
        assert report.main([str(run_path), "--output", str(run_path / "page.html")]) == 0
        return
    assert_refused(capsys, "is damaged or cut off", run_path, "--output", run_path / "page.html")


@pytest.mark.parametrize("name", ["results.jsonl", "options.ini", "model/points3D.bin", "model/images.bin"])
def test_missing_files(run_path, capsys, name):
    (run_path / name).unlink()
    assert_refused(capsys, name.split("/")[0], run_path, "--output", run_path / "page.html")


@pytest.mark.parametrize("name", ["model/points3D.bin", "model/images.bin", "model/cameras.bin"])
@pytest.mark.parametrize("length", [1, 100])
def test_truncated_model(run_path, capsys, name, length):
    path = run_path / name
    path.write_bytes(path.read_bytes()[:-length])
    assert_refused(capsys, "model", run_path, "--output", run_path / "page.html")


def test_no_query(run_path, capsys):
    (run_path / "results.jsonl").write_text("")
    assert_refused(capsys, "holds no query", run_path, "--output", run_path / "page.html")


def test_model_of_another_run(run_path, capsys, tmp_path):
    other = write_run(tmp_path / "other", RunShape(num_points=600, seed=1))
    shutil.rmtree(run_path / "model")
    shutil.copytree(other / "model", run_path / "model")
    assert_refused(capsys, "is not the model of this run", run_path, "--output", run_path / "page.html")


def test_model_with_a_query_that_has_failed(run_path, capsys):
    change_result(run_path, LOCALIZED, status="DIVERGED", cam_from_world=None)
    assert_refused(capsys, f"it has query '{LOCALIZED}'", run_path, "--output", run_path / "page.html")


def test_points_of_another_run(run_path, capsys, tmp_path):
    other = write_run(tmp_path / "other", RunShape(num_points=300))
    shutil.copy(other / "model" / "points3D.bin", run_path / "model")
    assert_refused(capsys, "points3D.bin", run_path, "--output", run_path / "page.html")


@pytest.mark.parametrize(
    "fields",
    [
        {"confidence": "high"},
        {"confidence": float("nan")},
        {"cam_from_world": {"qvec": [1, 0, 0, 0], "tvec": [0, 0]}},
        {"cam_from_world": {"qvec": [2, 0, 0, 0], "tvec": [0, 0, 0]}},
        {"cam_from_world": {"qvec": [1, 0, 0, 0], "tvec": [0, 0, 1e999]}},
        {"covariance": [[1, 2], [3]]},
        {"pairs": [{"name": "database/000000.jpg"}]},
        {"pairs": {}},
        {"seconds": [1]},
        {"status": None},
        {"num_tracks": -1},
        {"intrinsics": {"verdict": 3}},
        {"bearing": {"from": "x", "direction": [1, 0, 0]}},
    ],
)
def test_values_that_no_run_writes(run_path, capsys, fields):
    change_result(run_path, LOCALIZED, **fields)
    assert_refused(capsys, "results.jsonl", run_path, "--output", run_path / "page.html")


def test_a_result_without_its_pairs(run_path, capsys):
    (run_path / "results.jsonl").write_text(
        '{"name": "a", "status": "NO_PAIRS", "reason": "", "cam_from_world": null}\n'
    )
    assert_refused(capsys, "query 'a' has no 'pairs'", run_path, "--output", run_path / "page.html")


def test_a_query_twice(run_path, capsys):
    path = run_path / "results.jsonl"
    path.write_text(path.read_text() + path.read_text().splitlines()[-1] + "\n")
    assert_refused(capsys, "has two results", run_path, "--output", run_path / "page.html")


def test_a_pose_that_is_not_finite(run_path, capsys):
    path = run_path / "model" / "images.bin"
    content = bytearray(path.read_bytes())
    content[8 + 4 + 32 : 8 + 4 + 40] = np.array([np.nan]).tobytes()
    path.write_bytes(content)
    assert_refused(capsys, "is not finite", run_path, "--output", run_path / "page.html")


@pytest.mark.parametrize("content", ["", "{}", '{"poses": [{"name": "stranger"}]}'])
def test_leave_one_out_of_another_run(run_path, capsys, content):
    (run_path / "leave_one_out.json").write_text(content)
    assert_refused(capsys, "leave_one_out.json", run_path, "--output", run_path / "page.html")


def test_not_a_run(tmp_path, capsys):
    assert_refused(capsys, "results.jsonl", tmp_path, "--output", tmp_path / "page.html")


# Photos, database, truth


def make_page(run_path, capsys, *options):
    """Makes a page in spite of gaps; returns it and what the command wrote to the standard error output."""
    page_path = run_path / "page.html"
    assert report.main([str(word) for word in (run_path, "--output", page_path, *options)]) == 0
    return ReportPage(page_path), capsys.readouterr().err


PHOTO_GAPS = "Photos that are missing or unreadable"
RECORD_GAPS = "Images whose stored matches cannot be drawn"


def cut_off(content):
    return content[: len(content) // 2]


@pytest.mark.parametrize("change", [None, cut_off, lambda _: b"", lambda _: b"not a photo"])
def test_a_photo_that_cannot_be_read_is_a_gap(run_path, capsys, change):
    whole, _ = make_page(run_path, capsys, "--image_path", run_path / "images")
    for name in (LOCALIZED, "database/000007.jpg"):
        path = run_path / "images" / name
        content = path.read_bytes()
        path.unlink()
        if change:
            path.write_bytes(change(content))
    page, errors = make_page(run_path, capsys, "--image_path", run_path / "images")
    assert page.warning(PHOTO_GAPS) == [LOCALIZED, "database/000007.jpg"] and whole.warning(PHOTO_GAPS) == []
    assert page.queries["photo"][page.index(LOCALIZED)] == -1 and len(page.photos) == len(whole.photos) - 2
    others = [i for i in range(len(page.queries["names"])) if i != page.index(LOCALIZED)]
    for i in others:  # each has its own photo still
        assert page.photos.get(page.queries["photo"][i]) == whole.photos.get(whole.queries["photo"][i])
    assert errors.startswith(f"lazyloc report: photos that the page lacks: 2; the first is '{LOCALIZED}': ")
    assert errors.count("\n") == 1


def test_a_folder_without_the_photos_gives_a_page_without_photos(run_path, capsys, tmp_path):
    (tmp_path / "empty").mkdir()
    page, errors = make_page(run_path, capsys, "--image_path", tmp_path / "empty")
    assert page.photos == {} and "is missing" in errors


def test_a_photo_that_the_run_could_not_read_may_be_missing(run_path):
    (run_path / "images" / "query" / "000000.jpg").unlink()
    page_path = run_path / "page.html"
    assert report.main([str(run_path), "--image_path", str(run_path / "images"), "--output", str(page_path)]) == 0
    page = ReportPage(page_path)
    assert page.queries["photo"][page.index("query/000000.jpg")] == -1


def test_no_folder_of_photos(run_path, capsys):
    arguments = (run_path, "--image_path", run_path / "nowhere", "--output", run_path / "page.html")
    assert_refused(capsys, "nowhere: is not a folder", *arguments)


@pytest.mark.parametrize("content", [None, b"", b"not a database" * 100])
def test_unreadable_database(run_path, capsys, content):
    database_path = run_path / "database.db"
    if content is not None:
        database_path.write_bytes(content)
    arguments = (run_path, "--database_path", database_path, "--output", run_path / "page.html")
    assert_refused(capsys, f"--database_path {database_path}: is not a", *arguments)


def test_database_of_another_run_gives_a_page_without_its_matches(localize, exact, noisy, capsys, tmp_path):
    run_path = localize(*exact.arguments).output_path
    plain, _ = make_page(run_path, capsys)
    page, errors = make_page(run_path, capsys, "--database_path", noisy.database_path)
    assert "that --database_path has not as in the run: " in errors and "has other keypoints than in the run" in errors
    name = exact.scene.query_names[0]
    np.testing.assert_array_equal(page.drawing(name)["inlierXy"], plain.drawing(name)["inlierXy"])
    assert len(page.drawing(name)["rejectedXy"]) == 0 and name in page.warning(RECORD_GAPS)


@pytest.mark.parametrize(
    ("statement", "problem"),
    [
        ("DELETE FROM images WHERE image_id = {id}", "is not in the database"),
        ("DELETE FROM keypoints WHERE image_id = {id}", "has no keypoints"),
        ("UPDATE keypoints SET data = x'00' WHERE image_id = {id}", "its keypoints cannot be read"),
        ("UPDATE keypoints SET rows = 'x' WHERE image_id = {id}", "its keypoints cannot be read"),
        ("UPDATE keypoints SET data = NULL WHERE image_id = {id}", "its keypoints cannot be read"),
    ],
)
def test_a_damaged_record_of_the_database_is_a_gap(localize, noisy, capsys, tmp_path, statement, problem):
    run_path = localize(*noisy.arguments).output_path
    database_path = tmp_path / "database.db"
    shutil.copy(noisy.database_path, database_path)
    whole, _ = make_page(run_path, capsys, "--database_path", database_path)
    name, other = noisy.scene.query_names[:2]
    with contextlib.closing(sqlite3.connect(database_path)) as connection, connection:
        (image_id,) = connection.execute("SELECT image_id FROM images WHERE name = ?", (name,)).fetchone()
        connection.execute(statement.format(id=image_id))
    page, errors = make_page(run_path, capsys, "--database_path", database_path)
    assert page.warning(RECORD_GAPS) == [name] and f"the first is '{name}': {problem}" in errors
    assert len(page.drawing(name)["inlierXy"]) > 0 and len(page.drawing(name)["rejectedXy"]) == 0
    np.testing.assert_array_equal(page.drawing(other)["rejectedXy"], whole.drawing(other)["rejectedXy"])


def test_damaged_matches_and_frames_are_gaps(localize, noisy, capsys, tmp_path):
    run_path = localize(*noisy.arguments).output_path
    database_path = tmp_path / "database.db"
    shutil.copy(noisy.database_path, database_path)
    with contextlib.closing(sqlite3.connect(database_path)) as connection, connection:
        connection.execute("UPDATE two_view_geometries SET data = x'00' WHERE rows > 0")
        connection.execute("DROP TABLE IF EXISTS frame_data")
        connection.execute("CREATE TABLE frame_data (frame_id INTEGER)")
    page, errors = make_page(run_path, capsys, "--database_path", database_path)
    assert "table frame_data" in page.warning(RECORD_GAPS) and "cannot be read" in errors


def test_truth_of_other_images(run_path, capsys, tmp_path):
    truth_path = synthetic.write_model(tmp_path / "truth", synthetic.make_scene(synthetic.arc(4), []))
    arguments = (run_path, "--ground_truth", truth_path, "--output", run_path / "page.html")
    assert_refused(capsys, "has no pose of any query", *arguments)


# The output


def test_unwritable_outputs(run_path, capsys, tmp_path):
    assert_refused(capsys, "its folder does not exist", run_path, "--output", tmp_path / "nowhere" / "page.html")
    assert_refused(capsys, "is a folder", run_path, "--output", run_path / "model")
    assert_refused(capsys, "is no earlier report", run_path, "--split", "--output", run_path / "model")
    assert_refused(capsys, "is no earlier report", run_path, "--split", "--output", run_path / "options.ini")
    assert_refused(capsys, "name too long", run_path, "--output", tmp_path / ("x" * 300))


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_read_only_folder(run_path, capsys, tmp_path):
    folder = tmp_path / "read-only"
    folder.mkdir(mode=0o555)
    assert_refused(capsys, "cannot be written", run_path, "--output", folder / "page.html")


@pytest.mark.parametrize("is_split", [False, True])
@pytest.mark.parametrize(
    ("error", "exit_code", "message"),
    [(OSError(28, "No space left on device"), 1, "No space left on device"), (KeyboardInterrupt(), 130, "interrupted")],
)
def test_an_error_while_writing_leaves_the_older_report(
    run_path, capsys, monkeypatch, tmp_path, is_split, error, exit_code, message
):
    output = tmp_path / "page"
    options = [str(run_path), "--output", str(output), *(["--split"] if is_split else [])]
    assert report.main(options) == 0
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    capsys.readouterr()

    def fail(*_):
        yield ("index.html", b"half") if is_split else "half"
        raise error

    monkeypatch.setattr(report, "page_files" if is_split else "single_page", fail)
    assert report.main(options) == exit_code
    assert message in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_interrupted_command(run_path, tmp_path):
    (run_path / "results.jsonl").unlink()
    os.mkfifo(run_path / "results.jsonl")
    command = [sys.executable, "-m", "colmap_lazyloc.report", run_path, "--output", tmp_path / "page.html"]
    environment = {**os.environ, "PYTHONPATH": str(pathlib.Path(__file__).parents[1] / "python")}
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    with (run_path / "results.jsonl").open("wb"):  # waits until the command reads
        process.send_signal(signal.SIGINT)
    # Closes the file first, because a signal that comes just before the command waits for data does not wake it.
    _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (130, "lazyloc report: interrupted\n")
    assert list(tmp_path.iterdir()) == [run_path]
