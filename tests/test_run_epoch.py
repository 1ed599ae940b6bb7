"""Tests of `lazyloc run --epoch`: new photos are matched with each other and adjusted together."""

import json
import pathlib

import cv2
import numpy as np
import pytest

import photo_scene
from colmap_lazyloc.__main__ import main
from colmap_lazyloc.database import DatabaseReader
from colmap_lazyloc.model import Camera, read_model
from colmap_lazyloc.poses import read_poses
from colmap_lazyloc.project.epoch import common_cameras, epoch_pairs, warn_of_rigs
from colmap_lazyloc.pycolmap_types import image_from_cam
from colmap_lazyloc.results import find_results, read_results, to_pose
from report_pages import ReportPage

POSE = {"qvec": [1.0, 0.0, 0.0, 0.0], "tvec": [0.0, 0.0, 0.0]}


def result(x, **more):
    pose = None if x is None else {**POSE, "tvec": [-float(x), 0.0, 0.0]}
    return {"status": "NO_PAIRS" if x is None else "LOCALIZED", "cam_from_world": pose, **more}


def test_photos_of_near_viewpoints_are_matched():
    pairs = epoch_pairs({f"{x:03}": result(x) for x in range(60)})
    assert ("000", "001") in pairs and ("000", "050") not in pairs
    assert pairs == sorted(set(pairs)) and all(first < second for first, second in pairs)


def test_photo_without_pose_is_matched_with_all_if_these_are_few():
    results = {f"{x:03}": result(None if x == 7 else x) for x in range(40)}
    assert sum("007" in pair for pair in epoch_pairs(results)) == 39
    many = {f"{x:03}": result(None if x == 7 else x) for x in range(60)}
    assert sum("007" in pair for pair in epoch_pairs(many)) == 10


def test_guessed_intrinsics_become_the_median_of_what_was_found():
    guess, other = Camera("SIMPLE_PINHOLE", 60, 40, (72.0, 30.0, 20.0)), Camera("PINHOLE", 60, 40, (5.0, 5.0, 3.0, 2.0))
    refined = [{"model": "SIMPLE_PINHOLE", "width": 60, "height": 40, "params": [f, 30.0, 20.0]} for f in (50, 51, 90)]
    results = {str(i): result(i, camera=camera) for i, camera in enumerate(refined)}
    results |= {"3": result(None), "4": result(4)}
    cameras = common_cameras(results, {**dict.fromkeys("0123", guess), "4": other})
    assert cameras == dict.fromkeys("0123", Camera("SIMPLE_PINHOLE", 60, 40, (51.0, 30.0, 20.0)))


def test_photos_of_rigs_are_named(caplog):
    warn_of_rigs({"a": result(0, frame=None), "b": result(1)})
    assert not caplog.records
    warn_of_rigs({"a": result(0, frame="f0"), "b": result(1, frame="f0"), "c": result(2, frame=None)})
    assert "each of 2 photos of rigs on its own" in caplog.text


def run(photos, output, *more, queries=None):
    words = ["run", "--database_images", photos.image_path / "database", "--poses", photos.model_path]
    words += ["--queries", queries or photos.image_path / "query", "--output", output, *photo_scene.SIFT, *more]
    return main([str(word) for word in words])


def test_run_places_photos_and_keeps_database_poses(colmap, photos, monkeypatch, tmp_path):
    monkeypatch.setenv("COLMAP", str(colmap))
    assert run(photos, tmp_path / "out", "--epoch", "both") == 0
    assert find_results(tmp_path / "out") == tmp_path / "out/epoch"
    poses = read_poses(tmp_path / "out/epoch/poses.txt")
    assert sorted(poses) == photos.query_names
    for name, pose in poses.items():
        position_error, rotation_error_deg = pose.errors(photos.poses[name])
        assert position_error < 0.05 and rotation_error_deg < 0.3
    given, model = read_model(photos.model_path).images, read_model(tmp_path / "out/epoch/model").images
    assert all(model[name].pose.bits() == image.pose.bits() for name, image in given.items())
    assert (tmp_path / "out/report.html").exists()
    assert main(["changes", str(tmp_path / "out")]) == 0
    assert json.loads((tmp_path / "out/epoch/changes.json").read_text()) == []
    with DatabaseReader(tmp_path / "out/epoch/matches.db") as database:
        assert tuple(photos.database_names[:2]) in database.matched_pairs()
    page = (tmp_path / "out/report.html").read_bytes()
    assert main(["report", str(tmp_path / "out")]) == 0
    again = ReportPage(tmp_path / "out/report.html")
    assert (tmp_path / "out/report.html").read_bytes() == page and again.photos


