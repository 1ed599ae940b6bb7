"""Tests of the output of `colmap lazy_localizer`: poses.txt, results.jsonl, options.ini and model/."""

import csv
import json
import re
import shutil
import subprocess

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colmap_lazyloc.pose_formats.angles import LEVEL_CAMERA, YAW_PITCH_ROLL
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.results import to_pose
from colmap_lazyloc.testing import synthetic

STAGES = ["load", "two_view", "rotation", "translation", "triangulation", "adjustment", "covariance"]


@pytest.fixture(scope="module")
def noisy_run(localize, noisy):
    run = localize(*noisy.arguments)
    assert run.exit_code == 0, run.stderr
    return run


@pytest.fixture(scope="module")
def with_lost_query(localize, exact, tmp_path_factory, write_scene_files):
    """Makes a run in which the first query shares no matches with the database."""
    scene = exact.scene.copy()
    scene.pairs = {names: pair for names, pair in scene.pairs.items() if "query/000.jpg" not in names}
    files = write_scene_files(tmp_path_factory.mktemp("lost"), scene)
    return localize(*files.arguments)


# poses.txt


def test_poses_file_states_its_convention_and_holds_the_localized_queries_by_name(with_lost_query):
    lines = with_lost_query.poses_bytes.decode().splitlines()
    header = [line for line in lines if line.startswith("#")]
    assert lines[: len(header)] == header
    assert "qw qx qy qz tx ty tz" in " ".join(header) and "cam_from_world" in " ".join(header)
    assert [line.split()[0] for line in lines[len(header) :]] == ["query/001.jpg", "query/002.jpg"]


def test_poses_have_17_digits_and_unit_quaternions(noisy_run):
    lines = [line.split() for line in noisy_run.poses_bytes.decode().splitlines() if not line.startswith("#")]
    assert len(lines) == 3
    for _, *words in lines:
        assert len(words) == 7
        assert [f"{float(word):.17g}" for word in words] == words
        assert max(len(re.sub(r"e.*|\D", "", word).lstrip("0")) for word in words) >= 15, "numbers are cut short"
    for pose in noisy_run.poses.values():
        assert np.linalg.norm(pose.qvec) == pytest.approx(1, abs=1e-14)
        assert pose.qvec[0] >= 0


def test_exact_scene_gives_exact_poses(localize, exact):
    """Single precision of the keypoints is the only error: 3e-5 px."""
    localize(*exact.arguments).assert_localized(exact.scene, exact.scene.query_names, 5e-7, 5e-6)


def test_noisy_scene_gives_poses_within_the_noise(noisy_run, noisy):
    """The bounds are four times the errors that 0.5 px on 160 points 5 units away causes: 0.003 units, 0.03 deg."""
    noisy_run.assert_localized(noisy.scene, noisy.scene.query_names, 0.012, 0.12)


# positions.csv, positions.geojson


ANGLES = ("heading", "pitch", "roll", "top_heading")
ANGLE_FIELDS = [f"{angle}_{field}" for angle in ANGLES for field in ("deg", "stddev_deg")]


def read_table(path):
    with path.open(newline="", encoding="utf-8") as file:
        return {row["name"]: row for row in csv.DictReader(file)}


def test_positions_are_those_of_the_poses(noisy_run):
    table = read_table(noisy_run.output_path / "positions.csv")
    assert list(table) == list(noisy_run.results)
    for name, row in table.items():
        result = noisy_run.results[name]
        assert list(row) == [
            *("name", "status", "x", "y", "z", "stddev_x", "stddev_y", "stddev_z", "confidence"),
            *ANGLE_FIELDS,
        ]
        assert {field: float(row[field]) for field in ANGLE_FIELDS} == {field: result[field] for field in ANGLE_FIELDS}
        assert [float(row[axis]) for axis in "xyz"] == result["position"]
        np.testing.assert_allclose(result["position"], noisy_run.poses[name].cam_in_world, rtol=0, atol=1e-12)
        stddevs = np.array([float(row[f"stddev_{axis}"]) for axis in "xyz"])
        assert np.sum(stddevs**2) == pytest.approx(np.sum(np.square(result["position_stddevs"])))
        assert (row["status"], float(row["confidence"])) == ("LOCALIZED", result["confidence"])
    assert not (noisy_run.output_path / "positions.geojson").exists()


