"""Tests which images are queries and which are database images, and which pairs and cameras are used."""

import numpy as np
import pytest

from colmap_lazyloc.poses import Pose
from colmap_lazyloc.testing import synthetic
from conftest import write_lines

MAX_ERRORS = 5e-7, 5e-6  # exact scenes: single precision of the keypoints is the only error


@pytest.fixture(scope="module")
def full(tmp_path_factory, write_scene_files):
    """Makes an exact scene with matches between all images."""
    scene = synthetic.make_scene(
        synthetic.arc(8), synthetic.arc(3, radius=5, height=-0.7, phase=4), database_pairs=True, seed=1
    )
    return write_scene_files(tmp_path_factory.mktemp("full"), scene)


@pytest.fixture
def query_list(tmp_path):
    return lambda *lines: ["--query_list_path", write_lines(tmp_path / "list.txt", lines)]


# Queries


def test_default_is_every_image_without_a_pose(localize, full, tmp_path):
    names = full.scene.database_names
    run = localize(*full.arguments)
    run.assert_localized(full.scene, full.scene.query_names, *MAX_ERRORS)
    model_path = synthetic.write_model(tmp_path / "model", full.scene, names=names[:-2])
    run = localize("--database_path", full.database_path, "--input_path", model_path)
    run.assert_localized(full.scene, full.scene.query_names + names[-2:], *MAX_ERRORS)


def test_list_of_names(localize, full, query_list):
    run = localize(*full.arguments, *query_list("# two of three", "query/002.jpg", "", "  query/000.jpg\r"))
    run.assert_localized(full.scene, ["query/000.jpg", "query/002.jpg"], *MAX_ERRORS)
    assert set(run.model_images) == {*full.scene.database_names, "query/000.jpg", "query/002.jpg"}


def test_camera_of_the_list_overrides_that_of_the_database(localize, full, tmp_path, query_list):
    """The database has a wrong focal length, as without EXIF data, and geometries that were estimated with it."""
    scene = full.scene.copy()
    true_camera = scene.cameras[2]
    scene.cameras[2] = synthetic.Camera(2, "SIMPLE_PINHOLE", 600, 500, [720.0, 300.0, 250.0])
    for names, pair in scene.pairs.items():
        if any(name.startswith("query/") for name in names):
            pair.rotation = synthetic.Rotation.from_euler("y", 8, degrees=True) * pair.rotation
    arguments = [
        "--database_path",
        synthetic.write_database(tmp_path / "database.db", scene),
        "--input_path",
        full.model_path,
    ]
    lines = [f"{name} {true_camera.intrinsics().text()}" for name in scene.query_names]
    run = localize(*arguments, *query_list(*lines))
    run.assert_localized(full.scene, scene.query_names, *MAX_ERRORS)
    wrong = localize(*arguments, "--LazyLocalizer.intrinsics", "given")
    for name, pose in wrong.poses.items():
        assert pose.errors(full.scene.images[name].pose)[0] > 0.01


def test_names_with_and_without_a_camera_in_one_list(localize, full, query_list):
    camera = full.scene.cameras[2]
    run = localize(*full.arguments, *query_list(f"query/001.jpg {camera.intrinsics().text()}", "query/000.jpg"))
    run.assert_localized(full.scene, ["query/000.jpg", "query/001.jpg"], *MAX_ERRORS)


def test_listed_image_with_a_pose_is_a_query_and_nobodys_database_image(localize, full, tmp_path, query_list):
    """Its pose, here a wrong one, is not used."""
    scene = full.scene.copy()
    scene.images["database/003.jpg"].pose = Pose(np.array([0.5, 0.5, 0.5, 0.5]), np.array([9.0, 9.0, 9.0]))
    model_path = synthetic.write_model(tmp_path / "model", scene)
    run = localize(
        "--database_path",
        full.database_path,
        "--input_path",
        model_path,
        *query_list("database/003.jpg", "query/001.jpg", "database/006.jpg"),
    )
    queries = ["database/003.jpg", "database/006.jpg", "query/001.jpg"]
    run.assert_localized(full.scene, queries, *MAX_ERRORS)
    others = [name for name in full.scene.database_names if name not in queries]
    for name in queries:
        assert run.pair_names(name) == others
    written = run.model_images["database/003.jpg"].cam_from_world
    position_error, _ = written.errors(full.scene.images["database/003.jpg"].pose)
    assert position_error <= MAX_ERRORS[0]


def test_lost_query_with_a_pose_does_not_appear_with_it(localize, exact, query_list):
    """The query is lost, because the scene has no pairs between database images."""
    run = localize(*exact.arguments, *query_list("database/003.jpg"))
    assert run.statuses == {"database/003.jpg": "NO_PAIRS"}
    assert "database/003.jpg" not in run.model_images
    assert set(run.model_images) == set(exact.scene.database_names) - {"database/003.jpg"}


def test_leave_one_out_localizes_every_posed_image_against_all_others(localize, full):
    names = full.scene.database_names
    run = localize(*full.arguments, "--LazyLocalizer.leave_one_out", 1)
    run.assert_localized(full.scene, names, *MAX_ERRORS)
    for name in names:
        assert run.pair_names(name) == [other for other in names if other != name]


def test_leave_one_out_of_a_list(localize, full, query_list):
    """Listed images are database images for each other."""
    run = localize(
        *full.arguments, "--LazyLocalizer.leave_one_out", 1, *query_list("database/005.jpg", "database/002.jpg")
    )
    run.assert_localized(full.scene, ["database/002.jpg", "database/005.jpg"], *MAX_ERRORS)
    assert "database/005.jpg" in run.pair_names("database/002.jpg")
    assert "database/002.jpg" in run.pair_names("database/005.jpg")


