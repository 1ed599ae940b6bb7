"""Tests of what the warning box of a report finds, and of the commands that repeat queries localized together."""

import json
import os
import re
import shutil
import sqlite3

import numpy as np
import pytest

from colmap_lazyloc import model
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.report.__main__ import main
from colmap_lazyloc.testing import synthetic
from colmap_lazyloc.testing.synthetic_run import RunShape, write_run
from conftest import write_lines, write_scene
from report_pages import ReportPage

CONTRADICTING = "Database images that contradict the others"
SAME_PLACE = "Database images at the same place"
NEAR = "Queries near the threshold"
INTRINSICS = "Intrinsics that the images contradict"
RIG = "Large errors within a rig"
WRONG = "Localized, but away from the known pose"
SAME_FAILURE = "Many queries fail in the same way"


def make_page(run_path, *options):
    output = run_path.with_suffix(".html")
    assert main([str(word) for word in (run_path, "--output", output, *options)]) == 0
    return ReportPage(output)


def write_changed_run(folder, change, **shape):
    """Writes a run, without failures by default, after `change(i, result)` has changed each result."""
    run_path = write_run(folder / "run", RunShape(**{"has_failures": False, "num_points": 300} | shape))
    path = run_path / "results.jsonl"
    results = [json.loads(line) for line in path.read_text().splitlines()]
    for i, result in enumerate(results):
        result["confidence"] = 0.99
        change(i, result)
    path.write_text("".join(json.dumps(result) + "\n" for result in results))
    return run_path


def test_nothing_to_warn_of(tmp_path):
    page = make_page(write_changed_run(tmp_path, lambda i, result: None))
    assert page.summary["warnings"] == []


def write_changes(run_path, **more):
    change = {"kind": "moved", "num_points": 9, "centre": [1.0, 2.0, 3.0], "bounds": [[0.0, 1.0, 2.0], [2.0, 3.0, 4.0]]}
    change |= {"new_photos": [{"name": "query/000003.jpg", "box": [1, 2, 3, 4]}], **more}
    (run_path / "changes.json").write_text(json.dumps([change]))


def test_changes_between_epochs(tmp_path):
    run_path = write_changed_run(tmp_path, lambda i, result: None)
    moved = {"displacement": [0.3, 0.4, 0.0], "displacement_stddevs": [0.0, 0.01, 0.0], "centre_now": [1.3, 2.4, 3.0]}
    write_changes(run_path, **moved)
    page = make_page(run_path, "--unit", "m")
    (item,) = page.summary["warnings"][0]["items"]
    assert (
        item["name"] == "moved"
        and item["query"] == page.index("query/000003.jpg")
        and "by 50 cm ± 1 cm" in item["text"]
    )
    lines = page.scene["changes"].reshape(-1, 2, 3)
    assert len(lines) == 25  # a box of 12 edges before, one now, and from one to the other
    assert np.allclose(lines[-1, 1] - lines[-1, 0], [0.3, 0.4, 0])
    assert np.allclose(np.ptp(lines[:12].reshape(-1, 3), axis=0), 2)


def test_second_epoch(tmp_path):
    """Shifts by the joint adjustment, residuals at control points, and which photos share matches."""

    def add_epoch(i, result):
        result["epoch"] = {"hangs_on": "database", "is_adjusted": result["name"] != "query/000004.jpg", "shift": 0.01}
        if result["name"] == "query/000003.jpg":
            result["pairs"].append({**result["pairs"][0], "name": "query/000005.jpg"})

    run_path = write_changed_run(tmp_path, add_epoch).rename(tmp_path / "epoch")
    results = [json.loads(line) for line in (run_path / "results.jsonl").read_text().splitlines()]
    for result in results:  # each photo was at another place, in the camera's axes
        result["cam_from_world"]["tvec"][0] += 0.01
    (tmp_path / "localized").mkdir()
    (tmp_path / "localized/results.jsonl").write_text("".join(json.dumps(result) + "\n" for result in results))
    residual = {"point": "P1", "photos": "new", "surveyed": [1.0, 2.0, 3.0], "error": [0.0, 0.003, 0.004]}
    unknown = {"point": "P2", "photos": "database", "surveyed": [1.0, 2.0, 3.0], "error": None}
    (run_path / "control_points.json").write_text(json.dumps([residual, unknown]))
    page = make_page(run_path)
    scene = page.scene
    shifts = np.diff(scene["shifts"].reshape(-1, 2, 3), axis=1)[:, 0]
    assert len(shifts) == len(results) - 1  # the photo that was not adjusted has none
    assert np.allclose(np.linalg.norm(shifts, axis=1), 0.01 * scene["shiftFactor"], rtol=1e-3)
    assert scene["shiftFactor"] in {step * 10**power for step in (1, 2, 5) for power in range(6)}
    begin, end = scene["controlResiduals"].reshape(2, 3)
    assert np.allclose(end - begin, scene["controlFactor"] * np.array([0, 0.003, 0.004]), rtol=1e-3)
    assert np.allclose(begin + scene["origin"], [1, 2, 3]) and scene["controlIsNew"].tolist() == [1]
    pair = sorted(page.index(f"query/00000{i}.jpg") for i in (3, 5))
    assert scene["overlapQueries"].reshape(-1, 2).tolist() == [pair]
    assert len(scene["overlapDatabase"]) == 2 * sum(len(result["pairs"]) for result in results) - 2