def test_lost_query_has_a_row_without_position(with_lost_query):
    row = read_table(with_lost_query.output_path / "positions.csv")["query/000.jpg"]
    assert row.pop("name") == "query/000.jpg" and row.pop("status") == "NO_PAIRS"
    assert set(row.values()) == {""}


def assert_is_what_is_seen(feature, result, camera):
    """Checks that the polygon of what a query sees has the ends of rays of pixels."""
    (ring,) = feature["geometry"]["coordinates"]
    assert feature["geometry"]["type"] == "Polygon" and ring[0] == ring[-1]
    outline = (np.array(ring)[:-1] - [8, 45]) * [78846, 111132]
    sides = np.roll(outline, -1, axis=0) - outline
    for place in [(0.5, 0.5), (0.05, 0.05), (0.05, 0.95), (0.95, 0.05), (0.95, 0.95)]:
        x, y = (np.array(place) - 0.5) * [camera.width, camera.height] / camera.params[0]
        ray = result["evidence"]["scene_distance"] * np.array([x, y, 1]) / np.linalg.norm([x, y, 1])
        end = result["position"] + 0.98 * to_pose(result["world_from_cam"]).rotation @ ray
        offsets = end[:2] - outline
        is_left = sides[:, 0] * offsets[:, 1] - sides[:, 1] * offsets[:, 0] > 0  # of each side, counterclockwise
        assert np.all(is_left), place


def test_model_with_an_origin_on_earth_gives_geographic_coordinates(localize, noisy, noisy_run, tmp_path):
    """At 45 degrees north, a degree is 111.1 km to the north and 78.8 km to the east."""
    shutil.copytree(noisy.model_path, tmp_path / "model")
    origin = {"latitude_deg": 45.0, "longitude_deg": 8.0, "height_m": 400.0, "frame": "ENU", "ellipsoid": "WGS84"}
    (tmp_path / "model" / "geo.json").write_text(json.dumps(origin))
    files = ["--database_path", noisy.database_path, "--input_path", tmp_path / "model"]
    run = localize(*files)
    assert run.poses_bytes == noisy_run.poses_bytes
    assert json.loads((run.output_path / "model" / "geo.json").read_text()) == origin
    table = read_table(run.output_path / "positions.csv")
    features = json.loads((run.output_path / "positions.geojson").read_text())["features"]
    by_kind = {
        kind: [feature for feature in features if feature["properties"]["shows"] == kind]
        for kind in ("position", "field_of_view")
    }
    assert sum(map(len, by_kind.values())) == len(features)
    for feature in by_kind["field_of_view"]:
        name = feature["properties"]["name"]
        assert_is_what_is_seen(feature, run.results[name], noisy.scene.cameras[noisy.scene.images[name].camera_id])
    for kind_features in by_kind.values():
        assert [feature["properties"]["name"] for feature in kind_features] == list(table)
    for row, feature in zip(table.values(), by_kind["position"], strict=True):
        for field in ANGLE_FIELDS:
            assert feature["properties"][field] == float(row[field])
        place = [float(row[column]) for column in ("longitude_deg", "latitude_deg", "height_m")]
        assert place == feature["geometry"]["coordinates"]
        metres = (np.array(place) - [8, 45, 400]) * [78846, 111132, 1]
        np.testing.assert_allclose(metres, [float(row[axis]) for axis in "xyz"], atol=0.01)
    (tmp_path / "model" / "geo.json").write_text("{}")
    bad = localize(*files)
    assert bad.exit_code == 1 and "geo.json" in bad.stderr and bad.stderr.count("\n") == 1


# results.jsonl


