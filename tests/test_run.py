"""Tests of `lazyloc run`: from files to the report by one command, with positions that are right."""

import csv
import dataclasses
import json
import logging
import pathlib
import re
import shutil
import threading

import cv2
import numpy as np
import pyproj
import pytest

import photo_scene
from colmap_lazyloc import progress
from colmap_lazyloc.__main__ import main
from colmap_lazyloc.database import DatabaseReader
from colmap_lazyloc.demo.renderer import RayGrid
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import read_model
from colmap_lazyloc.pose_formats.conventions import CAMERA_AXES
from colmap_lazyloc.pose_formats.geo import GeoOrigin
from colmap_lazyloc.pose_formats.posed_images import PosedImage
from colmap_lazyloc.poses import read_poses
from colmap_lazyloc.progress import ProgressBar
from colmap_lazyloc.project import steps
from colmap_lazyloc.project.colmap_runner import ColmapRunner
from colmap_lazyloc.project.folder import Folder
from colmap_lazyloc.project.pairs import pairs_by_viewpoint, pairs_in_sequence
from colmap_lazyloc.results import read_results
from colmap_lazyloc.serve.map import Source
from report_pages import ReportPage

MAX_POSITION_ERROR = 0.05  # in a courtyard of 20 m
ORIGIN = GeoOrigin(47.3, 8.5, 430.0)
CAMERA = photo_scene.CAMERA
WALK = [(-1.6 + 0.25 * step, -2.9 - 0.1 * step, 1.7) for step in range(8)]


@pytest.fixture
def run(colmap, photos, monkeypatch, tmp_path):
    """Returns a function that runs `lazyloc run` on the rendered photos and returns the output folder."""
    monkeypatch.setenv("COLMAP", str(colmap))

    def start(poses, *more, queries=None, exit_code=0):
        words = ["run", "--database_images", photos.image_path / "database", "--output", tmp_path / "out"]
        words += ["--queries", queries or photos.image_path / "query", *photo_scene.SIFT]
        words += [*([] if poses is None else ["--poses", poses]), *more]
        assert main([str(word) for word in words]) == exit_code
        return tmp_path / "out"

    return start


def assert_localized(output, truth):
    """Checks positions and rotations, and that there is a report."""
    poses = read_poses(output / "localized" / "poses.txt")
    assert sorted(poses) == sorted(truth)
    for name, pose in poses.items():
        position_error, rotation_error_deg = pose.errors(truth[name])
        assert position_error < MAX_POSITION_ERROR and rotation_error_deg < 0.3, name
    assert (output / "report.html").stat().st_size > 100000


def true_queries(photos):
    return {name: photos.poses[name] for name in photos.query_names}


def base(name):
    return name.rpartition("/")[2]


def write_transforms(path, photos):
    frames = []
    for name in photos.database_names:
        pose = photos.poses[name]
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = pose.rotation.T @ CAMERA_AXES["opengl"], pose.cam_in_world
        frames.append({"file_path": f"images/{base(name)}", "transform_matrix": matrix.tolist()})
    f, cx, cy, k1 = CAMERA.params
    content = {"fl_x": f, "fl_y": f, "cx": cx, "cy": cy, "k1": k1, "w": CAMERA.width, "h": CAMERA.height}
    path.write_text(json.dumps({**content, "frames": frames}))
    return path


def test_transforms_json(run, photos, tmp_path, capsys):
    poses = write_transforms(tmp_path / "transforms.json", photos)
    output = run(poses)
    assert_localized(output, true_queries(photos))
    printed = capsys.readouterr()
    assert "2 of 2 queries localized" in printed.out and "query/0.png" in printed.out
    assert "features of 6 images" in printed.err and "matching" not in printed.err  # poses need no matches of theirs
    assert printed.err.count("first pose: query/") == 1
    with DatabaseReader(output / "database.db") as database:
        assert database.image_ids == {name: index for index, name in enumerate(photos.database_names, start=1)}
        assert database.camera(photos.database_names[0]).params == (400, 400, 241, 179, -0.03, 0, 0, 0)
        assert database.num_inliers(*photos.database_names[:2]) == 0
    run(poses)
    assert "features" not in (again := capsys.readouterr().err) and "localizing" not in again
    run(poses, queries=photos.image_path / "query" / "1.png")  # a new photo needs no new features of the database
    printed = capsys.readouterr()
    assert "features" not in printed.err and "1 of 1 queries localized" in printed.out


