"""Tests of photos that are not in the database: features, retrieval and matching in memory."""

import re
import shutil
import sqlite3
import subprocess

import pytest

import photo_scene


@pytest.fixture(scope="module")
def scene(photos):
    return photos


@pytest.fixture(scope="module")
def queries(scene, tmp_path_factory):
    return scene.write_queries(tmp_path_factory.mktemp("queries") / "queries.txt")


@pytest.fixture(scope="module")
def exhaustive(scene, queries, localize, fingerprint):
    """Makes a run that compares each photo with all database images."""
    before = fingerprint(scene.folder)
    run = localize(*scene.arguments(queries))
    assert fingerprint(scene.folder) == before
    return run


def run_indexer(colmap, *arguments):
    return subprocess.run(
        list(map(str, [colmap, "lazy_indexer", *arguments])), capture_output=True, text=True, timeout=300
    )


def index(colmap, scene, path, database_path=None):
    done = run_indexer(colmap, "--database_path", database_path or scene.database_path, "--index_path", path)
    assert (done.returncode, done.stdout) == (0, ""), done.stderr  # no words where other commands print JSON lines
    return done.stderr


def results_without_times(run):
    return {
        name: {key: value for key, value in result.items() if key != "seconds"} for name, result in run.results.items()
    }


def database_rows(path, sql):
    connection = sqlite3.connect(f"file:{path}?mode=ro&immutable=1", uri=True)
    rows = connection.execute(sql).fetchall()
    connection.close()
    return rows


def test_photos_are_localized_and_nothing_is_touched(scene, exhaustive):
    scene.assert_localized(exhaustive)
    for name in scene.query_names:
        assert exhaustive.pair_names(name) == scene.database_names
        stages = set(exhaustive.results[name]["seconds"])
        assert {"extraction", "retrieval", "matching", "verification", "total"} <= stages


def test_database_images_are_matched_when_a_photo_has_only_two(scene, queries, localize, tmp_path):
    """The database has no matches, from which the errors of its poses would be known."""
    assert database_rows(scene.database_path, "SELECT COUNT(*) FROM two_view_geometries") == [(0,)]
    pairs = tmp_path / "pairs.txt"
    pairs.write_text("".join(f"{name} {other}\n" for name in scene.query_names for other in scene.database_names[:2]))
    runs = [
        localize(*scene.arguments(queries, "--pairs_path", pairs, "--LazyLocalizer.num_threads", num_threads))
        for num_threads in (1, 2)
    ]
    assert results_without_times(runs[0]) == results_without_times(runs[1])
    for result in runs[0].results.values():
        noise = result["database_pose_noise"]
        assert noise["source"] == "database_pairs" and noise["num_pairs"] >= 4
        assert "database_pairs" in result["seconds"]


def test_number_and_scales_of_features_may_follow_the_database(scene, queries, localize, exhaustive):
    counts = sorted(rows for (rows,) in database_rows(scene.database_path, "SELECT rows FROM descriptors"))
    arguments = [word for word in scene.arguments(queries) if word not in photo_scene.SIFT]
    run = localize(*arguments, "--SiftExtraction.first_octave", -2, "--SiftExtraction.max_num_features", -1)
    scene.assert_localized(run)
    photos = "photos of 480 pixels with a focal length of 400"
    chosen = f"{photos}: at most {counts[-2]} features, first octave 0"
    assert run.stderr.startswith(chosen + "\n")
    assert f"# {chosen}" in (run.output_path / "options.ini").read_text().splitlines()
    for name in scene.query_names:
        numbers = [made.results[name]["num_observations"] for made in (run, exhaustive)]
        assert numbers[0] >= 0.8 * numbers[1]
    finer = localize(*arguments, "--SiftExtraction.first_octave", -1, "--SiftExtraction.max_num_features", 700)
    assert finer.stderr.startswith(f"{photos}: at most 700 features, first octave -1\n")


def test_model_has_the_photos_with_their_keypoints(scene, exhaustive):
    pycolmap = pytest.importorskip("pycolmap")
    model = pycolmap.Reconstruction(exhaustive.output_path / "model")
    images = {image.name: image for image in model.images.values()}
    assert sorted(images) == sorted(scene.poses)
    for name in scene.query_names:
        observed = [point for point in images[name].points2D if point.has_point3D()]
        assert len(observed) >= 0.5 * exhaustive.results[name]["num_tracks"]  # without those that another photo has
        assert all(0 < point.xy[0] < 480 and 0 < point.xy[1] < 360 for point in observed)


@pytest.mark.parametrize("num_threads", [1, 5])
def test_number_of_threads_does_not_matter(scene, queries, localize, exhaustive, num_threads):
    run = localize(*scene.arguments(queries, "--LazyLocalizer.num_threads", num_threads))
    assert run.poses_bytes == exhaustive.poses_bytes
    assert results_without_times(run) == results_without_times(exhaustive)


def test_one_photo_gives_the_same_pose_as_among_others(scene, localize, exhaustive, tmp_path):
    name = scene.query_names[1]
    one_query = scene.write_queries(tmp_path / "one.txt", [name])
    run = localize(*scene.arguments(one_query, "--LazyLocalizer.Advanced.cache_gb", 0))
    assert run.poses[name].bits() == exhaustive.poses[name].bits()