def test_results_of_localized_queries(noisy_run, noisy):
    assert list(noisy_run.results) == noisy.scene.query_names
    for name, result in noisy_run.results.items():
        assert (result["status"], result["reason"]) == ("LOCALIZED", "")
        assert result["cam_from_world"]["qvec"] == list(noisy_run.poses[name].qvec)
        assert result["cam_from_world"]["tvec"] == list(noisy_run.poses[name].tvec)
        assert noisy_run.pair_names(name) == noisy.scene.database_names
        for pair in result["pairs"]:
            num_inliers = len(noisy.scene.pairs[pair["name"], name].inlier_matches)
            assert pair["num_inliers"] == num_inliers
            assert 0 <= pair["rotation_error_deg"] < 0.5 and 0 <= pair["direction_error_deg"] < 1
        assert 100 < result["num_tracks"] <= 240
        assert 2 * result["num_tracks"] <= result["num_observations"] <= 10 * result["num_tracks"]
        # The mean norm of two coordinates with 0.5 px each is 0.63 px; estimating the points lowers it.
        assert 0.3 < result["mean_reprojection_error_px"] < 0.7


def test_results_hold_the_seconds_of_each_stage_and_in_total(noisy_run):
    for result in noisy_run.results.values():
        seconds = dict(result["seconds"])
        total = seconds.pop("total")
        assert set(STAGES) <= set(seconds)
        assert all(value >= 0 for value in seconds.values())
        assert sum(seconds.values()) <= 1.001 * total + 1e-6


def test_results_of_a_lost_query_have_a_reason_and_no_pose(with_lost_query):
    lost = with_lost_query.results["query/000.jpg"]
    assert lost["status"] == "NO_PAIRS"
    assert len(lost["reason"].split()) >= 3
    assert lost["cam_from_world"] is None and lost["covariance"] is None
    assert lost["pairs"] == [] and lost["num_tracks"] == 0
    assert lost["mean_reprojection_error_px"] is None
    assert lost["seconds"]["total"] >= 0


def assert_stddevs_are_of_the_covariance(result, pose, covariance):
    x, y, z = pose.tvec
    rows = -pose.rotation.T @ np.hstack([[[0, -z, y], [z, 0, -x], [-y, x, 0]], np.eye(3)])
    variances, axes = np.linalg.eigh(rows @ covariance @ rows.T)
    np.testing.assert_allclose(result["position_stddevs"], np.sqrt(variances[::-1]), rtol=1e-6)
    np.testing.assert_allclose(abs(axes[:, 2] @ result["weakest_direction"]), 1, rtol=1e-6)
    np.testing.assert_allclose(
        result["rotation_stddev_deg"], np.degrees(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1])), rtol=1e-6
    )
    assert result["rotation"] is None and result["bearing"] is None
    np.testing.assert_allclose(result["position_covariance"], rows @ covariance @ rows.T, rtol=1e-6, atol=1e-15)
    in_map = np.vstack([rows, np.hstack([-pose.rotation.T, np.zeros((3, 3))])])
    np.testing.assert_allclose(result["pose_covariance_in_map"], in_map @ covariance @ in_map.T, rtol=1e-6, atol=1e-15)
    angles = [result[f"{name}_deg"] for name in ("heading", "pitch", "roll")]
    np.testing.assert_allclose(YAW_PITCH_ROLL.rotation(angles) @ LEVEL_CAMERA, pose.rotation.T, atol=1e-9)


def angles_of(pose):
    """Returns heading, pitch, roll and the heading of the photo's top in degrees, by scipy."""
    yaw, pitch, roll = Rotation.from_matrix(pose.rotation.T @ LEVEL_CAMERA.T).as_euler("ZXY", degrees=True)
    top = -pose.rotation[1]
    return np.array([-yaw, pitch, roll, np.degrees(np.arctan2(top[0], top[1]))])


