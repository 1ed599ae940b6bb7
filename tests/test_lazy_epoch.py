"""Tests of `colmap lazy_epoch`: new photos are adjusted together, and the database images keep every bit."""

import contextlib
import json
import shutil
import sqlite3
import subprocess

import numpy as np
import pytest

from colmap_lazyloc.model import read_model
from colmap_lazyloc.results import read_results, to_pose
from colmap_lazyloc.testing import synthetic
from conftest import write_lines

NUM_PHOTOS = 8
HIDDEN = "query/000.jpg"  # shares matches only with other new photos


@pytest.fixture(scope="module")
def files(tmp_path_factory, write_scene_files):
    scene = synthetic.make_scene(
        synthetic.arc(7), synthetic.arc(NUM_PHOTOS, radius=5, height=-0.7), noise_px=0.5, database_pairs=True
    )
    scene.pairs = {names: pair for names, pair in scene.pairs.items() if HIDDEN not in names or names[0][0] != "d"}
    return write_scene_files(tmp_path_factory.mktemp("scene"), scene)


@pytest.fixture(scope="module")
def localized(localize, files):
    run = localize(*files.arguments)
    assert run.exit_code == 0 and run.statuses[HIDDEN] == "NO_PAIRS", run.stderr
    return run


@pytest.fixture(scope="module")
def start(colmap, files):
    """Runs `colmap lazy_epoch`; `changed`: options that take the place of the usual ones."""

    def run(localized, output_path, *more, **changed):
        options = {
            "database_path": files.database_path,
            "input_path": files.model_path,
            "localized_path": localized,
            "output_path": output_path,
            **changed,
        }
        words = [word for name, value in options.items() for word in (f"--{name}", value)]
        command = [colmap, "lazy_epoch", *words, *more]
        return subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=300)

    return run


@pytest.fixture(scope="module")
def epoch(start, localized, tmp_path_factory):
    output = tmp_path_factory.mktemp("epoch") / "output"
    done = start(localized.output_path, output, "--LazyEpoch.with_database", 1)
    assert done.returncode == 0, done.stderr
    return output


def position_errors(results, files):
    poses = {name: to_pose(result["cam_from_world"]) for name, result in results.items()}
    return {name: pose.errors(files.scene.images[name].pose)[0] for name, pose in poses.items() if pose is not None}


def test_photos_are_more_exact_together(epoch, localized, files):
    alone = position_errors(localized.results, files)
    together = position_errors(read_results(epoch / "results.jsonl"), files)
    rms = [np.sqrt(np.mean([errors[name] ** 2 for name in alone])) for errors in (alone, together)]
    assert rms[1] < rms[0]


def test_photo_that_the_database_does_not_see_hangs_on_others(epoch, files):
    results = read_results(epoch / "results.jsonl")
    assert {name: result["epoch"]["hangs_on"] for name, result in results.items()} == {
        name: "new_photos" if name == HIDDEN else "database" for name in results
    }
    hidden = results[HIDDEN]
    assert hidden["status"] == "LOCALIZED" and hidden["epoch"]["is_adjusted"]
    assert position_errors(results, files)[HIDDEN] < 5 * np.linalg.norm(hidden["position_stddevs"])
    assert 0.9 <= hidden["confidence"] < 1


def test_photo_with_too_few_matches_keeps_its_pose_and_is_named(start, localized, files, tmp_path):
    name = "query/003.jpg"
    scene = files.scene.copy()
    for names, pair in scene.pairs.items():
        if name in names:
            pair.inlier_matches = pair.inlier_matches[:0]
    database = synthetic.write_database(tmp_path / "few.db", scene)
    done = start(localized.output_path, tmp_path / "output", database_path=database)
    assert done.returncode == 0 and "WARNING: 1 of the photos could not be adjusted with the others" in done.stderr
    assert name in done.stderr.split("keep their poses")[1].splitlines()[0]
    alone, together = (read_results(path / "results.jsonl") for path in (localized.output_path, tmp_path / "output"))
    assert together[name]["cam_from_world"] == alone[name]["cam_from_world"]
    assert together[name]["position_stddevs"] == pytest.approx(alone[name]["position_stddevs"], rel=1e-6)
    assert together[name].get("camera") == alone[name].get("camera")
    assert {key for key, result in together.items() if not result["epoch"]["is_adjusted"]} == {name}


