"""A query that cannot be localized gets a status and a reason; the run goes on and ends with exit code 0."""

import numpy as np
import pytest

from colmap_lazyloc.poses import Pose
from colmap_lazyloc.testing import synthetic
from conftest import write_lines

ROW = np.stack([np.linspace(-2, 2, 7), np.zeros(7), np.full(7, -6.0)], axis=1)  # database centres on a line
MAX_ERRORS = 5e-6, 5e-5  # for exact scenes: ten times the errors of well placed cameras


@pytest.fixture
def run(localize, tmp_path, write_scene_files):
    def run_scene(scene, *arguments, geometry="pose"):
        files = write_scene_files(tmp_path, scene, geometry=geometry)
        done = localize(*files.arguments, *arguments)
        assert done.exit_code == 0, done.stderr
        assert sorted(done.results) == scene.query_names
        return done

    return run_scene


def assert_lost(done, name, statuses):
    result = done.results[name]
    assert result["status"] in statuses, result["reason"]
    assert len(result["reason"].split()) >= 4 and "\n" not in result["reason"]
    assert result["cam_from_world"] is None and result["covariance"] is None
    assert name not in done.poses and name not in done.model_images


def assert_partial_pose(done, scene, name, has_bearing=True, max_error_deg=0.01):
    """Checks rotation and bearing of a result without a position. The default bound is for exact scenes."""
    result, truth = done.results[name], scene.images[name].pose
    assert result["position_stddevs"] is None and result["weakest_direction"] is None
    _, rotation_error_deg = Pose(np.array(result["rotation"]), truth.tvec).errors(truth)
    assert rotation_error_deg <= max_error_deg
    assert (result["bearing"] is not None) == has_bearing
    if has_bearing:
        # Motion averaging assumes one pixel of noise; adjustment estimates the noise.
        assert result["bearing"]["stddev_deg"] <= 1
        baseline = truth.cam_in_world - scene.images[result["bearing"]["from"]].pose.cam_in_world
        error = np.linalg.norm(result["bearing"]["direction"] - baseline / np.linalg.norm(baseline))
        assert np.degrees(error) <= max_error_deg


def assert_right_or_lost(done, scene, statuses):
    for name in scene.query_names:
        if name not in done.poses:
            assert_lost(done, name, statuses)
            continue
        position_error, rotation_error_deg = done.poses[name].errors(scene.images[name].pose)
        assert position_error <= MAX_ERRORS[0] and rotation_error_deg <= MAX_ERRORS[1], name


def keep_pairs(scene, query_name, num_pairs):
    own = [names for names in scene.pairs if query_name in names]
    for names in own[num_pairs:]:
        del scene.pairs[names]


def keep_inliers(pair, keep):
    """Keeps only these inliers (an index of any kind), and makes them the raw matches too."""
    pair.inlier_matches = pair.inlier_matches[keep]
    pair.matches = pair.inlier_matches


def test_only_the_bad_query_is_lost(run, exact):
    """The second of three queries has no keypoints, pairs or verified inliers; the other two are still localized."""
    scene = exact.scene.copy()
    keep_pairs(scene, "query/001.jpg", 0)
    scene.images["query/001.jpg"].keypoints = np.zeros((0, 2), np.float32)
    done = run(scene)
    assert_lost(done, "query/001.jpg", {"NO_FEATURES"})
    assert sorted(done.poses) == ["query/000.jpg", "query/002.jpg"]
    assert_right_or_lost(done, scene, {"NO_FEATURES"})


def test_query_without_pairs(run, exact):
    scene = exact.scene.copy()
    keep_pairs(scene, "query/001.jpg", 0)
    assert_lost(run(scene), "query/001.jpg", {"NO_PAIRS"})