def errors_in_map(result, truth):
    """Returns the errors of position and of rotation about the axes of the map, and those of angles over deviations."""
    pose = to_pose(result["world_from_cam"])
    turn = Rotation.from_matrix(pose.rotation @ truth.rotation).as_rotvec()
    angle_errors = np.array([result[f"{name}_deg"] for name in ANGLES]) - angles_of(truth)
    stddevs = [result[f"{name}_stddev_deg"] for name in ANGLES]
    return np.concatenate([pose.tvec - truth.cam_in_world, turn]), ((angle_errors + 180) % 360 - 180) / stddevs


def test_covariance_explains_the_errors(localize, tmp_path, write_scene_files):
    """The squared errors of 24 queries, normalized by the covariance (rotation, then translation, left tangent), must
    have a mean near 6, the number of parameters. The mean scatters by 0.7, or more because queries are correlated. In
    the map they are the same, and those of each angle have a mean near 1, which scatters by 0.3."""
    scene = synthetic.make_scene(synthetic.arc(9), synthetic.arc(24, radius=5), noise_px=0.5, seed=7)
    files = write_scene_files(tmp_path, scene)
    exact = ("database_pose_stddev_deg", "database_pose_stddev_length", "focal_length_stddev_ratio")
    options = [word for name in exact for word in (f"--LazyLocalizer.Advanced.{name}", "0")]
    run = localize(*files.arguments, *options, "--LazyLocalizer.intrinsics", "given")
    squared_errors, squared_errors_in_map, squared_angle_errors = [], [], []
    for name in scene.query_names:
        covariance = np.array(run.results[name]["covariance"])
        assert covariance.shape == (6, 6)
        np.testing.assert_array_equal(covariance, covariance.T)
        assert np.all(np.linalg.eigvalsh(covariance) > 0)
        truth, pose = scene.images[name].pose, run.poses[name]
        rotation = Rotation.from_matrix(pose.rotation @ truth.rotation.T)
        error = np.concatenate([rotation.as_rotvec(), pose.tvec - truth.tvec])
        squared_errors.append(error @ np.linalg.solve(covariance, error))
        assert_stddevs_are_of_the_covariance(run.results[name], pose, covariance)
        in_map, of_angles = errors_in_map(run.results[name], truth)
        squared_errors_in_map.append(in_map @ np.linalg.solve(run.results[name]["pose_covariance_in_map"], in_map))
        squared_angle_errors.append(of_angles**2)
    assert 3 < np.mean(squared_errors) < 12
    np.testing.assert_allclose(squared_errors_in_map, squared_errors, rtol=0.02)
    means = np.mean(squared_angle_errors, axis=0)
    assert np.all((means > 0.4) & (means < 2.2)), means


# options.ini


def test_options_file_gives_the_same_run_again(localize, noisy):
    first = localize(
        *noisy.arguments,
        "--LazyLocalizer.num_retrieved",
        6,
        "--LazyLocalizer.seed",
        11,
        "--LazyLocalizer.Advanced.rig_noise_px",
        0.1 + 0.2,
        "--LazyLocalizer.num_threads",
        1,
        "--LazyLocalizer.method",
        "paper",
    )
    again = localize("--project_path", first.output_path / "options.ini")
    assert (first.exit_code, again.exit_code) == (0, 0), again.stderr
    assert again.poses_bytes == first.poses_bytes

    def options(run):
        lines = (run.output_path / "options.ini").read_text().splitlines()
        return [line for line in lines if not line.startswith("output_path=")]

    assert options(again) == options(first)
    assert {
        "num_retrieved=6",
        "seed=11",
        "rig_noise_px=0.30000000000000004",
        "method=paper",
    } <= set(options(first))


def test_options_file_holds_every_option_of_the_help(colmap, noisy_run):
    help_text = subprocess.run([colmap, "lazy_localizer", "--help-all"], capture_output=True, text=True).stdout
    # resume and overwrite say how a run begins, not what it is.
    names = set(re.findall(r"--([\w.]+) arg", help_text)) - {"project_path", "resume", "overwrite"}
    section, in_file = "", set()
    for line in (noisy_run.output_path / "options.ini").read_text().splitlines():
        if line.startswith("["):
            section = line.strip("[]") + "."
        elif not line.startswith("#"):
            in_file.add(section + line.split("=")[0])
    assert in_file == names