def test_photo_with_too_few_matches_for_adjustment_does_not_hang(localize, start, files, write_scene_files, tmp_path):
    """Three others share 16 matches with it, two of them wrong. Only adjustment knows how uncertain the others are."""
    scene = files.scene.copy()
    shared = [names for names in scene.pairs if HIDDEN in names]
    for names in shared[3:]:
        del scene.pairs[names]
    shown = [scene.pairs[names].inlier_matches[:, names.index(HIDDEN)].tolist() for names in shared[:3]]
    keypoints = sorted(set.intersection(*map(set, shown)))[:16]
    for names in shared[:3]:
        pair = scene.pairs[names]
        is_kept = np.isin(pair.inlier_matches[:, names.index(HIDDEN)], keypoints)
        pair.matches = pair.inlier_matches = pair.inlier_matches[is_kept]
    scene.images[HIDDEN].keypoints[keypoints[:2]] += 10
    (tmp_path / "scene").mkdir()
    few = write_scene_files(tmp_path / "scene", scene)
    alone = localize(*few.arguments)
    done = start(alone.output_path, tmp_path / "epoch", database_path=few.database_path, input_path=few.model_path)
    assert done.returncode == 0, done.stderr
    results = read_results(tmp_path / "epoch/results.jsonl")
    assert results.pop(HIDDEN)["status"] == "NO_PAIRS"
    assert all(result["epoch"]["is_adjusted"] for result in results.values())


def test_model_has_both_epochs_and_the_database_keeps_every_bit(epoch, files):
    given, model = read_model(files.model_path), read_model(epoch / "model")
    assert set(model.images) == set(files.scene.images)
    for name, image in given.images.items():
        assert model.images[name].pose.bits() == image.pose.bits()
        assert model.cameras[model.images[name].camera_id] == given.cameras[image.camera_id]
    assert all((image.points2d["point3d_id"] >= 0).sum() > 50 for image in model.images.values())


def test_model_of_the_new_epoch_alone(start, localized, tmp_path):
    done = start(localized.output_path, tmp_path / "output")
    assert done.returncode == 0, done.stderr
    names = sorted(read_model(tmp_path / "output/model").images)
    assert names == [f"query/{i:03d}.jpg" for i in range(NUM_PHOTOS)]


def test_other_commands_of_colmap_read_the_model(colmap, epoch):
    done = subprocess.run([colmap, "model_analyzer", "--path", epoch / "model"], capture_output=True, text=True)
    assert done.returncode == 0 and "Registered images: 15" in done.stdout + done.stderr


def test_same_input_same_output(start, localized, epoch, tmp_path):
    start(localized.output_path, tmp_path / "output", "--LazyEpoch.with_database", 1)
    for name in ("poses.txt", "model/images.bin", "model/points3D.bin"):
        assert (tmp_path / "output" / name).read_bytes() == (epoch / name).read_bytes()


def test_given_intrinsics_stay(localize, start, files, tmp_path):
    camera = next(files.scene.cameras[image.camera_id] for image in files.scene.images.values() if image.name[0] == "q")
    params = np.array(camera.params) * 1.0005  # off, but not so far that the images contradict them
    words = f"{camera.model} {camera.width} {camera.height} {' '.join(map(str, params))}"
    queries = [f"{name} {words}" for name in files.scene.images if name.startswith("query/")]
    run = localize(*files.arguments, "--query_list_path", write_lines(tmp_path / "queries.txt", queries))
    done = start(run.output_path, tmp_path / "output")
    assert done.returncode == 0, done.stderr
    results = read_results(tmp_path / "output/results.jsonl")
    assert all(result["epoch"]["is_adjusted"] for result in results.values() if result["name"] != HIDDEN)
    cameras = read_model(tmp_path / "output/model").cameras.values()
    assert [list(camera.params) for camera in cameras] == [params.tolist()]