def test_complete_database_is_for_other_programs(run, photos, capsys):
    lazy = run(photos.model_path)
    positions = (lazy / "localized" / "positions.csv").read_bytes()
    capsys.readouterr()
    output = run(photos.model_path, "--complete", "1")
    assert "matching 15 pairs" in capsys.readouterr().err
    with DatabaseReader(output / "database.db") as database:
        assert database.num_inliers(*photos.database_names[:2]) > 30
    assert (output / "localized" / "positions.csv").read_bytes() == positions
    run(photos.model_path)  # the database of a new folder has no matches
    with DatabaseReader(output / "database.db") as database:
        assert database.num_inliers(*photos.database_names[:2]) == 0


def test_features_of_many_database_images_are_extracted_when_a_query_needs_them(run, photos, monkeypatch, capsys):
    monkeypatch.setattr(steps, "MAX_NUM_EXHAUSTIVE", 5)  # of 6 database images
    few = ("--LazyLocalizer.num_retrieved", "4")
    output = run(photos.model_path, *few)
    assert_localized(output, true_queries(photos))
    assert "features of" not in (err := capsys.readouterr().err) and "WARNING" not in err
    with DatabaseReader(output / "database.db") as database:
        assert database.image_ids == {name: index for index, name in enumerate(photos.database_names, start=1)}
        assert not any(database.has_keypoints(name) for name in photos.database_names)
    settings = dict(
        zip([word.removeprefix("--") for word in photo_scene.SIFT[::2]], photo_scene.SIFT[1::2], strict=True)
    )
    with Source(output, None, settings).open().localizer as service:
        result = service.localize_photo(photos.image_path / photos.query_names[0])
        assert result.is_localized and result.pose.errors(photos.poses[photos.query_names[0]])[0] < MAX_POSITION_ERROR
    found = {path: path.read_bytes() for path in (output / "localized").rglob("*.bin")}
    run(photos.model_path, *few, "--complete", "1")
    err = capsys.readouterr().err
    assert "features of 6 images" in err and "matching 15 pairs" in err and "localizing" not in err
    with DatabaseReader(output / "database.db") as database:
        assert all(database.has_keypoints(name) for name in photos.database_names)
        assert database.num_inliers(*photos.database_names[:2]) > 30
    run(photos.model_path, *few, "--complete", "1", "--LazyLocalizer.seed", "0")  # from features in the database
    assert "localizing" in (err := capsys.readouterr().err) and "features of" not in err
    assert found and {path: path.read_bytes() for path in found} == found
    run(photos.model_path, *few)  # the database of a new folder has no features
    with DatabaseReader(output / "database.db") as database:
        assert not any(database.has_keypoints(name) for name in photos.database_names)