def test_changes_of_earlier_results_are_not_shown(tmp_path):
    run_path = write_changed_run(tmp_path, lambda i, result: None)
    write_changes(run_path)
    os.utime(run_path / "changes.json", (0, 0))
    assert make_page(run_path).summary["warnings"] == []


def test_damaged_changes_are_named(tmp_path, capsys):
    run_path = write_changed_run(tmp_path, lambda i, result: None)
    (run_path / "changes.json").write_text("[{}]")
    assert main([str(run_path), "--output", str(tmp_path / "report.html")]) == 1
    assert str(run_path / "changes.json") in capsys.readouterr().err


def test_queries_near_the_threshold(tmp_path):
    def change(i, result):
        result["confidence"] = [0.941, 0.956, 0.959, 0.99][i % 4]

    page = make_page(write_changed_run(tmp_path, change, num_queries=8))
    names = [f"query/{i:06d}.jpg" for i in (0, 1, 4, 5)]
    assert sorted(page.warning(NEAR)) == names and set(page.warning(NEAR)[:2]) == {names[0], names[2]}


def test_contradicted_intrinsics(tmp_path):
    def change(i, result):
        if i == 3:
            result["intrinsics"]["contradiction"] = "the focal length is too long"

    page = make_page(write_changed_run(tmp_path, change))
    assert page.warning(INTRINSICS) == ["query/000003.jpg"]


def test_large_errors_within_a_rig(tmp_path):
    def change(i, result):
        result["rig_error_px"] = {4: 5.0, 5: 8.0}.get(i, 0.5)

    page = make_page(write_changed_run(tmp_path, change, frame_size=2))
    assert page.warning(RIG) == ["query/000005.jpg", "query/000004.jpg"]


def test_wrong_poses(tmp_path):
    def change(i, result):
        if i in (3, 4):
            result["position_stddevs"] = [1e-4, 1e-4, 1e-4]

    run_path = write_changed_run(tmp_path, change)
    assert make_page(run_path).warning(WRONG) == []
    page = make_page(run_path, "--ground_truth", run_path / "truth")
    assert sorted(page.warning(WRONG)) == ["query/000003.jpg", "query/000004.jpg"]


def test_many_failures_of_one_kind(tmp_path):
    def change(i, result):
        if i in (5, 6, 7):
            result["status"] = "NO_PAIRS"

    shape = {"num_queries": 30, "has_failures": True}
    assert make_page(write_changed_run(tmp_path / "few", lambda i, result: None, **shape)).warning(SAME_FAILURE) == []
    page = make_page(write_changed_run(tmp_path / "many", change, **shape))
    assert page.warning(SAME_FAILURE) == ["4 queries: NO_PAIRS"]


@pytest.mark.parametrize("kind", ["rotation", "position"])
def test_a_database_image_with_a_wrong_pose(localize, tmp_path, kind):
    """Changes the pose of one image in the input model; images without such an error are not accused."""
    scene = synthetic.make_scene(
        synthetic.arc(9), synthetic.arc(4, radius=5, height=-0.7, phase=4), noise_px=0.5, num_points=500
    )
    files = write_scene(tmp_path, scene)
    page = make_page(localize(*files.arguments, output_path=tmp_path / "right").output_path)
    assert page.warning(CONTRADICTING) == []
    images = model.read_model(files.model_path)
    wrong = "database/003.jpg"
    changed = []
    for image in images.images.values():
        pose = image.cam_from_world
        if image.name == wrong:
            turn = np.array([[np.cos(0.15), 0, np.sin(0.15)], [0, 1, 0], [-np.sin(0.15), 0, np.cos(0.15)]])
            centre = pose.cam_in_world
            rotation = turn @ pose.rotation if kind == "rotation" else pose.rotation
            pose = Pose.from_centre(rotation, centre if kind == "rotation" else centre + [0.8, 0.5, 0])
        changed.append(model.Image(image.name, image.camera_id, pose, image.image_id))
    model_path = model.write_model(tmp_path / "wrong_model", images.cameras, changed)
    run = localize("--database_path", files.database_path, "--input_path", model_path, output_path=tmp_path / "wrong")
    assert make_page(run.output_path).warning(CONTRADICTING) == [wrong]