def test_camera_that_one_photo_has_determined_stays(localize, start, files, write_scene_files, tmp_path):
    """The others hang on this photo. Adjustment would call its focal length more certain than localization does."""
    single = "query/003.jpg"
    scene = files.scene.copy()
    scene.pairs = {
        names: pair
        for names, pair in scene.pairs.items()
        if single in names or names[0][0] == names[1][0] or set(names) & {"database/002.jpg", "database/004.jpg"}
    }
    (tmp_path / "scene").mkdir()
    few = write_scene_files(tmp_path / "scene", scene)
    alone = localize(*few.arguments, "--LazyLocalizer.intrinsics", "refine")
    assert [name for name, status in alone.statuses.items() if status == "LOCALIZED"] == [single]
    done = start(alone.output_path, tmp_path / "epoch", database_path=few.database_path, input_path=few.model_path)
    assert done.returncode == 0, done.stderr
    results = read_results(tmp_path / "epoch/results.jsonl")
    assert sum(result["status"] == "LOCALIZED" for result in results.values()) > 4
    cameras = read_model(tmp_path / "epoch/model").cameras.values()
    assert [list(camera.params) for camera in cameras] == [alone.results[single]["camera"]["params"]]
    stddevs = [np.linalg.norm(one[single]["position_stddevs"]) for one in (alone.results, results)]
    assert stddevs[1] > 0.5 * stddevs[0]


def write_control_points(files, path, *more, shift=(0.0, 0.0, 0.0)):
    """Writes six points, which all images show, with marks that are exact to half a pixel."""
    rng = np.random.default_rng(5)
    lines = []
    for index, place in enumerate(rng.uniform(-0.6, 0.6, (6, 3))):
        x, y, z = (place + shift).tolist()
        lines.append(f"point GCP {index} {x!r} {y!r} {z!r} 0.002 0.002 0.002")
        for name, image in files.scene.images.items():
            camera = files.scene.cameras[image.camera_id]
            pixel = camera.image_from_cam(image.pose(place[None]))[0] + rng.normal(0, 0.5, 2)
            lines.append(f"mark {name} {pixel[0]:.3f} {pixel[1]:.3f}")
    path.write_text("\n".join([*lines, *more, ""]))
    return path


def test_control_points_give_the_frame(start, localized, epoch, files, tmp_path):
    shift = np.array([0.05, -0.03, 0.04])
    path = write_control_points(files, tmp_path / "points.txt", shift=shift)
    words = ["--control_points_path", path, "--LazyEpoch.mark_stddev_px", "0.5", "--LazyEpoch.with_database", 1]
    done = start(localized.output_path, tmp_path / "output", *words)
    assert done.returncode == 0 and "6 control points: off by" in done.stderr, done.stderr
    assert "left out" not in done.stderr
    without, results = (read_results(path / "results.jsonl") for path in (epoch, tmp_path / "output"))
    for name, result in results.items():
        true = files.scene.images[name].pose.cam_in_world + shift
        before, after = (to_pose(each[name]["cam_from_world"]).cam_in_world for each in (without, results))
        assert np.linalg.norm(after - true) < 0.01 < np.linalg.norm(before - true), name
        assert np.linalg.norm(after - true) < 5 * np.linalg.norm(result["position_stddevs"])
    given, model = read_model(files.model_path), read_model(tmp_path / "output/model")
    assert all(model.images[name].pose.bits() == image.pose.bits() for name, image in given.images.items())


@pytest.mark.parametrize(
    "misplace",
    [
        lambda place: place[[1, 2, 0]],
        lambda place: place * 100,
        lambda place: place + [300, 0, 0],
        lambda place: place + 300 * np.sin(1e4 * place),
    ],
    ids=["axes", "unit", "shift", "nonsense"],
)
def test_control_points_that_fit_nothing_are_named_and_not_used(start, localized, epoch, files, tmp_path, misplace):
    path = write_control_points(files, tmp_path / "points.txt")
    words = [line.split(" ") for line in path.read_text().splitlines()]
    for line in words:
        if line[0] == "point":
            line[3:6] = map(repr, misplace(np.array(line[3:6], float)).tolist())
    path.write_text("\n".join(map(" ".join, words)))
    done = start(
        localized.output_path, tmp_path / "output", "--control_points_path", path, "--LazyEpoch.with_database", 1
    )
    assert done.returncode == 0, done.stderr
    named = [line for line in done.stderr.splitlines() if "control point" in line]
    assert len(named) == 1, done.stderr
    assert named[0].startswith("WARNING: the control points do not fit the poses and the photos, and are not used")
    assert "most marks are off by more than 5 px" in named[0] and "Check the coordinate system" in named[0]
    assert (tmp_path / "output/poses.txt").read_bytes() == (epoch / "poses.txt").read_bytes()