@pytest.mark.parametrize(
    "name",
    [
        "with space",
        "café",
        "a=b;[c]'d\"",
        pytest.param(
            "run #2",
            marks=pytest.mark.xfail(
                strict=True, reason="the reader of --project_path takes what follows # for a comment, in paths too"
            ),
        ),
    ],
)
def test_options_file_with_unusual_paths(localize, exact, tmp_path, write_scene_files, name):
    folder = tmp_path / name
    folder.mkdir()
    first = localize(*write_scene_files(folder, exact.scene).arguments)
    assert first.exit_code == 0, first.stderr
    again = localize("--project_path", first.output_path / "options.ini")
    assert again.exit_code == 0, again.stderr
    assert again.poses_bytes == first.poses_bytes


def test_command_line_wins_over_the_options_file(localize, noisy, tmp_path):
    (tmp_path / "some.ini").write_text(
        f"database_path={noisy.database_path}\ninput_path={noisy.model_path}\n[LazyLocalizer]\nnum_retrieved=3\n"
    )
    run = localize("--project_path", tmp_path / "some.ini")
    assert len(run.pair_names("query/000.jpg")) == 3
    run = localize("--project_path", tmp_path / "some.ini", "--LazyLocalizer.num_retrieved", 4)
    assert len(run.pair_names("query/000.jpg")) == 4


# model/


@pytest.mark.parametrize("binary", [True, False], ids=["binary", "text"])
def test_database_poses_keep_every_bit(localize, noisy, tmp_path, binary):
    scene = noisy.scene.copy()
    for factor, name in zip([-1, 1 + 1e-6, -1 - 1e-9, 1 - 1e-7], scene.database_names):
        pose = scene.images[name].pose
        # Quaternions may have either sign, and are normalized as poorly as those in a text file may be.
        scene.images[name].pose = Pose(factor * pose.qvec, pose.tvec)
    model_path = synthetic.write_model(tmp_path / "model", scene, binary=binary)
    run = localize("--database_path", noisy.database_path, "--input_path", model_path)
    assert set(run.model_images) == set(scene.images)
    for name in scene.database_names:
        image = scene.images[name]
        assert run.model_images[name].cam_from_world.bits() == image.pose.bits(), name
        assert (run.model_images[name].image_id, run.model_images[name].camera_id) == (image.image_id, image.camera_id)


def test_queries_in_the_model_have_the_poses_of_the_poses_file(noisy_run, noisy):
    for name in noisy.scene.query_names:
        stored = noisy_run.model_images[name]
        _, rotation_error_deg = stored.cam_from_world.errors(noisy_run.poses[name])
        assert np.radians(rotation_error_deg) < 1e-14
        assert np.all(stored.cam_from_world.tvec == noisy_run.poses[name].tvec)
        assert stored.image_id == noisy.scene.images[name].image_id
    assert len({image.image_id for image in noisy_run.model_images.values()}) == len(noisy.scene.images)


def test_pycolmap_reads_the_model(noisy_run, noisy):
    import pycolmap

    model = pycolmap.Reconstruction(noisy_run.output_path / "model")
    assert model.num_reg_images() == len(noisy.scene.images)
    for image in model.images.values():
        truth = noisy.scene.images[image.name]
        pose = Pose.of(image.cam_from_world())
        _, rotation_error_deg = pose.errors(truth.pose)
        assert np.radians(rotation_error_deg) < 0.003 and np.linalg.norm(pose.tvec - truth.pose.tvec) < 0.02
        assert image.camera.model.name == noisy.scene.cameras[truth.camera_id].model
        np.testing.assert_array_equal(image.camera.params, noisy.scene.cameras[truth.camera_id].params)
        np.testing.assert_array_equal([point.xy for point in image.points2D], truth.keypoints)
    assert 150 < model.num_points3D() <= sum(result["num_tracks"] for result in noisy_run.results.values())
    assert_tracks_hold(model)


