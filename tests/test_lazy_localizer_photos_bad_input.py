"""Tests of unusable photos and files: one clear line or a status, and the other queries are still localized."""

import shutil
import sqlite3
import subprocess

import cv2
import numpy as np
import pytest

import photo_scene
from conftest import assert_refused


@pytest.fixture(scope="module")
def scene(photos):
    return photos


@pytest.fixture(scope="module")
def queries(scene, tmp_path_factory):
    return scene.write_queries(tmp_path_factory.mktemp("queries") / "queries.txt", scene.query_names[:1])


@pytest.fixture
def changed_database(scene, tmp_path):
    """Makes a copy of the database, changed by SQL."""

    def change(*statements):
        path = tmp_path / "changed.db"
        shutil.copy(scene.database_path, path)
        connection = sqlite3.connect(path)
        for statement in statements:
            connection.execute(statement)
        connection.commit()
        connection.close()
        return path

    return change


def test_bad_photos_have_a_status_and_the_good_one_is_localized(scene, localize, tmp_path):
    images = tmp_path / "images"
    (images / "query").mkdir(parents=True)
    good = scene.query_names[0]
    shutil.copy(scene.image_path / good, images / good)
    (images / "empty.jpg").write_bytes(b"")
    (images / "text.png").write_text("no image")
    (images / "cut.png").write_bytes((scene.image_path / good).read_bytes()[:40])
    (images / "folder.png").mkdir()
    (images / "loop.png").symlink_to("loop.png")
    cv2.imwrite(str(images / "grey.png"), np.full((360, 480), 127, np.uint8))
    cv2.imwrite(str(images / "tiny.png"), np.full((1, 1), 127, np.uint8))
    cv2.imwrite(str(images / "small.png"), cv2.resize(cv2.imread(str(images / good)), (240, 180)))
    noise = np.random.default_rng(0).integers(0, 255, (360, 480), np.uint8)
    cv2.imwrite(str(images / "noise.png"), noise)
    unreadable = ["empty.jpg", "text.png", "cut.png", "folder.png", "loop.png", "missing.png"]
    names = [*unreadable, "grey.png", "small.png", "noise.png"]
    queries = scene.write_queries(tmp_path / "queries.txt", [good, *names])
    queries.write_text(queries.read_text() + "tiny.png PINHOLE 1 1 1 1 0.5 0.5\n")
    run = localize(
        "--database_path",
        scene.database_path,
        "--input_path",
        scene.model_path,
        "--image_path",
        images,
        "--query_list_path",
        queries,
        *photo_scene.SIFT,
    )
    scene.assert_localized(run, [good])
    statuses = {name: run.statuses[name] for name in [*names, "tiny.png"]}
    assert statuses == {
        **dict.fromkeys(unreadable, "UNREADABLE_IMAGE"),
        "grey.png": "NO_FEATURES",
        "tiny.png": "NO_FEATURES",
        "small.png": "INCONSISTENT_INTRINSICS",
        "noise.png": "TOO_FEW_INLIERS",
    }
    assert str(images / "empty.jpg") in run.results["empty.jpg"]["reason"]
    assert "480 x 360" in run.results["small.png"]["reason"] and "240 x 180" in run.results["small.png"]["reason"]


def test_photos_of_other_pixel_formats_are_localized_alike(scene, localize, tmp_path):
    name = scene.query_names[0]
    colour = cv2.imread(str(scene.image_path / name))
    grey = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)
    alpha = np.dstack([colour, np.random.default_rng(0).integers(0, 255, grey.shape, np.uint8)])
    formats = {
        "colour.png": colour,
        "grey.png": grey,
        "alpha.png": alpha,
        "grey16.png": grey.astype(np.uint16) * 257,
        "grey.pgm": grey,
        "colour.tif": colour,
    }
    unreadable_by_colmap_3 = {"colour16.png": colour.astype(np.uint16) * 257}
    for file_name, pixels in {**formats, **unreadable_by_colmap_3}.items():
        assert cv2.imwrite(str(tmp_path / file_name), pixels)
    queries = scene.write_queries(tmp_path / "queries.txt", [*formats, *unreadable_by_colmap_3])
    run = localize(
        "--database_path",
        scene.database_path,
        "--input_path",
        scene.model_path,
        "--image_path",
        tmp_path,
        "--query_list_path",
        queries,
        *photo_scene.SIFT,
    )
    assert run.exit_code == 0, run.stderr
    for file_name in formats:
        assert run.statuses[file_name] == "LOCALIZED", (file_name, run.results[file_name]["reason"])
        position_error, rotation_error_deg = run.poses[file_name].errors(scene.poses[name])
        assert position_error < 0.05 and rotation_error_deg < 0.3, file_name
    assert run.statuses["colour16.png"] in ("UNREADABLE_IMAGE", "LOCALIZED")


def test_without_image_path_an_unknown_query_is_refused(scene, queries, localize):
    run = localize(
        "--database_path", scene.database_path, "--input_path", scene.model_path, "--query_list_path", queries
    )
    assert_refused(run, scene.query_names[0], "not in the database")


@pytest.mark.parametrize(
    "statement, words",
    [
        ("DELETE FROM descriptors", ["no posed image has descriptors", "feature_extractor"]),
        ("DROP TABLE descriptors", ["no table descriptors"]),
        ("UPDATE descriptors SET cols = 256", ["not SIFT's", "256"]),
    ],
)
def test_unusable_descriptors_are_refused(scene, queries, localize, changed_database, statement, words):
    path = changed_database(statement)
    run = localize("--database_path", path, *scene.arguments(queries)[2:])
    assert_refused(run, path, *words)