def test_table_in_latitude_and_longitude(run, photos, tmp_path, capsys):
    names = photos.database_names
    points = np.array([photos.poses[name].cam_in_world for name in names])
    steps = f"+proj=topocentric +ellps=WGS84 +lat_0={ORIGIN.latitude_deg} +lon_0={ORIGIN.longitude_deg}"
    steps = f"+proj=pipeline +step +inv {steps} +h_0={ORIGIN.height_m} +step +inv +proj=cart +ellps=WGS84"
    longitudes, latitudes, heights = pyproj.Transformer.from_pipeline(steps).transform(*points.T)
    rows = ["file,latitude,longitude,altitude,qw,qx,qy,qz,width,height,fx,cx,cy,k1"]
    for name, place in zip(names, np.stack([latitudes, longitudes, heights], axis=1)):
        w, x, y, z = photos.poses[name].qvec
        focal, cx, cy, k1 = CAMERA.params
        values = [*place.tolist(), w, -x, -y, -z, CAMERA.width, CAMERA.height, focal, cx, cy, k1]
        rows.append(f"{base(name)}," + ",".join(repr(float(value)) for value in values))
    (tmp_path / "poses.csv").write_text("\n".join(rows) + "\n")
    origin = f"{ORIGIN.latitude_deg},{ORIGIN.longitude_deg},{ORIGIN.height_m}"
    output = run(tmp_path / "poses.csv", "--geo_origin", origin, "--crs", "EPSG:32632")
    assert_localized(output, true_queries(photos))
    assert ReportPage(output / "report.html").queries["systems"][-1]["axes"] == ["E", "N", "H"]
    assert GeoOrigin.read(output / "model") == ORIGIN
    printed = capsys.readouterr().out
    assert_are_in_reference_system(output / "localized", "EPSG:32632")
    with (output / "localized" / "positions.csv").open(newline="") as table:
        for row in csv.DictReader(table):
            place = [[float(row[column])] for column in ("latitude_deg", "longitude_deg", "height_m")]
            (found,) = ORIGIN.from_geodetic(*place)
            assert np.linalg.norm(found - photos.poses[row["name"]].cam_in_world) < MAX_POSITION_ERROR
            assert all(
                f"{float(row[column]):.{digits}f}" in printed for column, digits in (("latitude_deg", 8), ("E", 3))
            )
    header = "query|x (m)|y (m)|z (m)|std. dev. (m)|latitude|longitude|height (m)|E (m)|N (m)|H (m)"
    assert header_of(printed) == header.split("|")
    run(tmp_path / "poses.csv", "--geo_origin", origin, "--crs", "EPSG:2232+6360")  # of Colorado
    assert header_of(capsys.readouterr().out)[-1] == "H (US survey foot)"
    run(tmp_path / "poses.csv", "--geo_origin", origin, "--crs", "EPSG:32633")
    assert_are_in_reference_system(output / "localized", "EPSG:32633")
    run(tmp_path / "poses.csv", "--geo_origin", origin)
    assert (output / "localized" / "positions.csv").read_text().splitlines()[0].endswith(",top_heading_stddev_deg")


def header_of(printed):
    """Returns the header of the table that `lazyloc run` has printed."""
    (line,) = (line for line in printed.splitlines() if line.startswith("query "))
    return re.split("  +", line)


def assert_are_in_reference_system(results, crs):
    """Checks the columns of a projected system: it turns and scales the axes of the model, east and north."""
    projection = pyproj.Proj(crs)
    covariances = {
        name: np.array(result["position_covariance"])
        for name, result in read_results(results / "results.jsonl").items()
    }
    with (results / "positions.csv").open(newline="") as table:
        rows = list(csv.DictReader(table))
    assert len(rows) == len(covariances) > 0
    for row in rows:
        place = float(row["longitude_deg"]), float(row["latitude_deg"])
        expected = [*projection(*place), float(row["height_m"])]
        assert [float(row[axis]) for axis in "ENH"] == pytest.approx(expected, abs=1e-4)
        factors = projection.get_factors(*place)
        angle = np.radians(factors.meridian_convergence)
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        turn[:2] *= factors.meridional_scale
        expected = np.sqrt(np.diag(turn @ covariances[row["name"]] @ turn.T))
        assert [float(row[f"stddev_{axis}"]) for axis in "ENH"] == pytest.approx(expected, rel=1e-4)


def test_metashape_xml(run, photos, tmp_path):
    focal, cx, cy, k1 = CAMERA.params
    cameras = ""
    for index, name in enumerate(photos.database_names):
        pose = photos.poses[name]
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = pose.rotation.T, pose.cam_in_world
        values = " ".join(map(repr, matrix.ravel().tolist()))
        cameras += f'<camera id="{index}" sensor_id="0" label="{base(name)}"><transform>{values}</transform></camera>'
    (tmp_path / "cameras.xml").write_text(f"""<document><chunk><sensors><sensor id="0" label="s" type="frame">
<resolution width="{CAMERA.width}" height="{CAMERA.height}"/><calibration type="frame" class="adjusted"><f>{focal}</f>
<cx>{cx - CAMERA.width / 2}</cx><cy>{cy - CAMERA.height / 2}</cy><k1>{k1}</k1></calibration></sensor></sensors>
<cameras>{cameras}</cameras></chunk></document>""")
    assert_localized(run(tmp_path / "cameras.xml"), true_queries(photos))


@pytest.fixture(scope="session")
def walk(tmp_path_factory):
    """Renders a walk as a video at 4 frames a second; returns it with the true poses."""
    path = tmp_path_factory.mktemp("walk") / "walk.avi"
    rectangles, rays = photo_scene.build_courtyard(), RayGrid(CAMERA)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 4, (CAMERA.width, CAMERA.height))
    writer.set(cv2.VIDEOWRITER_PROP_QUALITY, 98)
    poses = [photo_scene.look_at_target(centre, roll_deg=1.0) for centre in WALK]
    for index, pose in enumerate(poses):
        writer.write(photo_scene.take_photo(rectangles, rays, pose, seed=100 + index))
    writer.release()
    return path, poses