def test_wrong_mark_is_named(start, localized, files, tmp_path):
    path = write_control_points(files, tmp_path / "points.txt")
    lines = path.read_text().splitlines()
    index = next(i for i, line in enumerate(lines) if line.startswith("mark query/003.jpg"))
    lines[index] = "mark query/003.jpg 5 5"
    path.write_text("\n".join(lines))
    done = start(localized.output_path, tmp_path / "output", "--control_points_path", path)
    named = [line for line in done.stderr.splitlines() if line.startswith("WARNING: ")]
    assert len(named) == 1 and "'GCP 0' in query/003.jpg is left out" in named[0], done.stderr


def test_marks_count_in_database_images_without_matches(start, localized, files, tmp_path):
    name = sorted(read_model(files.model_path).images)[0]
    shutil.copy(files.database_path, tmp_path / "database.db")
    with contextlib.closing(sqlite3.connect(tmp_path / "database.db")) as database, database:
        database.execute("DELETE FROM images WHERE name = ?", (name,))
    path = write_control_points(files, tmp_path / "points.txt")
    lines = path.read_text().splitlines()
    lines = [f"mark {name} 5 5" if line.startswith(f"mark {name} ") else line for line in lines]
    path.write_text("\n".join(lines))
    options = {"database_path": tmp_path / "database.db"}
    done = start(localized.output_path, tmp_path / "output", "--control_points_path", path, **options)
    assert done.returncode == 0 and done.stderr.count(f"in {name} is left out") == 6, done.stderr


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("mark nowhere.jpg 1 2", "'nowhere.jpg' is neither a new photo nor a database image"),
        ("point P 1 2 3 1 1", "expected `point NAME x y z"),
    ],
)
def test_wrong_control_points_are_refused(start, localized, files, tmp_path, line, message):
    path = write_control_points(files, tmp_path / "points.txt", line)
    done = start(localized.output_path, tmp_path / "output", "--control_points_path", path)
    assert_refused(done, tmp_path, message)


@pytest.mark.parametrize("option", ["database_path", "input_path", "localized_path"])
def test_missing_file_is_named(start, localized, tmp_path, option):
    done = start(localized.output_path, tmp_path / "output", **{option: tmp_path / "missing"})
    assert_refused(done, tmp_path, str(tmp_path / "missing"))


def assert_refused(done, tmp_path, text):
    assert done.returncode == 1 and done.stderr.startswith("ERROR: ") and done.stderr.count("\n") == 1, done.stderr
    assert text in done.stderr
    assert not (tmp_path / "output").exists()


def test_damaged_result_is_named(start, localized, tmp_path):
    shutil.copytree(localized.output_path, tmp_path / "localized")
    path = tmp_path / "localized/results.jsonl"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:2], lines[2][:50], *lines[3:]]) + "\n")
    assert_refused(start(tmp_path / "localized", tmp_path / "output"), tmp_path, f"{path}:3")


def test_results_without_a_pose_are_refused(start, localized, tmp_path):
    shutil.copytree(localized.output_path, tmp_path / "localized")
    path = tmp_path / "localized/results.jsonl"
    result = json.loads(path.read_text().splitlines()[0])
    assert result["status"] == "NO_PAIRS"
    path.write_text(json.dumps(result) + "\n")
    assert_refused(start(tmp_path / "localized", tmp_path / "output"), tmp_path, "no photo is localized")


def test_output_must_not_be_the_input(start, localized):
    done = start(localized.output_path, localized.output_path)
    assert done.returncode == 1 and "--localized_path" in done.stderr


def test_impossible_confidence_is_named(start, localized, tmp_path):
    done = start(localized.output_path, tmp_path / "output", "--LazyEpoch.min_confidence", 2)
    assert_refused(done, tmp_path, "--LazyEpoch.min_confidence")