def test_leave_one_out_does_not_use_the_own_pose(localize, full, tmp_path, query_list):
    scene = full.scene.copy()
    scene.images["database/003.jpg"].pose = Pose(np.array([0.5, 0.5, 0.5, 0.5]), np.array([9.0, 9.0, 9.0]))
    run = localize(
        "--database_path",
        full.database_path,
        "--input_path",
        synthetic.write_model(tmp_path / "model", scene),
        "--LazyLocalizer.leave_one_out",
        1,
        *query_list("database/003.jpg"),
    )
    run.assert_localized(full.scene, ["database/003.jpg"], *MAX_ERRORS)


# Pairs


def num_inliers(scene, name1, name2):
    return len(scene.pairs[min(name1, name2), max(name1, name2)].inlier_matches)


@pytest.mark.parametrize("num_retrieved", [2, 5])
@pytest.mark.parametrize("query_name", ["query/000.jpg", "query/001.jpg"])
def test_pairs_are_those_with_most_inliers(localize, full, query_list, num_retrieved, query_name):
    names = sorted(full.scene.database_names, key=lambda name: -num_inliers(full.scene, name, query_name))
    counts = [num_inliers(full.scene, name, query_name) for name in names]
    assert counts[num_retrieved - 1] > counts[num_retrieved], "a tie: another seed is needed"
    run = localize(*full.arguments, *query_list(query_name), "--LazyLocalizer.num_retrieved", num_retrieved)
    assert run.pair_names(query_name) == sorted(names[:num_retrieved])


def test_pairs_file_in_both_directions_with_scores_and_strangers(localize, full, tmp_path):
    pairs = write_lines(
        tmp_path / "pairs.txt",
        [
            "# query, database, score",
            "query/000.jpg database/005.jpg 0.93",
            "database/001.jpg query/000.jpg",
            "query/000.jpg database/005.jpg",
            "query/000.jpg nowhere.jpg 0.5",
            "stranger.jpg database/002.jpg",
            "query/000.jpg query/000.jpg",
            "query/000.jpg query/002.jpg",
            "query/000.jpg database/007.jpg 0.1",
            "database/002.jpg database/003.jpg",
            "query/002.jpg database/000.jpg",
            "query/002.jpg database/004.jpg",
            "database/006.jpg query/002.jpg",
        ],
    )
    run = localize(*full.arguments, "--pairs_path", pairs)
    run.assert_localized(full.scene, ["query/000.jpg", "query/002.jpg"], *MAX_ERRORS)
    assert run.pair_names("query/000.jpg") == ["database/001.jpg", "database/005.jpg", "database/007.jpg"]
    assert run.pair_names("query/002.jpg") == ["database/000.jpg", "database/004.jpg", "database/006.jpg"]
    assert run.statuses["query/001.jpg"] == "NO_PAIRS"
    (warning,) = run.stderr.splitlines()
    assert all(words in warning for words in ("WARNING", "pairs.txt", "not in the database: 2", "nowhere.jpg"))


def test_all_pairs_of_a_pairs_file_are_used(localize, full, tmp_path):
    names = full.scene.database_names
    pairs = write_lines(tmp_path / "pairs.txt", [f"query/001.jpg {name}" for name in names[:6]])
    run = localize(*full.arguments, "--pairs_path", pairs, "--LazyLocalizer.num_retrieved", 2)
    assert run.pair_names("query/001.jpg") == names[:6]


def test_order_of_the_pairs_file_does_not_matter(localize, full, tmp_path):
    lines = [f"query/001.jpg {name}" for name in full.scene.database_names]
    runs = [
        localize(*full.arguments, "--pairs_path", write_lines(tmp_path / f"{i}.txt", order))
        for i, order in enumerate((lines, lines[::-1]))
    ]
    assert len(runs[0].poses) == 1
    assert runs[0].poses_bytes == runs[1].poses_bytes


# Names


@pytest.mark.parametrize("binary", [True, False], ids=["binary", "text"])
def test_names_of_any_kind(localize, full, tmp_path, query_list, binary):
    """Names may be in nested folders and have spaces, non-ASCII letters, quotes and backslashes."""
    unusual = {
        "query/000.jpg": "été 2024/日本 01.jpg",
        "query/001.jpg": "a/b/c d/e.jpg",
        "query/002.jpg": 'quote " and \\ backslash.jpg',
        "database/002.jpg": "Größe/über all.jpg",
        "database/005.jpg": "database/two  spaces.jpg",
    }
    scene = full.scene.copy()
    scene.images = {unusual.get(name, name): image for name, image in scene.images.items()}
    for name, image in scene.images.items():
        image.name = name
    scene.pairs = {
        (unusual.get(name1, name1), unusual.get(name2, name2)): pair for (name1, name2), pair in scene.pairs.items()
    }
    scene.query_names = [unusual.get(name, name) for name in scene.query_names]
    arguments = [
        "--database_path",
        synthetic.write_database(tmp_path / "database.db", scene),
        "--input_path",
        synthetic.write_model(tmp_path / "model", scene, binary=binary),
    ]
    by_default = localize(*arguments)
    by_default.assert_localized(scene, scene.query_names, *MAX_ERRORS)
    listed = localize(*arguments, *query_list(*scene.query_names))
    assert listed.poses_bytes == by_default.poses_bytes
    assert set(by_default.model_images) == set(scene.images)
    assert by_default.pair_names(scene.query_names[0]) == scene.database_names
    camera = scene.cameras[2]
    (tmp_path / "list.txt").write_text(f"a/b/c.jpg {camera.intrinsics().text()}\n")
    assert localize(*arguments, "--query_list_path", tmp_path / "list.txt").exit_code == 1