def test_video_of_a_walk(run, photos, walk, tmp_path):
    path, poses = walk
    output = run(photos.model_path, "--frames_per_second", 2, queries=path)
    assert_localized(output, {f"query/{index:06}.jpg": poses[index] for index in (0, 2, 4, 6)})


@pytest.fixture
def film(colmap, photos, walk, monkeypatch, tmp_path):
    """Returns a function that localizes photos among the frames of a video."""
    monkeypatch.setenv("COLMAP", str(colmap))

    def start(*more, exit_code=0):
        words = ["run", "--database_images", walk[0], "--frames_per_second", 4, "--output", tmp_path / "out"]
        words += ["--queries", photos.image_path / "query", *photo_scene.SIFT, *more]
        assert main([str(word) for word in words]) == exit_code
        return tmp_path / "out"

    return start


@pytest.mark.parametrize("is_long", [False, True])
def test_video_of_the_place_as_database(film, photos, walk, monkeypatch, is_long, capfd):
    """The mapper has a unit of its own: the ratio of two distances has none."""
    if is_long:
        monkeypatch.setattr(steps, "MAX_NUM_EXHAUSTIVE", 6)
        monkeypatch.setattr(steps, "SEQUENCE_REACH", 2)
    output = film()
    frames = {f"database/{index:06}.jpg": pose for index, pose in enumerate(walk[1])}
    model = read_model(output / "model")
    assert set(model.images) == set(frames) and len(model.cameras) == 1
    found = {name: image.cam_from_world.cam_in_world for name, image in model.images.items()}
    found |= {name: pose.cam_in_world for name, pose in read_poses(output / "localized" / "poses.txt").items()}
    true = {name: pose.cam_in_world for name, pose in (frames | true_queries(photos)).items()}
    assert set(found) == set(true)
    unit = np.linalg.norm(true["database/000007.jpg"] - true["database/000000.jpg"]) / np.linalg.norm(
        found["database/000007.jpg"] - found["database/000000.jpg"]
    )
    for first, second in (("query/0.png", "query/1.png"), ("query/0.png", "database/000003.jpg")):
        distance = np.linalg.norm(true[first] - true[second])
        assert unit * np.linalg.norm(found[first] - found[second]) == pytest.approx(distance, rel=0.03)
    log = (output / "log.txt").read_text()
    assert ("vocab_tree_matcher" in log) == is_long and "--match_type pairs" in log


def test_video_of_the_place_with_poses(film, photos, walk, tmp_path):
    """Poses belong to frames by their numbers, as apps of phones write them beside a video."""
    rows = ["timestamp, frame, x, y, z, qx, qy, qz, qw"]
    for index, pose in enumerate(walk[1]):
        w, x, y, z = pose.inverse().qvec
        rows.append(", ".join(map(str, [100 + index / 4, f"{index:06}", *pose.cam_in_world, x, y, z, w])))
    (tmp_path / "odometry.csv").write_text("\n".join(rows))
    assert_localized(film("--poses", tmp_path / "odometry.csv", "--camera", CAMERA.text()), true_queries(photos))


def test_sequence_is_localized_together(run, photos, walk, tmp_path):
    path, poses = walk
    output = run(photos.model_path, "--frames_per_second", 2, "--sequence", queries=path)
    assert_localized(output, {f"query/{index:06}.jpg": poses[index] for index in (0, 2, 4, 6)})
    with DatabaseReader(output / "queries.db") as database:
        assert database.num_inliers("query/000000.jpg", "query/000002.jpg") > 30
    assert re.search(r"group_size *= *5", (output / "localized" / "options.ini").read_text())