def assert_tracks_hold(model):
    """Checks that each point is seen where its track says, and that images and tracks name each other."""
    for point_id, point in model.points3D.items():
        elements = point.track.elements
        assert len({element.image_id for element in elements}) == len(elements) >= 2
        for element in elements:
            image = model.images[element.image_id]
            seen = image.points2D[element.point2D_idx]
            assert seen.point3D_id == point_id
            assert np.linalg.norm(image.project_point(point.xyz) - seen.xy) < 6
    for image in model.images.values():
        for idx, seen in enumerate(image.points2D):
            if seen.has_point3D():
                elements = model.points3D[seen.point3D_id].track.elements
                assert (image.image_id, idx) in {(element.image_id, element.point2D_idx) for element in elements}


def test_the_built_colmap_reads_the_model(colmap, noisy_run, noisy, tmp_path):
    model_path = noisy_run.output_path / "model"
    analysis = subprocess.run([colmap, "model_analyzer", "--path", model_path], capture_output=True, text=True)
    assert analysis.returncode == 0, analysis.stderr
    report = analysis.stdout + analysis.stderr
    assert re.search(rf"Registered images: {len(noisy.scene.images)}\b", report), report
    (num_points,) = re.findall(r"\bPoints: (\d+)", report)
    assert int(num_points) > 150
    converted = subprocess.run(
        [colmap, "model_converter", "--input_path", model_path, "--output_path", tmp_path, "--output_type", "TXT"],
        capture_output=True,
        text=True,
    )
    assert converted.returncode == 0, converted.stderr
    lines = (tmp_path / "images.txt").read_text().splitlines()
    names = [line.split()[9] for line in lines if not line.startswith("#") and line.endswith(".jpg")]
    assert sorted(names) == sorted(noisy.scene.images)
    points = (tmp_path / "points3D.txt").read_text().splitlines()
    assert sum(not line.startswith("#") for line in points) == int(num_points)


# The folder


def test_output_folder_holds_these_files_alone(noisy_run):
    names = sorted(str(path.relative_to(noisy_run.output_path)) for path in noisy_run.output_path.rglob("*"))
    assert names == [
        "model",
        "model/cameras.bin",
        "model/images.bin",
        "model/points3D.bin",
        "options.ini",
        "poses.txt",
        "positions.csv",
        "results.jsonl",
    ]


def test_second_run_replaces_the_first_and_keeps_other_files(localize, noisy, tmp_path):
    first = localize(*noisy.arguments, output_path=tmp_path / "output")
    assert len(first.poses) == 3
    (first.output_path / "notes.txt").write_text("mine")
    (tmp_path / "list.txt").write_text("query/001.jpg\n")
    second = localize(*noisy.arguments, "--query_list_path", tmp_path / "list.txt", output_path=tmp_path / "output")
    assert list(second.poses) == list(second.results) == ["query/001.jpg"]
    results = first.output_path / "results.jsonl"
    assert "WARNING" not in first.stderr
    assert f"WARNING: {results}: this run replaces the results of 2 other queries\n" in second.stderr
    results.write_text(results.read_text() + "damaged\n")
    again = localize(*noisy.arguments, output_path=tmp_path / "output")
    assert "WARNING" not in again.stderr, "every query of the earlier run is in this one"
    assert (first.output_path / "notes.txt").read_text() == "mine"
    assert len(list(first.output_path.iterdir())) == 6


def test_large_coordinates(localize, exact, tmp_path):
    """Adds an offset as large as UTM coordinates; a double then still resolves about 1e-9 units."""
    scene = exact.scene.copy()
    offset = np.array([512345.0, 5812345.0, 123.0])
    for image in scene.images.values():
        image.pose = Pose.from_centre(image.pose.rotation, image.pose.cam_in_world + offset)
    model_path = synthetic.write_model(tmp_path / "model", scene)
    run = localize("--database_path", exact.database_path, "--input_path", model_path)
    run.assert_localized(scene, scene.query_names, 1e-6, 5e-6)