def test_model_of_images_that_the_database_does_not_know(localize, exact, tmp_path):
    scene = exact.scene.copy()
    for name in scene.database_names:
        scene.images[name].name = "other_" + name
    done = localize(
        "--database_path",
        exact.database_path,
        "--input_path",
        synthetic.write_model(tmp_path / "model", scene),
        "--query_list_path",
        write_lines(tmp_path / "list.txt", scene.query_names),
    )
    assert done.exit_code == 0
    assert set(done.statuses.values()) == {"NO_PAIRS"}


@pytest.mark.parametrize("geometry", ["pose", None])
def test_query_with_one_pair(run, exact, geometry):
    """Orientation and bearing are observable, the distance is not."""
    scene = exact.scene.copy()
    keep_pairs(scene, "query/001.jpg", 1)
    done = run(scene, geometry=geometry)
    assert_lost(done, "query/001.jpg", {"SCALE_UNOBSERVABLE"})
    assert "one database position" in done.results["query/001.jpg"]["reason"]
    assert_partial_pose(done, scene, "query/001.jpg")
    assert all(done.results[name]["rotation"] is None for name in done.poses)


def test_query_with_one_pair_before_a_plane(run):
    """Two orientations explain the matches equally well, unless points would lie behind a camera in one of them."""
    scene = synthetic.make_scene(synthetic.arc(1), [[0.2, 0.1, -4.5], [1.5, 0.4, -5]], is_planar=True)
    done = run(scene)
    for name in scene.query_names:
        assert_lost(done, name, {"SCALE_UNOBSERVABLE"})
    ambiguous = done.results["query/000.jpg"]
    assert "one plane" in ambiguous["reason"] and ambiguous["rotation"] is None and ambiguous["bearing"] is None
    assert_partial_pose(done, scene, "query/001.jpg")


def test_query_with_several_pairs_before_a_plane(run):
    scene = synthetic.make_scene(synthetic.arc(7), [[0.3, 1.2, -4]], is_planar=True)
    done = run(scene)
    assert len(done.poses) == 1, done.results["query/000.jpg"]["reason"]
    assert_right_or_lost(done, scene, set())


def test_query_with_two_pairs(run, exact):
    scene = exact.scene.copy()
    keep_pairs(scene, "query/001.jpg", 2)
    done = run(scene)
    assert_right_or_lost(done, scene, set())


@pytest.mark.parametrize("num_left", [3, 14])
@pytest.mark.parametrize("geometry", ["pose", None])
def test_query_with_too_few_inliers(run, exact, geometry, num_left):
    scene = exact.scene.copy()
    for names, pair in scene.pairs.items():
        if "query/001.jpg" in names:
            keep_inliers(pair, slice(num_left))
    assert_lost(run(scene, geometry=geometry), "query/001.jpg", {"TOO_FEW_INLIERS"})


def test_query_with_random_matches(localize, exact, tmp_path, write_scene_files):
    """RANSAC may fit a geometry to a few of them by chance, but nothing confirms it."""
    scene = exact.scene.copy()
    rng = np.random.default_rng(0)
    for names, pair in scene.pairs.items():
        if "query/001.jpg" in names:
            pair.matches = np.stack([rng.permutation(100)[:60], rng.permutation(100)[:60]], axis=1).astype(np.uint32)
    files = write_scene_files(tmp_path, scene, geometry=None)
    query_list = write_lines(tmp_path / "list.txt", ["query/001.jpg"])
    done = localize(*files.arguments, "--query_list_path", query_list)
    assert_lost(
        done, "query/001.jpg", {"TOO_FEW_INLIERS", "INCONSISTENT_ROTATIONS", "SCALE_UNOBSERVABLE", "TOO_FEW_TRACKS"}
    )


def test_query_whose_pairs_contradict_each_other(run, exact):
    scene = exact.scene.copy()
    rng = np.random.default_rng(0)
    for names, pair in scene.pairs.items():
        if "query/001.jpg" in names:
            pair.rotation = synthetic.Rotation.random(rng=rng)
    done = run(scene)
    assert_right_or_lost(done, scene, set())
    assert done.results["query/001.jpg"]["start"] == "absolute_pose", "right matches stand without the relative poses"