def test_masks_of_both_sides(run, photos, tmp_path):
    """The masks hide the left third of all photos."""
    mask = np.full((CAMERA.height, CAMERA.width), 255, np.uint8)
    mask[:, : CAMERA.width // 3] = 0
    for name in photos.poses:
        path = tmp_path / "masks" / f"{name}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), mask)
    output = run(photos.model_path, "--masks", tmp_path / "masks")
    assert_localized(output, true_queries(photos))
    with DatabaseReader(output / "queries.db") as database:
        assert sorted(database.image_ids) == sorted(photos.poses)
        for name in photos.poses:
            assert database.keypoints(name)[:, 0].min() > CAMERA.width / 3 - 1


def test_without_poses_the_mapper_makes_them(run, photos):
    output = run(None)
    model = read_model(output / "model")
    assert len(model.images) >= 5
    poses = read_poses(output / "localized" / "poses.txt")
    assert sorted(poses) == photos.query_names
    # The mapper's coordinates are arbitrary: compare ratios of distances.
    names = [*photos.query_names, *(name for name in photos.database_names if name in model.images)]
    found = np.array([(poses.get(name) or model.images[name].cam_from_world).cam_in_world for name in names])
    true = np.array([photos.poses[name].cam_in_world for name in names])
    distances, true_distances = (np.linalg.norm(points[:, None] - points, axis=2) for points in (found, true))
    scale = distances.sum() / true_distances.sum()
    assert np.abs(distances / scale - true_distances).max() < 0.1


def test_mapper_keeps_given_intrinsics(run, capsys):
    assert run(None, "--camera", "PINHOL 1 2 3", exit_code=1) and "PINHOLE" in capsys.readouterr().err
    wrong_size = " ".join(map(str, [CAMERA.model, CAMERA.width, CAMERA.height + 1, *CAMERA.params]))
    assert run(None, "--camera", wrong_size, exit_code=1) and "--camera is for" in capsys.readouterr().err
    output = run(None, "--camera", CAMERA.text())
    model = read_model(output / "model")
    assert len(model.images) >= 5
    assert [CAMERA.text()] == [camera.text() for camera in model.cameras.values()]


def test_many_photos_without_poses_are_matched_by_retrieval(run, photos, monkeypatch, capsys):
    monkeypatch.setattr(steps, "MAX_NUM_EXHAUSTIVE", 5)  # of 6 database images
    monkeypatch.setattr(steps, "NUM_RETRIEVED", 4)
    output = run(None)
    assert "matching 6 images with those that look alike" in capsys.readouterr().err
    assert (output / "vocab_tree.bin").stat().st_size > 10000
    retrieved = [line.split() for line in (output / "lists" / "retrieved.txt").read_text().splitlines()]
    assert sorted(name for line in retrieved for name in line) == photos.database_names
    assert len(read_model(output / "model").images) >= 5
    assert sorted(read_poses(output / "localized" / "poses.txt")) == photos.query_names


def test_names_with_blanks(run, photos, tmp_path):
    folder = tmp_path / "my queries"
    folder.mkdir()
    shutil.copy(photos.image_path / "query" / "0.png", folder / "my photo.png")
    output = run(photos.model_path, queries=folder)
    assert_localized(output, {"query/my_photo.png": photos.poses["query/0.png"]})


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--queries", "none"], "none: does not exist"),
        (["--poses", "none"], "none: does not exist"),
        (["--masks", "none"], "--masks none"),
        (["--query_camera", "PINHOLE"], "--query_camera"),
        (["--no_such_option", "1"], "--no_such_option"),
        (["--onnx_path", "none"], "--onnx_path none: is not a folder"),
        (["--LazyLocalizer.no_such_option", "1"], "no_such_option"),
    ],
)
def test_bad_options_are_one_line(run, photos, words, message, capsys):
    run(photos.model_path, *words, exit_code=1)
    steps = (": features of", ": matching", ": poses agree", ": localizing")
    lines = [line for line in capsys.readouterr().err.splitlines() if not any(step in line for step in steps)]
    assert len(lines) == 1 and message in lines[0]


def test_video_that_is_none(run, photos, tmp_path, capfd):
    (tmp_path / "walk.mp4").write_bytes(b"no video")
    run(photos.model_path, queries=tmp_path / "walk.mp4", exit_code=1)
    assert "walk.mp4: is neither a photo nor a video" in capfd.readouterr().err


def test_cause_of_a_failed_command_is_named_without_colours(tmp_path):
    colmap = tmp_path / "colmap"
    printed = r"\033[0;31mE20261125 12:00:00.000000  1 a.cc:2] no such option\n\033[m\n"
    colmap.write_text(f"#!/bin/sh\nprintf '{printed}'\nexit 1\n")
    colmap.chmod(0o755)
    with pytest.raises(InputError, match=r"^colmap mapper failed: no such option \(log: "):
        ColmapRunner(tmp_path / "log.txt").run([colmap, "mapper"])


