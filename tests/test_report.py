"""Tests of `lazyloc report`: what a page holds. The page itself is tested in test_report_page.py."""

import csv
import json
import math
import os
import re
import shutil
import sqlite3
import subprocess
import sys

import cv2
import numpy as np
import PIL.Image
import pyproj
import pytest

import exif
from colmap_lazyloc.model import Camera, read_model
from colmap_lazyloc.pose_formats.naming import times_of
from colmap_lazyloc.pose_formats.posed_images import ORIENTATION
from colmap_lazyloc.report.__main__ import main
from colmap_lazyloc.report.facts import facts
from colmap_lazyloc.report.photos import choose_queries
from colmap_lazyloc.results import pose_of, read_results
from colmap_lazyloc.testing import synthetic
from colmap_lazyloc.testing.synthetic_run import FAILURES, QUERY_CAMERA, UGLY_NAMES, RunShape, write_run
from conftest import write_scene
from report_pages import ReportPage

UTM = (500000.0, 5000000.0, 300.0)
SHAPE = RunShape(has_ugly_names=True, has_photos=True, origin=UTM, frame_size=2)


@pytest.fixture(scope="module")
def run_path(tmp_path_factory):
    """Makes a run with every status, ugly names, UTM coordinates, rigs and photos."""
    return write_run(tmp_path_factory.mktemp("run") / "<i>it's" / "<script>alert(1)", SHAPE)


@pytest.fixture(scope="module")
def page(run_path, tmp_path_factory):
    output = tmp_path_factory.mktemp("page") / "report.html"
    return make_page(run_path, output, "--image_path", run_path / "images", "--ground_truth", run_path / "truth")


def make_page(run_path, output, *options):
    assert main([str(word) for word in (run_path, "--output", output, *options)]) == 0
    return ReportPage(output / "index.html" if output.is_dir() else output)


# Head and table


def test_every_query_is_listed_the_least_certain_first(run_path, page):
    results = read_results(run_path / "results.jsonl")
    names = page.queries["names"]
    assert sorted(names) == sorted(results)
    statuses = [page.summary["statuses"][i]["name"] for i in page.queries["status"]]
    assert statuses == [results[name]["status"] for name in names]
    assert {status["name"]: status["count"] for status in page.summary["statuses"]} == {
        **dict.fromkeys(FAILURES, 1),
        "LOCALIZED": 30 - len(FAILURES),
    }
    num_failures = len(FAILURES)
    assert statuses[num_failures - 1] == "LOW_CONFIDENCE" and "LOCALIZED" not in statuses[:num_failures]
    confidence = page.queries["confidence"]
    assert np.isnan(confidence[: num_failures - 1]).all() and np.all(np.diff(confidence[num_failures:]) >= 0)
    assert page.queries["reasons"][num_failures] == "" and names[0] in page.queries["reasons"][0]


def test_table_holds_the_figures_of_the_results(run_path, page):
    for name, result in read_results(run_path / "results.jsonl").items():
        row = {
            key: values[page.index(name)] for key, values in page.queries.items() if key not in ("frames", "systems")
        }
        expected = {
            "positionStddev": (result["position_stddevs"] or [None])[0],
            "rotationStddevDeg": result["rotation_stddev_deg"],
            "reprojectionErrorPx": result["mean_reprojection_error_px"],
            "seconds": result["seconds"]["total"],
        }
        for field, value in expected.items():
            assert row[field] == pytest.approx(math.nan if value is None else value, rel=1e-6, nan_ok=True), field
        assert row["numTracks"] == result["num_tracks"]
        assert row["numImages"] == sum(pair["rotation_error_deg"] is not None for pair in result["pairs"])
        assert page.queries["frames"][row["frame"]] == result["frame"]


def test_positions_are_those_of_the_localized_queries(run_path, page, tmp_path):
    (system,) = page.queries["systems"]
    assert system["axes"] == ["x", "y", "z"] and system["units"] == ["units"] * 3
    positions = page.queries["coordinates"].reshape(-1, 3)
    for name, result in read_results(run_path / "results.jsonl").items():
        pose = pose_of(result)  # not that of low confidence
        expected = np.full(3, np.nan) if pose is None else pose.cam_in_world
        assert np.array_equal(positions[page.index(name)], expected, equal_nan=True), name
    output = tmp_path / "report.html"
    assert main([str(run_path), "--output", str(output), "--crs", "EPSG:32632"]) == 1 and not output.exists()