def test_control_points_place_new_photos(colmap, photos, monkeypatch, tmp_path, capsys):
    """The survey is off from the database by 5 cm."""
    monkeypatch.setenv("COLMAP", str(colmap))
    shift = np.array([0.04, -0.02, 0.03])
    places = [(-1.5, 5.0, 1.0), (-0.5, 5.0, 2.6), (0.5, 5.0, 1.2), (1.5, 5.0, 2.4), (0.0, 4.0, 0.5), (1.0, 3.0, 0.3)]
    points, marks = ["point,x,y,z"], ["photo,point,x,y"]
    for index, place in enumerate(places):
        points.append(",".join([f"P{index}", *map(repr, (np.array(place) + shift).tolist())]))
        for name in (*photos.query_names, *photos.database_names):
            pixel = image_from_cam(photo_scene.CAMERA, photos.poses[name](np.array([place])))[0]
            marks.append(f"{name},P{index},{pixel[0]:.2f},{pixel[1]:.2f}")
    (tmp_path / "points.csv").write_text("\n".join(points))
    (tmp_path / "marks.csv").write_text("\n".join(marks))
    files = ["--control_points", tmp_path / "points.csv", tmp_path / "marks.csv"]
    assert run(photos, tmp_path / "out", "--epoch", *files, "--use_control_points", "0.002") == 0
    assert "6 control points: off by" in capsys.readouterr().err
    for name, pose in read_poses(tmp_path / "out/epoch/poses.txt").items():
        assert np.linalg.norm(pose.cam_in_world - photos.poses[name].cam_in_world - shift) < 0.02
    assert run(photos, tmp_path / "out", "--epoch", *files, "--use_control_points", "0.5") == 0
    lines = (tmp_path / "out/epoch/control_points.txt").read_text().splitlines()
    assert lines[0].startswith("point P0 ") and lines[0].endswith(" 0.5 0.5 0.5") and "mark query/" in lines[1]
    (tmp_path / "marks.csv").write_text("\n".join([*marks, marks[1], "nowhere.jpg,P0,1,2"]))
    capsys.readouterr()
    assert run(photos, tmp_path / "out", "--epoch", *files, "--use_control_points", "0.4") == 0
    warnings = capsys.readouterr().err
    assert f"(point 'P0' is marked in '{photos.query_names[0]}' before)" in warnings
    assert "--control_points: no photo of this run is nowhere.jpg" in warnings


@pytest.mark.parametrize("role", ["queries", "all"])
def test_panoramas_are_refused(colmap, photos, monkeypatch, tmp_path, capsys, role):
    monkeypatch.setenv("COLMAP", str(colmap))
    assert run(photos, tmp_path / "out", "--epoch", "--panoramas", role) == 1
    assert "--epoch" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_photos_without_intrinsics_share_a_camera_that_stays(colmap, photos, monkeypatch, tmp_path):
    """The photos are cut, so that no camera of the database has their size."""
    monkeypatch.setenv("COLMAP", str(colmap))
    (tmp_path / "new").mkdir()
    for name in photos.query_names:
        photo = cv2.imread(str(photos.image_path / name))
        assert cv2.imwrite(str(tmp_path / "new" / pathlib.PurePath(name).name), photo[:-2, :-2])
    assert run(photos, tmp_path / "out", "--epoch", queries=tmp_path / "new") == 0
    results = read_results(tmp_path / "out/localized/results.jsonl")
    assert {result["intrinsics_source"] for result in results.values()} == {"joint"}
    for name, adjusted in read_results(tmp_path / "out/epoch/results.jsonl").items():
        assert adjusted["camera"] == results[name]["camera"]
        assert adjusted["intrinsics"]["covariance"] == results[name]["intrinsics"]["covariance"]
        error = to_pose(adjusted["cam_from_world"]).cam_in_world - photos.poses[name].cam_in_world
        assert error @ np.linalg.solve(adjusted["position_covariance"], error) < 25, "within 5 standard deviations"
    for name, pose in read_poses(tmp_path / "out/epoch/poses.txt").items():
        assert pose.errors(photos.poses[name])[0] < 0.05