LOG = (
    "I1 incremental_mapper.cc:225] Loading database",
    "I1 incremental_mapper.cc:265] Finding good initial image pair",
    "I1 incremental_mapper.cc:289] Initializing with image pair #5 and #6",
    "I1 feature_extraction.cc:257] Processed file [3/40]",
    "I1 incremental_mapper.cc:375] Registering image #6 (7)",
    "I1 incremental_pipeline.cc:537] Registering image #6 (num_reg_frames=8)",
    "I1 incremental_mapper.cc:378] => Image sees 395 / 894 points",
    "I1 pairing.cc:400] Matching image [2/5]",
)
COUNTS = [
    (0, 20, "loading the matches"),
    (0, 20, "looking for two photos to begin with"),
    (2, 20, "photos have poses"),
    (3, 40, "photos"),
    (7, 20, "photos have poses"),
    (8, 20, "photos have poses"),
    (2, 5, "photos"),
]


def test_progress_counts_what_a_step_has_done(monkeypatch, caplog):
    shown = []

    class Bar:
        def __init__(self, leave, total, postfix, bar_format):
            assert not leave and bar_format is None
            shown.append((0, total, postfix))

        def set_postfix_str(self, text, refresh):
            shown.append((self.n, self.total, text))

        def clear(self):
            shown.append("cleared")

        def refresh(self):
            shown.append("drawn")

    monkeypatch.setattr(progress, "terminal_bar", lambda: Bar)
    bar = ProgressBar("mapping", 20, "photos have poses")
    for line in LOG:
        bar.read(line, {})
    bar.read("", {"done": 1, "of": 4})
    assert bar._bar.bar_format is None
    with bar.hidden():  # a line that is written meanwhile stands alone
        shown.append("line")
    assert shown == [(0, 20, "photos have poses"), *COUNTS, (1, 4, "queries"), "cleared", "line", "drawn"]


def test_progress_of_the_mapper_does_not_go_back_when_a_second_model_begins(monkeypatch, caplog):
    monkeypatch.setattr(progress, "terminal_bar", lambda: None)
    monkeypatch.setattr(progress, "SECONDS_PER_LINE", -1)
    caplog.set_level("INFO", logger="colmap_lazyloc")
    bar = ProgressBar("mapping", 20, "photos have poses")
    begin, pair, image = LOG[1], LOG[2], "I1 incremental_mapper.cc:375] Registering image #6 ({})"
    for line in (begin, pair, begin, pair, image.format(7), image.format(6), begin, pair, image.format(3), begin):
        bar.read(line, {})
    counts = [message.partition(", about")[0] for message in caplog.messages[1:]]
    looking = "looking for two photos to begin with: 0 s passed"
    first = [
        looking,
        "2 of 20 photos have poses",
        looking,
        "2 of 20 photos have poses",
        *2 * ["7 of 20 photos have poses"],
    ]
    others = "7 of 20 photos have poses; trying to connect the others"
    assert counts == [*first, *4 * [others]]
    bar.read(image.format(8), {})
    assert caplog.messages[-1].startswith("8 of 20 photos have poses, about")


def test_bar_without_a_total_shows_what_is_done_and_the_time(monkeypatch):
    formats = []

    class Bar:
        def __init__(self, **options):
            formats.append(options["bar_format"])

        def set_postfix_str(self, text, refresh):
            formats.append(self.bar_format)

    monkeypatch.setattr(progress, "terminal_bar", lambda: Bar)
    bar = ProgressBar("", what="comparing")
    bar.show(0, 0, "indexing 75 images")
    bar.show(1, 25, "queries")
    assert formats == ["comparing [{elapsed}]", "indexing 75 images [{elapsed}]", None]