def test_database_images_at_the_same_place(localize, exact, tmp_path):
    images = model.read_model(exact.model_path)
    first = images.images["database/000.jpg"]
    copy = model.Image("database/copy.jpg", first.camera_id, first.cam_from_world, 99)
    model_path = model.write_model(tmp_path / "model", images.cameras, [*images.images.values(), copy])
    run = localize("--database_path", exact.database_path, "--input_path", model_path, output_path=tmp_path / "run")
    assert make_page(run.output_path).warning(SAME_PLACE) == ["database/copy.jpg"]


# Commands that repeat a query


def commands(page):
    return dict(zip(page.queries["names"], page.chunks["details/0"]["commands"]))


def test_images_of_a_frame_are_repeated_together(tmp_path):
    page = make_page(write_changed_run(tmp_path, lambda i, result: None, frame_size=2))
    for i in (4, 5):
        command = commands(page)[f"query/{i:06d}.jpg"]
        names = re.findall(r"query/\d+", command.partition(" > repeated.txt && ")[0])
        assert names == ["query/000004", "query/000005"]


def test_groups_are_runs_of_the_query_list(tmp_path):
    run_path = write_changed_run(tmp_path, lambda i, result: None, num_queries=6)
    names = [f"query/{i:06d}.jpg" for i in (5, 1, 3, 0, 2, 4)]
    queries = write_lines(tmp_path / "queries.txt", [f"{name} PINHOLE 600 800 640 640 300 400" for name in names])
    options = (run_path / "options.ini").read_text()
    options = options.replace("query_list_path=", f"query_list_path={queries}").replace(
        "[LazyLocalizer]\n", "[LazyLocalizer]\ngroup_size=2\n"
    )
    (run_path / "options.ini").write_text(options)
    command = commands(make_page(run_path))["query/000003.jpg"]
    assert "'query/000003.jpg PINHOLE 600 800 640 640 300 400' 'query/000000.jpg PINHOLE" in command
    assert "000001" not in command


def test_listed_groups_are_listed_again(tmp_path):
    run_path = write_changed_run(tmp_path, lambda i, result: None, num_queries=6)
    groups = write_lines(tmp_path / "groups.txt", ["query/000001.jpg query/000004.jpg"])
    options = (run_path / "options.ini").read_text()
    (run_path / "options.ini").write_text(options.replace("group_list_path=", f"group_list_path={groups}"))
    page = make_page(run_path)
    both = "query/000001.jpg query/000004.jpg"
    assert f"'{both}' > repeated_group.txt" in commands(page)["query/000004.jpg"]
    assert f"'{both}' > repeated_group.txt" in commands(page)["query/000001.jpg"]
    assert "query/000002.jpg > repeated_group.txt" in commands(page)["query/000002.jpg"]


def test_a_long_trajectory_is_repeated_as_a_whole(tmp_path):
    page = make_page(write_changed_run(tmp_path, lambda i, result: None, num_queries=60, frame_size=60))
    command = commands(page)["query/000001.jpg"]
    assert command.startswith("colmap lazy_localizer --project_path ") and "query_list_path" not in command


def test_a_name_that_no_list_can_hold_has_no_command(tmp_path):
    page = make_page(write_run(tmp_path / "run", RunShape(num_points=100, has_ugly_names=True)))
    found = commands(page)
    assert found["query/line\nbreak.jpg"] == ""
    assert (
        "'query/$(touch hacked) `touch hacked`.jpg' > repeated.txt" in found["query/$(touch hacked) `touch hacked`.jpg"]
    )


# Frames of database images


def test_database_images_of_a_frame_are_connected(localize, exact, tmp_path):
    database_path = tmp_path / "database.db"
    shutil.copy(exact.database_path, database_path)
    connection = sqlite3.connect(database_path)
    connection.execute("CREATE TABLE frame_data (frame_id, data_id, sensor_id, sensor_type)")
    ids = [exact.scene.images[f"database/{i:03d}.jpg"].image_id for i in range(4)]
    rows = [(1, ids[0], 1, 0), (1, ids[3], 2, 0), (2, ids[1], 1, 0), (2, ids[2], 1, 1)]
    connection.executemany("INSERT INTO frame_data VALUES (?, ?, ?, ?)", rows)
    connection.commit()
    connection.execute("PRAGMA journal_mode = WAL")
    connection.close()
    before = sorted(tmp_path.iterdir())
    run = localize(*exact.arguments)
    page = make_page(run.output_path, "--database_path", database_path)
    assert page.scene["databaseConnections"].tolist() == [0, 3]
    assert sorted(tmp_path.iterdir()) == before, "the folder of the database was written to"