@pytest.mark.parametrize(
    "statement, words",
    [
        ("UPDATE descriptors SET data = x'00'", "table descriptors, image 1 (database/"),
        ("UPDATE keypoints SET rows = 1, data = substr(data, 1, 24)", "has 1 keypoints, but"),
    ],
)
def test_damaged_features_of_all_images_are_the_status(scene, queries, localize, changed_database, statement, words):
    run = localize("--database_path", changed_database(statement), *scene.arguments(queries)[2:])
    assert run.exit_code == 0, run.stderr
    (result,) = run.results.values()
    assert result["status"] == "DAMAGED_DATA"
    assert any(words in record for record in result["damaged_records"])


@pytest.mark.parametrize("statement", ["UPDATE descriptors SET data = x'00'", "UPDATE descriptors SET rows = -1"])
@pytest.mark.parametrize("has_index", [False, True])
def test_an_image_with_damaged_descriptors_is_left_out(
    scene, queries, localize, changed_database, tmp_path, statement, has_index
):
    name = scene.database_names[0]
    path = changed_database(
        f"{statement} WHERE image_id = (SELECT image_id FROM images WHERE name = '{name}')",
    )
    index = ["--retrieval_index_path", tmp_path / "index"] if has_index else []
    run = localize("--database_path", path, *scene.arguments(queries, *index)[2:])
    scene.assert_localized(run, scene.query_names[:1])
    assert name not in run.pair_names(scene.query_names[0])
    assert run.stderr.count("WARNING: ") == 1 and f"({name}): " in run.stderr


def test_an_image_without_descriptors_is_left_out(scene, queries, localize, changed_database):
    # Look the id up, because the extractor numbers images in the order in which its threads finish.
    path = changed_database(
        "DELETE FROM descriptors WHERE image_id = "
        f"(SELECT image_id FROM images WHERE name = '{scene.database_names[0]}')"
    )
    run = localize("--database_path", path, *scene.arguments(queries)[2:])
    scene.assert_localized(run, scene.query_names[:1])
    assert run.pair_names(scene.query_names[0]) == scene.database_names[1:]


def test_unusable_indices_are_refused_and_left_alone(colmap, scene, queries, localize, tmp_path, changed_database):
    path = tmp_path / "index"
    renamed = changed_database("UPDATE images SET name = 'other/' || name")
    subprocess.run(
        [colmap, "lazy_indexer", "--database_path", renamed, "--index_path", path],
        check=True,
        capture_output=True,
        timeout=300,
    )
    foreign = path.read_bytes()
    for content, words in [
        (b"no index", "is not a retrieval index"),
        (b"", "is not a retrieval index"),
        (foreign[:-1], "is truncated"),
        (foreign, "belongs to another"),
        (foreign.replace(b"index 3", b"index 2 COLMAP-3", 1), "was made by another version"),
    ]:
        path.write_bytes(content)
        assert_refused(localize(*scene.arguments(queries, "--retrieval_index_path", path)), path, words, "delete it")
        assert path.read_bytes() == content


def test_existing_matches_output_is_refused(scene, queries, localize, tmp_path):
    for taken in (tmp_path / "taken.db", scene.database_path):
        taken.touch()
        before = taken.read_bytes()
        run = localize(*scene.arguments(queries, "--LazyLocalizer.Advanced.matches_output_path", taken))
        assert_refused(run, taken, "exists already")
        assert taken.read_bytes() == before


def test_matches_output_that_cannot_be_made_is_refused(scene, queries, localize, tmp_path):
    path = tmp_path / "missing" / "kept.db"
    assert_refused(localize(*scene.arguments(queries, "--LazyLocalizer.Advanced.matches_output_path", path)), path)


def test_failed_run_leaves_no_matches_output(scene, queries, localize, tmp_path, changed_database):
    path = changed_database("DELETE FROM descriptors")
    run = localize(
        "--database_path",
        path,
        *scene.arguments(queries)[2:],
        "--LazyLocalizer.Advanced.matches_output_path",
        tmp_path / "kept.db",
    )
    assert_refused(run)
    assert [entry.name for entry in tmp_path.iterdir()] == ["changed.db"]


@pytest.mark.parametrize(
    "options, words",
    [
        (["--ImageReader.camera_model", "WIDE"], ["--ImageReader.camera_model", "WIDE"]),
        (["--ImageReader.camera_params", "400,241"], ["--ImageReader.camera_params", "takes 4"]),
        (["--ImageReader.camera_params", "400,241,x,0"], ["--ImageReader.camera_params", "'x'"]),
        (["--SiftExtraction.max_num_features", "0"], ["--SiftExtraction.max_num_features"]),
        (["--LazyLocalizer.Advanced.cache_gb", "-1"], ["--LazyLocalizer.Advanced.cache_gb"]),
        (["--LazyLocalizer.leave_one_out", "1"], ["--image_path", "leave_one_out"]),
    ],
)
def test_bad_options_are_refused(scene, queries, localize, options, words):
    assert_refused(localize(*scene.arguments(queries, *options)), *words)


@pytest.mark.parametrize(
    "name",
    ["retrieval_index_path", "LazyLocalizer.Advanced.matches_output_path"],
)
def test_options_of_photos_need_image_path(exact, localize, name):
    assert_refused(localize(*exact.arguments, f"--{name}", "file"), name, "--image_path")