def test_lines_of_progress_have_the_time_that_is_left(monkeypatch, caplog):
    monkeypatch.setattr(progress, "terminal_bar", lambda: None)
    now = 1000.0
    monkeypatch.setattr(progress.time, "monotonic", lambda: now)
    caplog.set_level("INFO", logger="colmap_lazyloc")
    bar = ProgressBar("mapping", 20, "photos have poses")
    for seconds, done in ((20, 1), (40, 2), (45, 3), (400, 20), (4000, 30), (40000, 40)):
        now = 1000.0 + seconds
        bar.show(done, 40, "photos")
    assert caplog.messages == [
        "mapping",
        "2 of 40 photos, about 13 min left",
        "20 of 40 photos, about 7 min left",
        "30 of 40 photos, about 22 min left",
        "40 of 40 photos",
    ]
    bar.show(1, 40, "photos")
    assert len(caplog.messages) == 5, "at most a line every 30 seconds"
    now = 41100.0
    bar.read("I1 incremental_mapper.cc:265] Finding good initial image pair", {})
    assert caplog.messages[-1] == "looking for two photos to begin with: 11.1 h passed"


@pytest.mark.parametrize("has_terminal", [True, False])
def test_time_goes_on_while_a_program_prints_nothing(monkeypatch, caplog, has_terminal):
    drawn = threading.Semaphore(0)

    class Bar:
        def __init__(self, **options):
            pass

        def refresh(self):
            drawn.release()

        def close(self):
            pass

    class Lines(logging.Handler):
        def emit(self, record):
            if record.getMessage().startswith("photos have poses: "):
                drawn.release()

    monkeypatch.setattr(progress, "terminal_bar", lambda: Bar if has_terminal else None)
    monkeypatch.setattr(progress, "SECONDS_PER_TICK", 0.01)
    monkeypatch.setattr(progress, "SECONDS_PER_LINE", 0.01)
    caplog.set_level("INFO", logger="colmap_lazyloc")
    logging.getLogger("colmap_lazyloc").addHandler(lines := Lines())
    try:
        with ProgressBar("mapping", 0, "photos have poses"):
            assert drawn.acquire(timeout=60) and drawn.acquire(timeout=60)
    finally:
        logging.getLogger("colmap_lazyloc").removeHandler(lines)


@pytest.mark.parametrize(("num_pairs", "largest"), [(10, 6), (100, 10), (1000, 50), (9999, 50)])
def test_pairs_are_matched_in_parts_that_take_some_seconds(monkeypatch, tmp_path, num_pairs, largest):
    """A pair takes a tenth of a second."""
    parts, shown, seconds = [], [], [0.0]

    class Runner:
        def run(self, words):
            parts.append(pathlib.Path(words[-1]).read_text().split("\n")[:-1])
            seconds[0] += 0.1 * len(parts[-1])

    monkeypatch.setattr(steps.time, "monotonic", lambda: seconds[0])
    monkeypatch.setattr(steps.Project, "_command", lambda self, name: [name])
    monkeypatch.setattr(ProgressBar, "show", lambda self, done, total, what: shown.append((done, total, what)))
    fields = dict.fromkeys(field.name for field in dataclasses.fields(steps.Project))
    project = steps.Project(**{**fields, "folder": Folder(tmp_path), "runner": Runner()})
    pairs = [(f"{index}", "x") for index in range(num_pairs)]
    project.match(tmp_path / "database.db", pairs)
    assert [pair for part in parts for pair in part] == [f"{first} {second}" for first, second in pairs]
    assert shown[0] == (4, num_pairs, "pairs"), "the first count is there soon"
    assert shown[-1] == (num_pairs, num_pairs, "pairs") and max(map(len, parts)) == largest


def test_pairs_by_viewpoint_are_near_and_look_the_same_way():
    """Cameras on a line look north; the last one looks south from the middle."""
    poses = [photo_scene.demo.upright_pose(np.array([x, 0.0, 0]), np.array([x, 9.0, 0]), 0) for x in range(20)]
    poses.append(photo_scene.demo.upright_pose(np.array([9.5, 0.0, 0]), np.array([9.5, -9.0, 0]), 0))
    images = [PosedImage(f"{index:02}", CAMERA, pose) for index, pose in enumerate(poses)]
    pairs = pairs_by_viewpoint(images, 4)
    assert {abs(int(first) - int(second)) for first, second in pairs} <= {1, 2, 3, 4}
    assert not any("20" in pair for pair in pairs)
    assert {("00", "01"), ("09", "10"), ("18", "19")} <= set(pairs) and len(pairs) < 60


def test_pairs_in_sequence():
    assert pairs_in_sequence("abcd", 2) == [("a", "b"), ("a", "c"), ("b", "c"), ("b", "d"), ("c", "d")]