def test_pairs_file_says_what_is_compared(scene, queries, localize, tmp_path):
    pairs = tmp_path / "pairs.txt"
    pairs.write_text(
        "".join(
            f"{query} {name} 0.5\n"
            for query in scene.query_names
            for name in [*scene.database_names[1:5], *scene.query_names]
        )
    )
    run = localize(*scene.arguments(queries, "--pairs_path", pairs))
    scene.assert_localized(run)
    assert "WARNING" not in run.stderr  # no warning, because photos in the pairs file need not be in the database
    for name in scene.query_names:
        assert run.pair_names(name) == scene.database_names[1:5]


def test_index_is_made_on_first_use_and_chooses_images(colmap, scene, queries, localize, tmp_path):
    path = tmp_path / "index"
    arguments = scene.arguments(queries, "--retrieval_index_path", path, "--LazyLocalizer.num_retrieved", 4)
    first = localize(*arguments)
    scene.assert_localized(first)
    content = path.read_bytes()
    again = localize(*arguments)
    assert path.read_bytes() == content and again.poses_bytes == first.poses_bytes
    for name in scene.query_names:
        assert len(first.pair_names(name)) == 4
    estimate, outcome = index(colmap, scene, tmp_path / "other").splitlines()
    assert re.fullmatch(rf"{scene.database_path}: 6 images, \d+ features: about 1 MB of memory and of disk", estimate)
    assert outcome.startswith(f"{tmp_path / 'other'}: made, 6 images (6 added")
    by_indexer = localize(
        *scene.arguments(queries, "--retrieval_index_path", tmp_path / "other", "--LazyLocalizer.num_retrieved", 4)
    )
    assert results_without_times(by_indexer) == results_without_times(first)


def test_index_does_not_depend_on_the_number_of_threads(colmap, scene, tmp_path):
    for num_threads in (1, 3):
        done = run_indexer(
            colmap,
            "--database_path",
            scene.database_path,
            "--index_path",
            tmp_path / str(num_threads),
            "--LazyIndexer.num_threads",
            num_threads,
        )
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "1").read_bytes() == (tmp_path / "3").read_bytes()


def test_index_follows_the_database(colmap, scene, queries, localize, tmp_path):
    grown = tmp_path / "database.db"
    shutil.copy(scene.database_path, grown)
    path = tmp_path / "index"
    index(colmap, scene, path, grown)
    removed = scene.database_names[0]
    with sqlite3.connect(grown) as connection:
        for table in ("keypoints", "descriptors"):
            connection.execute(
                f"DELETE FROM {table} WHERE image_id = (SELECT image_id FROM images WHERE name = ?)", (removed,)
            )
        connection.execute("DELETE FROM images WHERE name = ?", (removed,))
    photo_scene.extract_features(colmap, grown, scene.image_path, scene.query_names[:1])
    assert "up to date, 6 images (1 added, 1 removed)" in index(colmap, scene, path, grown)
    assert "up to date, 6 images (0 added, 0 removed)" in index(colmap, scene, path, grown)
    run = localize(
        "--database_path",
        grown,
        "--input_path",
        scene.model_path,
        "--image_path",
        scene.image_path,
        "--query_list_path",
        scene.write_queries(tmp_path / "q.txt", scene.query_names[1:]),
        "--retrieval_index_path",
        path,
        *photo_scene.SIFT,
    )
    scene.assert_localized(run, scene.query_names[1:])
    assert run.pair_names(scene.query_names[1]) == scene.database_names[1:]


def test_kept_matches_are_a_database_that_localizes_alike(scene, queries, localize, exhaustive, tmp_path, colmap):
    kept = tmp_path / "kept.db"
    run = localize(*scene.arguments(queries, "--LazyLocalizer.Advanced.matches_output_path", kept))
    assert run.poses_bytes == exhaustive.poses_bytes
    assert [path.name for path in tmp_path.iterdir()] == ["kept.db"]
    by_id = "SELECT image_id, name FROM images ORDER BY image_id"
    images = database_rows(kept, by_id)
    assert images[: len(scene.database_names)] == database_rows(scene.database_path, by_id)
    assert [name for _, name in images[len(scene.database_names) :]] == scene.query_names
    ((num_pairs,),) = database_rows(kept, "SELECT COUNT(*) FROM two_view_geometries")
    assert num_pairs == len(scene.query_names) * len(scene.database_names)
    again = localize("--database_path", kept, "--input_path", scene.model_path)
    assert again.exit_code == 0, again.stderr
    for name in scene.query_names:
        position_error, rotation_error_deg = again.poses[name].errors(run.poses[name])
        assert position_error < 1e-5 and rotation_error_deg < 1e-4  # keypoints are stored in single precision
    subprocess.run(
        [colmap, "database_cleaner", "--type", "matches", "--database_path", kept],
        check=True,
        capture_output=True,
        timeout=60,
    )


def test_camera_of_the_options_and_of_the_database(colmap, scene, localize, exhaustive, tmp_path):
    queries = scene.write_queries(tmp_path / "names.txt", with_camera=False)
    model, _, _, *params = scene.camera_words.split()
    run = localize(
        *scene.arguments(queries, "--ImageReader.camera_model", model, "--ImageReader.camera_params", ",".join(params))
    )
    assert run.poses_bytes == exhaustive.poses_bytes
    known = tmp_path / "database.db"
    shutil.copy(scene.database_path, known)
    with sqlite3.connect(known) as connection:
        for name in scene.query_names:
            connection.execute("INSERT INTO images (name, camera_id) VALUES (?, 1)", (name,))
    run = localize(
        "--database_path", known, "--input_path", scene.model_path, "--image_path", scene.image_path, *photo_scene.SIFT
    )
    assert run.poses_bytes == exhaustive.poses_bytes