def test_geographic_positions_are_also_those_of_a_reference_system(run_path, tmp_path, capsys):
    folder = tmp_path / "run"
    shutil.copytree(run_path, folder)
    name = next(name for name, result in read_results(folder / "results.jsonl").items() if pose_of(result))
    with (folder / "positions.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["name", "status", "latitude_deg", "longitude_deg", "height_m"])
        table.writerow([name, "LOCALIZED", 45.0, 9.0, 301.5])  # on the central meridian of zone 32
        table.writerow(["query/nowhere.jpg", "NO_PAIRS", "", "", ""])
    page = make_page(folder, tmp_path / "geographic.html", "--crs", "EPSG:32632")
    assert "outside" not in capsys.readouterr().err
    assert [system["axes"] for system in page.queries["systems"][1:]] == [
        ["latitude", "longitude", "height"],
        ["E", "N", "H"],
    ]
    positions = page.queries["coordinates"].reshape(-1, 3, 3)
    _, geodetic, projected = positions[page.index(name)]
    assert list(geodetic) == [45.0, 9.0, 301.5]
    length = pyproj.Geod(ellps="WGS84").inv(9, 0, 9, 45)[2]  # along the meridian, which UTM scales by 0.9996
    assert projected == pytest.approx([500000, 0.9996 * length, 301.5], abs=1e-3)
    assert np.isnan(np.delete(positions, page.index(name), axis=0)[:, 1:]).all()
    assert page.queries["systems"][-1]["units"] == ["m", "m", "m"]
    feet = make_page(folder, tmp_path / "geographic.html", "--crs", "EPSG:2232+6360").queries["systems"][-1]["units"]
    assert feet == ["US survey foot"] * 3
    capsys.readouterr()
    make_page(folder, tmp_path / "geographic.html", "--crs", "EPSG:25833")
    (line,) = (line for line in capsys.readouterr().err.splitlines() if "EPSG:25833" in line)
    area = "longitudes 12 to 18.01 and latitudes 34.79 to 84.01"
    assert f"1 of 1 positions are outside of its area of use, {area}" in line
    (folder / "positions.csv").write_text("name,latitude_deg\nx,north\n")
    assert main([str(folder), "--output", str(tmp_path / "damaged.html")]) == 1


def test_focal_lengths_are_in_pixels():
    camera = Camera("PINHOLE", 840, 560, (596.0, 596.0, 420.0, 280.0))
    intrinsics = {"origin": "guess", "verdict": "refined", "focal_factor": 596 / 1008, "focal_factor_stddev": 0.003}
    result = {"intrinsics": {**intrinsics, "contradiction": None}}
    refined = dict(facts(result, "units", camera))["Focal length"]
    assert refined == "596 ± 3 px, not the guessed 1008 px: estimated from the images"
    intrinsics |= {"origin": "given", "verdict": "confirmed", "focal_factor": 1.01}
    confirmed = dict(facts({"intrinsics": intrinsics}, "units", camera))["Focal length"]
    assert confirmed.startswith("596 px: the images agree") and confirmed.endswith("they suggest 602 ± 1.8 px")


def test_head_names_versions_inputs_and_changed_options(run_path, page):
    summary = page.summary
    assert summary["program"] == "colmap_lazyloc 0.1.0, COLMAP 3.10"
    assert {"option": "output_path", "value": str(run_path)} in summary["inputs"]
    assert summary["options"][0] == {"name": "LazyLocalizer.seed", "value": "7"}
    assert (summary["numQueries"], summary["numDatabaseImages"], summary["numPoints"]) == (30, 40, 3000)
    assert (summary["hasTruth"], summary["isLeaveOneOut"], summary["minConfidence"]) == (True, False, 0.94)


def test_true_poses_may_have_the_names_of_the_photos(run_path, page, tmp_path):
    """`lazyloc run` puts query/ in front of the names of photos."""
    name = next(name for name, result in read_results(run_path / "results.jsonl").items() if pose_of(result))
    true_pose = read_model(run_path / "truth").images[name].pose
    (tmp_path / "truth.txt").write_text(f"{name.removeprefix('query/')} {true_pose.text()}\n")
    named = make_page(run_path, tmp_path / "named.html", "--ground_truth", tmp_path / "truth.txt")
    errors = [shown.queries["positionError"][shown.index(name)] for shown in (named, page)]
    assert name.startswith("query/") and errors[0] == pytest.approx(errors[1])


def test_up_in_geographic_and_aligned_coordinates_is_z(run_path, page, tmp_path):
    """Most photos of a drone look down, so their axes do not show what is up."""
    folder = tmp_path / "run"
    shutil.copytree(run_path, folder)
    assert page.scene["up"] != [0, 0, 1]
    (folder / "positions.geojson").write_text("{}")
    assert make_page(folder, tmp_path / "geographic.html").scene["up"] == [0, 0, 1]
    (folder / "positions.geojson").unlink()
    options = (folder / "options.ini").read_text()
    (folder / "options.ini").write_text(re.sub("(?m)^input_path=.*", f"input_path={tmp_path}", options))
    (tmp_path / "alignment.txt").write_text("aligned to 5 control points\n")
    assert make_page(folder, tmp_path / "aligned.html").scene["up"] == [0, 0, 1]
    (tmp_path / "arbitrary_axes.txt").touch()
    assert make_page(folder, tmp_path / "scaled.html").scene["up"] == page.scene["up"]


def test_lengths_are_in_metres_only_if_that_is_known(run_path, page, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(run_path, folder)
    stated = make_page(folder, tmp_path / "stated.html", "--unit", "m")
    (folder / "positions.geojson").write_text("{}")
    geographic = make_page(folder, tmp_path / "geographic.html")
    assert [shown.summary["unit"] for shown in (page, stated, geographic)] == ["units", "m", "m"]
    for shown, unit in ((page, "units"), (stated, "m")):
        texts = [text for rows in shown.chunks["details/0"]["facts"] for _, text in rows]
        lengths = [text for text in texts if "along the principal axes" in text]
        assert lengths and all((" units," in text) == (unit == "units") for text in lengths)


def test_names_are_data_and_never_html(run_path, page):
    assert {f"query/{name}" for name in UGLY_NAMES} <= set(page.queries["names"])
    assert {f"database/{name}" for name in UGLY_NAMES} <= set(page.scene["databaseNames"])
    assert "<title>16 of 30 queries localized: &lt;i&gt;it&#x27;s/&lt;script&gt;alert(1)</title>" in page.text
    assert page.summary["folder"] == "<i>it's/<script>alert(1)"
    head, _, data = page.text.partition("</style>")
    data = data[: data.rindex("<script>")]
    assert "alert" not in data and head.count("alert") == 1


def test_errors_are_those_to_the_truth(run_path, page):
    truth = read_model(run_path / "truth").images
    model = read_model(run_path / "model").images
    for name, result in read_results(run_path / "results.jsonl").items():
        error = page.queries["positionError"][page.index(name)]
        if result["status"] == "LOCALIZED":
            expected, _ = model[name].cam_from_world.errors(truth[name].cam_from_world)
            assert error == pytest.approx(expected, abs=1e-6)
        else:
            assert np.isnan(error) == (result["status"] != "LOW_CONFIDENCE")


# Scene


def test_centres_at_utm_coordinates_are_exact_to_a_tenth_of_a_millimetre(run_path, page):
    model = read_model(run_path / "model").images
    origin, centres = page.scene["origin"], page.rows("queryCentres")
    assert abs(origin[1] - UTM[1]) < 1000
    assert all(array.dtype == np.float32 for array in (centres, page.scene["databaseCentres"], page.scene["points"]))
    for name, image in model.items():
        is_query = name in page.queries["names"]
        found = (
            centres[page.index(name)]
            if is_query
            else page.rows("databaseCentres")[page.scene["databaseNames"].index(name)]
        )
        assert origin + found.astype(float) == pytest.approx(image.cam_from_world.cam_in_world, abs=1e-4)


def test_rotations_are_world_from_cam_with_the_scalar_last(run_path, page):
    name, image = next(iter(read_model(run_path / "model").images.items()))
    x, y, z, w = page.rows("databaseRotations")[page.scene["databaseNames"].index(name)]
    direction_in_cam = np.array([0.3, -0.2, 1])
    vector, scalar = np.array([x, y, z]), w
    turned = direction_in_cam + 2 * np.cross(vector, np.cross(vector, direction_in_cam) + scalar * direction_in_cam)
    assert turned == pytest.approx(image.cam_from_world.rotation.T @ direction_in_cam, abs=1e-6)


def test_covariances_are_those_of_the_centres_in_the_world(run_path, page):
    for name, result in read_results(run_path / "results.jsonl").items():
        covariance = page.scene["queryCovariances"].reshape(-1, 6)[page.index(name)]
        if result["position_stddevs"] is None:
            assert np.isnan(covariance).all()
        else:
            # At UTM coordinates, 16 digits of the covariance of the translation leave about three of the centre's.
            assert np.sqrt(covariance[[0, 3, 5]]) == pytest.approx(result["position_stddevs"], rel=0.02)


def test_up_is_the_direction_of_the_sky(page):
    assert page.scene["up"][2] > 0.99


def test_queries_without_a_position_have_what_is_known(run_path, page):
    results = read_results(run_path / "results.jsonl")
    name = next(name for name, result in results.items() if result["status"] == "SCALE_UNOBSERVABLE")
    bearing = page.scene["bearings"].reshape(-1, 6)[page.index(name)]
    start = page.scene["databaseNames"].index(results[name]["bearing"]["from"])
    assert bearing[:3] == pytest.approx(page.rows("databaseCentres")[start])
    assert bearing[3:] == pytest.approx(results[name]["bearing"]["direction"], abs=1e-6)
    assert np.isnan(page.rows("queryCentres")[page.index(name)]).all()
    assert np.isfinite(page.rows("queryRotations")[page.index(name)]).all()


def test_queries_of_a_frame_are_connected(run_path, page):
    results = read_results(run_path / "results.jsonl")
    pairs = page.scene["queryConnections"].reshape(-1, 2)
    names = [[page.queries["names"][i] for i in pair] for pair in pairs]
    assert names and all(results[first]["frame"] == results[second]["frame"] for first, second in names)
    num_posed = sum(np.isfinite(page.rows("queryCentres")[:, 0]))
    assert len(names) < num_posed / 2 + 1


def test_points_belong_to_the_queries_that_see_them(run_path, page):
    model = read_model(run_path / "model").images
    points = page.rows("points").astype(float) + page.scene["origin"]
    for i, name in enumerate(page.queries["names"]):
        seen = points[page.points_of(i)]
        if name not in model:
            assert len(seen) == 0
            continue
        keypoints = model[name].points2d[model[name].points2d["point3d_id"] != -1]
        assert len(seen) == len(keypoints) > 0
        xy = QUERY_CAMERA.image_from_cam(model[name].cam_from_world(seen))
        distances = np.linalg.norm(xy[:, None] - np.stack([keypoints["x"], keypoints["y"]], axis=1), axis=2)
        assert np.max(np.min(distances, axis=1)) < 2


def test_any_number_of_the_first_points_shows_the_points_of_all_queries(page):
    first = range(len(page.rows("points")) // 10)
    assert all(set(page.points_of(i)) & set(first) for i in range(30) if len(page.points_of(i)) > 0)


def test_points_are_thinned_evenly_over_the_queries(run_path, tmp_path):
    page = make_page(run_path, tmp_path / "page.html", "--max_num_points", 340)
    numbers = [len(page.points_of(i)) for i in range(30)]
    assert 300 <= page.summary["numShown"]["points"] == len(page.rows("points")) <= 340
    assert max(numbers) - min(number for number in numbers if number > 0) <= 1
    assert any("of 3000 points" in note for note in page.summary["notes"])


# Photos and drawings


def test_matches_lie_on_what_the_photos_show(page):
    """Looks at the photos, which have white marks at the keypoints."""
    num_lines = 0
    for name in page.queries["names"]:
        if page.queries["isDrawn"][page.index(name)] == 0:
            continue
        drawing = page.drawing(name)
        photo = page.photos[page.queries["photo"][page.index(name)]]
        assert_bright(photo, drawing["size"], drawing["inlierXy"])
        for k, image in enumerate(drawing["images"]):
            xy = drawing["inlierDatabaseXy"].reshape(-1, 2)[drawing["inlierImages"] == k]
            assert_bright(page.photos[image["photo"]], image["size"], xy)
            num_lines += len(xy)
    assert num_lines > 3000


def assert_bright(photo, size, xy):
    """Checks that a photo is bright at pixels of the full image."""
    pixels = cv2.imdecode(np.frombuffer(photo, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert max(pixels.shape) <= 640
    columns, rows = (xy.reshape(-1, 2) * np.array(pixels.shape[::-1]) / size).astype(int).T
    assert len(columns) == 0 or np.mean(pixels[rows, columns] > 215) > 0.95


def test_points_have_the_colours_of_the_photos(page):
    colors = page.scene["pointColors"].reshape(-1, 3)
    assert len(colors) == len(page.rows("points")) and np.mean(colors > 180) > 0.95


def test_residuals_are_observed_minus_projected(run_path, page):
    image = next(i for i in read_model(run_path / "model").images.values() if i.name in page.queries["names"])
    drawing = page.drawing(image.name)
    observed = drawing["residualXy"].reshape(-1, 2)
    points = page.rows("points")[page.points_of(page.index(image.name))] + np.array(page.scene["origin"])
    projected = QUERY_CAMERA.image_from_cam(image.cam_from_world(points))
    expected = observed[:, None] - projected
    nearest = expected[np.arange(len(observed)), np.argmin(np.linalg.norm(expected, axis=2), axis=1)]
    found = drawing["residuals"].reshape(-1, 2)
    assert np.median(np.linalg.norm(found - nearest, axis=1)) < 0.1 and 0.2 < np.std(found) < 0.4


def test_images_are_also_used_if_the_focal_length_was_unknown(tmp_path):
    run_path = write_run(tmp_path / "run", RunShape(num_queries=14, num_points=100))
    results = [json.loads(line) for line in (run_path / "results.jsonl").read_text().splitlines()]
    for pair in (pair for result in results for pair in result["pairs"]):
        pair["rotation_error_deg"] = pair["direction_error_deg"] = None
    (run_path / "results.jsonl").write_text("".join(f"{json.dumps(result)}\n" for result in results))
    page = make_page(run_path, tmp_path / "page.html")
    details = page.chunks["details/0"]
    for result in results:
        index = page.index(result["name"])
        has_pose = result["status"] in ("LOCALIZED", "LOW_CONFIDENCE")
        expected = [has_pose and pair["num_inliers"] > 0 for pair in result["pairs"]]
        assert page.queries["numImages"][index] == sum(expected)
        begin, end = details["pairOffsets"][index : index + 2]
        assert details["pairIsUsed"][begin:end].tolist() == expected
    assert page.queries["numImages"].max() > 1


def test_a_photo_that_lies_on_its_side_is_shown_as_it_is(tmp_path):
    run_path = write_run(tmp_path / "run", RunShape(num_queries=14, num_points=100, has_photos=True))
    name = "query/000013.jpg"
    pixels = np.zeros((800, 600, 3), np.uint8)
    pixels[:, :300] = 255
    photo = run_path / "images" / name
    exif.write_jpeg(photo, pixels, 30)
    content = bytearray(photo.read_bytes())
    # Turn the tag of the maker, 0x010F, into the orientation: a short with the value 6.
    entry = content.index(b"\x0f\x01")
    content[entry : entry + 12] = b"\x12\x01\x03\x00\x01\x00\x00\x00\x06\x00\x00\x00"
    photo.write_bytes(content)
    assert cv2.imread(str(photo)).shape[:2] == (600, 800), "OpenCV turns it by default"
    page = make_page(run_path, tmp_path / "page.html", "--image_path", run_path / "images")
    shown = cv2.imdecode(np.frombuffer(page.photos[page.queries["photo"][page.index(name)]], np.uint8), 0)
    assert shown.shape == (640, 480) and shown[:, :200].min() > 200 and shown[:, 300:].max() < 50


def test_a_tiff_photo_that_lies_on_its_side_is_shown_as_it_is(tmp_path):
    run_path = write_run(tmp_path / "run", RunShape(num_queries=14, num_points=100, has_photos=True))
    name = "query/000013.jpg"
    pixels = np.zeros((800, 600, 3), np.uint8)
    pixels[:, :300] = 255
    orientation = PIL.Image.Exif()
    orientation[ORIENTATION] = 6
    PIL.Image.fromarray(pixels).save(run_path / "images" / name, "TIFF", exif=orientation)
    page = make_page(run_path, tmp_path / "page.html", "--image_path", run_path / "images")
    shown = cv2.imdecode(np.frombuffer(page.photos[page.queries["photo"][page.index(name)]], np.uint8), 0)
    assert shown.shape == (640, 480) and shown[:, :200].min() > 200 and shown[:, 300:].max() < 50


def test_photos_are_those_of_the_least_certain_queries_and_of_some_others(run_path, tmp_path):
    page = make_page(run_path, tmp_path / "page.html", "--image_path", run_path / "images", "--max_num_images", 12)
    has_photo = page.queries["photo"] >= 0
    unreadable = [status["name"] for status in page.summary["statuses"]].index("UNREADABLE_IMAGE")
    assert sum(has_photo) == 12 - (page.queries["status"][:9] == unreadable).sum()
    assert sum(has_photo[9:]) == 3
    assert choose_queries(100000, 80) == choose_queries(100000, 80) and choose_queries(5, 80) == [0, 1, 2, 3, 4]
    assert any("12 of 30 queries" in note for note in page.summary["notes"])


def test_without_photos_a_page_has_all_but_them(run_path, page, tmp_path):
    bare = make_page(run_path, tmp_path / "page.html", "--ground_truth", run_path / "truth")
    assert bare.photos == {} and np.all(bare.queries["photo"] == -1) and len(bare.scene["pointColors"]) == 0
    assert np.array_equal(bare.queries["confidence"], page.queries["confidence"], equal_nan=True)
    assert any("--image_path" in note for note in bare.summary["notes"])


# Runs of the program


@pytest.fixture(scope="module")
def real(localize, tmp_path_factory):
    """Makes a run with false matches, so that some matches are rejected."""
    scene = synthetic.make_scene(synthetic.arc(9), synthetic.arc(3, radius=5, phase=4), noise_px=0.5, outlier_ratio=0.3)
    for (_, name2), pair in scene.pairs.items():
        if name2 in scene.query_names:
            pair.inlier_matches = pair.matches
    files = write_scene(tmp_path_factory.mktemp("real"), scene)
    folder = tmp_path_factory.mktemp("it's a run #1")
    output = folder / "output"
    return files, localize(*files.arguments, output_path=output)


def test_matches_with_other_points_are_rejected(real, tmp_path):
    files, run = real
    assert run.exit_code == 0, run.stderr
    page = make_page(run.output_path, tmp_path / "page.html", "--database_path", files.database_path)
    for name in files.scene.query_names:
        drawing = page.drawing(name)
        for kind, is_right in (("inlier", True), ("rejected", False)):
            query_points = scene_points(files.scene, name, drawing[f"{kind}Xy"])
            same = []
            for k, image in enumerate(drawing["images"]):
                chosen = drawing[f"{kind}Images"] == k
                other = page.scene["databaseNames"][image["image"]]
                xy = drawing[f"{kind}DatabaseXy"].reshape(-1, 2)[chosen]
                same += (scene_points(files.scene, other, xy) == query_points[chosen]).tolist()
            assert len(same) > 20 and np.mean(np.array(same) == is_right) > 0.9


def scene_points(scene, name, xy):
    """Returns the scene points that keypoints show."""
    distances = np.linalg.norm(scene.images[name].keypoints[None, :, :2] - xy.reshape(-1, 1, 2), axis=2)
    assert np.all(np.min(distances, axis=1) < 1e-3)
    return scene.images[name].point_of_keypoint[np.argmin(distances, axis=1)]


def test_the_line_that_ends_a_run_makes_its_report(localize, noisy, tmp_path):
    lazyloc = tmp_path / "lazyloc"
    lazyloc.write_text(f'#!/bin/sh\ncommand=$1\nshift\nexec {sys.executable} -m "colmap_lazyloc.$command" "$@"\n')
    lazyloc.chmod(0o755)
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    run = localize(*noisy.arguments, env=environment)
    line = run.summary.splitlines()[-1]
    assert line.startswith("report: lazyloc report ")
    done = subprocess.run(line.removeprefix("report: "), shell=True, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    page = ReportPage(run.output_path / "report.html")
    assert page.summary["program"].startswith("colmap_lazyloc ") and "COLMAP" in page.summary["program"]


@pytest.mark.parametrize("is_package", [False, True])
def test_commands_repeat_a_query_alone(real, colmap, tmp_path, monkeypatch, is_package):
    """A package has the command lazy_localizer; the wheel has no `colmap`."""
    files, run = real
    (tmp_path / "bin").mkdir()
    if is_package:
        program = tmp_path / "bin" / "lazy_localizer"
        program.write_text(f'#!/bin/sh\nexec {colmap} lazy_localizer "$@"\n')
        program.chmod(0o755)
    else:
        (tmp_path / "bin" / "colmap").symlink_to(colmap)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/usr/bin:/bin")
    page = make_page(run.output_path, tmp_path / "page.html", "--database_path", files.database_path)
    name = files.scene.query_names[1]
    command = page.chunks["details/0"]["commands"][page.index(name)]
    done = subprocess.run(command, shell=True, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    repeated = read_results(tmp_path / "repeated" / "results.jsonl")
    assert list(repeated) == [name]
    assert without_seconds(repeated[name]) == without_seconds(run.results[name])


def without_seconds(result):
    return {field: value for field, value in result.items() if field != "seconds"}


def test_a_name_that_is_not_utf8_is_escaped_in_the_same_way_everywhere(localize, exact, tmp_path):
    database_path = tmp_path / "database.db"
    shutil.copy(exact.database_path, database_path)
    connection = sqlite3.connect(database_path)
    connection.execute("UPDATE images SET name = CAST(X'636166E9' AS TEXT) WHERE name = 'query/001.jpg'")
    connection.commit()
    connection.close()
    run = localize("--database_path", database_path, "--input_path", exact.model_path)
    page = make_page(run.output_path, tmp_path / "page.html", "--database_path", database_path)
    name = "caf\\xe9"
    assert name in run.poses and np.isfinite(page.rows("queryCentres")[page.index(name)]).all()
    assert len(page.drawing(name)["inlierXy"]) > 100


def test_queries_that_are_photos_have_no_keypoints_in_the_database(localize, photos, tmp_path):
    queries = photos.write_queries(tmp_path / "queries.txt")
    with queries.open("a") as file:
        file.write("missing.jpg\n")
    run = localize(*photos.arguments(queries))
    options = ("--image_path", photos.image_path, "--database_path", photos.database_path)
    page = make_page(run.output_path, tmp_path / "page.html", *options)
    assert page.queries["photo"][page.index("missing.jpg")] == -1
    for name in photos.query_names:
        assert page.queries["photo"][page.index(name)] >= 0 and len(page.drawing(name)["inlierXy"]) > 50
        assert np.std(page.drawing(name)["residuals"]) < 1


def test_results_of_the_papers_method_are_shown_alike(localize, noisy, tmp_path):
    run = localize(*noisy.arguments, "--LazyLocalizer.method", "paper")
    page = make_page(run.output_path, tmp_path / "page.html", "--database_path", noisy.database_path)
    assert len(page.rows("points")) > 100 and (page.queries["confidence"] > 0.9).all()
    assert len(page.drawing(noisy.scene.query_names[0])["inlierXy"]) > 100


@pytest.fixture(scope="module")
def left_out(localize, noisy):
    return localize(*noisy.arguments, "--LazyLocalizer.leave_one_out", 1)


def test_leave_one_out_brings_its_own_truth(left_out, tmp_path):
    page = make_page(left_out.output_path, tmp_path / "page.html")
    summary = json.loads((left_out.output_path / "leave_one_out.json").read_text())
    for pose in summary["poses"]:
        error = page.queries["positionError"][page.index(pose["name"])]
        assert error == pytest.approx(pose["position_error"], rel=1e-5)
    assert page.summary["isLeaveOneOut"] and page.summary["hasTruth"]
    assert page.summary["numDatabaseImages"] == 9 and len(page.scene["trueCentres"]) == 27
    assert page.summary["riskCoverage"]["coverage"] == [point["coverage"] for point in summary["risk_coverage"]]
    assert page.drawing(summary["poses"][0]["name"])["inlierXy"].size > 0


def test_leave_one_out_without_its_input_model_has_the_errors_still(left_out, tmp_path):
    run_path = tmp_path / "run"
    run_path.mkdir()
    for path in left_out.output_path.iterdir():
        (run_path / path.name).symlink_to(path)
    (run_path / "options.ini").unlink()
    (run_path / "options.ini").write_text("input_path=/nowhere\n")
    page = make_page(run_path, tmp_path / "page.html")
    assert page.summary["hasTruth"] and np.isfinite(page.queries["positionError"]).all()
    assert len(page.scene["trueCentres"]) == 0
    assert any("input model" in note for note in page.summary["notes"])


# Other outputs


def test_split_pages_hold_the_same(run_path, page, tmp_path):
    options = ("--image_path", run_path / "images", "--ground_truth", run_path / "truth")
    split = make_page(run_path, tmp_path / "folder", "--split", *options)
    assert split.photos == page.photos and split.chunks.keys() == page.chunks.keys()
    for name, chunk in page.chunks.items():
        for field, value in chunk.items():
            other = split.chunks[name][field]
            assert np.array_equal(other, value, equal_nan=True) if isinstance(value, np.ndarray) else other == value
    assert list(tmp_path.iterdir()) == [tmp_path / "folder"]
    make_page(run_path, tmp_path / "folder", "--split")
    assert not (tmp_path / "folder" / "photos").exists(), "files of the earlier report stayed"


def test_the_same_run_gives_the_same_page(run_path, page, tmp_path):
    options = ("--image_path", run_path / "images", "--ground_truth", run_path / "truth")
    assert make_page(run_path, tmp_path / "page.html", *options).text == page.text


def test_tum_poses_are_world_from_cam(run_path, tmp_path):
    make_page(run_path, tmp_path / "page.html", "--tum", tmp_path / "poses.tum")
    lines = [line for line in (tmp_path / "poses.tum").read_text().splitlines() if not line.startswith("#")]
    results = read_results(run_path / "results.jsonl")
    localized = sorted(name for name, result in results.items() if result["status"] == "LOCALIZED")
    assert [line.split()[0] for line in lines] == [str(i) for i in range(len(localized))]
    image = read_model(run_path / "model").images[localized[0]]
    numbers = [float(word) for word in lines[0].split()[1:]]
    assert numbers[:3] == pytest.approx(image.cam_from_world.cam_in_world, abs=1e-9)
    assert numbers[3:] == pytest.approx([*-image.cam_from_world.qvec[1:], image.cam_from_world.qvec[0]])


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["a/9.jpg", "a/10.jpg"], [("9", "a/9.jpg"), ("10", "a/10.jpg")]),
        (["frame-000020.color.png"], [("000020", "frame-000020.color.png")]),
        (["1305031102.175304.png"], [("1305031102.175304", "1305031102.175304.png")]),
        (["left/1.png", "right/1.png"], [("0", "left/1.png"), ("1", "right/1.png")]),
        (["a.jpg", "1.jpg"], [("0", "1.jpg"), ("1", "a.jpg")]),
    ],
)
def test_times_are_numbers_of_file_names_if_they_are_unique(names, expected):
    assert times_of(names) == expected


def test_plots_are_png_and_svg(run_path, tmp_path):
    pytest.importorskip("matplotlib")
    make_page(run_path, tmp_path / "page.html", "--plots", tmp_path / "plots", "--ground_truth", run_path / "truth")
    names = {path.name for path in (tmp_path / "plots").iterdir()}
    stems = ("position_error", "rotation_error", "position_stddev")
    assert names == {f"{stem}.{suffix}" for stem in stems for suffix in ("png", "svg")}
    assert cv2.imread(str(tmp_path / "plots" / "position_error.png")).std() > 10