@pytest.mark.parametrize("geometry", ["pose", None])
def test_query_on_the_line_of_the_database_cameras(run, geometry):
    """The position along the line is given by points that two database images see."""
    scene = synthetic.make_scene(ROW, [[0.3, 0, -6], [3.1, 0, -6]])
    assert_right_or_lost(run(scene, geometry=geometry), scene, {"DEGENERATE_BASELINE"})


@pytest.mark.parametrize("geometry", ["pose", None])
def test_query_on_the_line_with_points_of_single_database_images_alone(run, geometry):
    """The position along the line is unobservable."""
    scene = synthetic.make_scene(ROW, [[0.3, 0, -6], [3.1, 0, -6]], num_points=700)
    synthetic.split_tracks(scene)
    done = run(scene, geometry=geometry)
    for name in scene.query_names:
        assert_lost(done, name, {"DEGENERATE_BASELINE"})
        assert "on one line" in done.results[name]["reason"]
        assert_partial_pose(done, scene, name)


def test_query_beside_the_line_of_the_database_cameras(run):
    scene = synthetic.make_scene(ROW, [[0.3, 1.2, -5], [3.1, -0.5, -4]])
    done = run(scene)
    assert len(done.poses) == 2
    assert_right_or_lost(done, scene, set())


def test_points_of_single_database_images_suffice_where_bearings_cross(run):
    scene = synthetic.make_scene(synthetic.arc(7), [[0.3, 1.2, -4]], num_points=900)
    synthetic.split_tracks(scene)
    done = run(scene)
    assert len(done.poses) == 1, done.results["query/000.jpg"]["reason"]
    assert_right_or_lost(done, scene, set())


@pytest.mark.parametrize("geometry", ["pose", None])
def test_pure_rotation_against_all_database_images(run, geometry):
    """All images, the query too, are taken from one place, as for a panorama: only the orientation is observable."""
    scene = synthetic.make_scene([[0, 0, -6]] * 5, [[0, 0, -6]])
    done = run(scene, geometry=geometry)
    assert_lost(done, "query/000.jpg", {"DEGENERATE_BASELINE"})
    assert "no baseline" in done.results["query/000.jpg"]["reason"]
    assert_partial_pose(done, scene, "query/000.jpg", has_bearing=False, max_error_deg=0.5)  # as COLMAP found it


@pytest.mark.parametrize("geometry", ["pose", None])
def test_database_images_of_one_place(run, geometry):
    """The bearing from that place is observable, the distance is not."""
    scene = synthetic.make_scene([[0, 0, -6]] * 5, [[1.5, 0, -5.5]])
    done = run(scene, geometry=geometry)
    assert_lost(done, "query/000.jpg", {"SCALE_UNOBSERVABLE"})
    assert_partial_pose(done, scene, "query/000.jpg", max_error_deg=0.1)


@pytest.mark.parametrize("geometry", ["pose", None])
def test_pure_rotation_against_one_of_the_database_images(run, geometry):
    """The pair without a baseline does not constrain the position, but the others do."""
    scene = synthetic.make_scene(synthetic.arc(7), [synthetic.arc(7)[2]])
    done = run(scene, geometry=geometry)
    assert len(done.poses) == 1, done.results["query/000.jpg"]["reason"]
    assert_right_or_lost(done, scene, set())


def test_strict_ends_with_exit_code_2_where_a_query_is_lost(localize, exact, tmp_path, write_scene_files):
    scene = exact.scene.copy()
    keep_pairs(scene, "query/001.jpg", 0)
    files = write_scene_files(tmp_path, scene)
    lost = localize(*files.arguments, "--strict", 1)
    assert lost.exit_code == 2
    assert sorted(lost.poses) == ["query/000.jpg", "query/002.jpg"] and len(lost.results) == 3
    assert localize(*files.arguments, "--strict", 0).exit_code == 0
    assert localize(*exact.arguments, "--strict", 1).exit_code == 0
