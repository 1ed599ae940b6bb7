"""Positions and gravity of queries: they fix what images do not determine, and never override them silently."""

import numpy as np
import pytest

from colmap_lazyloc.testing import synthetic
from conftest import write_lines

PLACE = np.array([[0, 0, -6.0]])
ROW = np.stack([np.linspace(-2, 2, 7), np.zeros(7), np.full(7, -6.0)], axis=1)  # database centres on a line
NOISE_PX = 0.5
UP = "0,-1,0"
# States that database poses and intrinsics are exact, as they are, because covariances allow for errors of both.
EXACT = [
    "--LazyLocalizer.Advanced.database_pose_stddev_deg",
    0,
    "--LazyLocalizer.Advanced.database_pose_stddev_length",
    0,
    "--LazyLocalizer.Advanced.focal_length_stddev_ratio",
    0,
]


@pytest.fixture
def run(localize, tmp_path_factory, write_scene_files):
    def run_scene(scene, positions=None, gravity=None, *arguments):
        """positions: by query, with the standard deviation last; gravity: likewise."""
        folder = tmp_path_factory.mktemp("scene")
        files = write_scene_files(folder, scene)
        options = list(arguments)
        for name, priors in (("position", positions), ("gravity", gravity)):
            if priors is None:
                continue
            lines = [f"{query} {' '.join(map(repr, map(float, prior)))}" for query, prior in priors.items()]
            options += [f"--query_{name}_path", write_lines(folder / f"{name}.txt", lines)]
        if gravity is not None:
            options += ["--LazyLocalizer.world_up", UP]
        done = localize(*files.arguments, *options)
        assert done.exit_code == 0, done.stderr
        return done

    return run_scene


def with_one_pair(scene):
    first = scene.database_names[0]
    scene.pairs = {names: pair for names, pair in scene.pairs.items() if first in names}
    return scene


def positions_of(scene, stddev, rng, factor=1.0):
    """Returns positions that are off as their standard deviation says, times the factor."""
    return {
        name: [*(scene.images[name].pose.cam_in_world + factor * stddev * rng.standard_normal(3)), stddev]
        for name in scene.query_names
    }


def normalized_error(done, scene, name):
    """Returns the squared position error over its covariance; chi-square with three degrees of freedom."""
    pose, covariance = done.poses[name], np.array(done.results[name]["covariance"])
    x, y, z = pose.tvec
    hat = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    jacobian = -pose.rotation.T @ np.hstack([hat, np.eye(3)])
    error = pose.cam_in_world - scene.images[name].pose.cam_in_world
    return error @ np.linalg.solve(jacobian @ covariance @ jacobian.T, error)


def assert_poses(done, scene, fixes):
    assert sorted(done.poses) == scene.query_names, [(r["status"], r["reason"]) for r in done.results.values()]
    priors = [done.results[name]["priors"]["position"] for name in scene.query_names]
    assert {(prior["verdict"], prior["fixes"]) for prior in priors} == {("used", fixes)}
    median = np.median([normalized_error(done, scene, name) for name in scene.query_names])
    assert 0.8 <= median <= 6, median


@pytest.mark.parametrize("stddev", [0.1, 1.0])
def test_position_fixes_the_distance_from_one_image(run, stddev):
    rng = np.random.default_rng(1)
    queries = synthetic.arc(15, phase=0.1) + 0.5 * rng.standard_normal((15, 3))
    # Leaves out a baseline so short that two orientations explain the matches.
    queries = queries[np.linalg.norm(queries - synthetic.arc(7)[0], axis=1) > 0.4]
    scene = with_one_pair(synthetic.make_scene(synthetic.arc(7), queries, noise_px=NOISE_PX, seed=1))
    assert_poses(run(scene, positions_of(scene, stddev, rng), None, *EXACT), scene, "distance")


def test_position_fixes_the_place_on_a_line(run):
    rng = np.random.default_rng(2)
    queries = np.stack([rng.uniform(-2, 2, 12), np.zeros(12), np.full(12, -6.0)], axis=1)
    scene = synthetic.make_scene(ROW, queries, noise_px=NOISE_PX, seed=1, num_points=900)
    synthetic.split_tracks(scene)
    assert_poses(run(scene, positions_of(scene, 0.3, rng), None, *EXACT), scene, "distance")


def test_position_fixes_a_panorama(run):
    rng = np.random.default_rng(3)
    places = np.repeat(PLACE, 12, axis=0)
    scene = synthetic.make_scene(np.repeat(PLACE, 5, axis=0), places, noise_px=NOISE_PX, seed=1)
    done = run(scene, positions_of(scene, 0.3, rng), None, *EXACT)
    assert_poses(done, scene, "position")
    for name in scene.query_names:
        _, error_deg = done.poses[name].errors(scene.images[name].pose)
        assert error_deg <= 4 * done.results[name]["rotation_stddev_deg"]


def test_position_fixes_the_distance_from_one_place(run):
    rng = np.random.default_rng(5)
    queries = PLACE + [1.5, 0, 0] + 0.3 * rng.standard_normal((12, 3))
    scene = synthetic.make_scene(np.repeat(PLACE, 5, axis=0), queries, noise_px=NOISE_PX, seed=1)
    assert_poses(run(scene, positions_of(scene, 0.3, rng), None, *EXACT), scene, "distance")


def test_position_makes_a_determined_pose_more_certain(run, noisy):
    scene = noisy.scene
    positions = {name: [*scene.images[name].pose.cam_in_world, 1e-3] for name in scene.query_names}
    without, done = run(scene), run(scene, positions)
    for name in scene.query_names:
        assert done.results[name]["priors"]["position"]["fixes"] == "nothing"
        assert done.results[name]["position_stddevs"][0] < without.results[name]["position_stddevs"][0]
    assert all("priors" not in result for result in without.results.values())


def test_wrong_priors_leave_the_poses_alone(run):
    """Positions are off by ten of their standard deviations, directions of gravity by ten degrees of one."""
    rng = np.random.default_rng(4)
    scene = synthetic.make_scene(synthetic.arc(7), synthetic.arc(4, phase=0.1), noise_px=NOISE_PX, seed=1)
    positions, gravity = {}, {}
    for name in scene.query_names:
        pose, offset = scene.images[name].pose, rng.standard_normal(3)
        positions[name] = [*(pose.cam_in_world + 10 * 0.1 * offset / np.linalg.norm(offset)), 0.1]
        down = pose.rotation @ [0, 1, 0]
        across = np.cross(down, rng.standard_normal(3))
        gravity[name] = [*(down + np.tan(np.radians(10)) * across / np.linalg.norm(across)), 1]
    without, done = run(scene), run(scene, positions, gravity)
    for name in scene.query_names:
        assert done.results[name]["cam_from_world"] == without.results[name]["cam_from_world"]
        assert done.results[name]["covariance"] == without.results[name]["covariance"]
        for prior, size in (("position", 1.0), ("gravity", 10)):
            verdict = done.results[name]["priors"][prior]
            assert verdict["verdict"] == "contradicted"
            assert verdict["deviation"] == pytest.approx(size, rel=0.1)
            assert verdict["deviation_sigma"] == pytest.approx(10, rel=0.1)


def test_position_off_the_ray_is_contradicted(run):
    scene = with_one_pair(synthetic.make_scene(synthetic.arc(7), [[1.5, 0.4, -5]], noise_px=NOISE_PX, seed=1))
    name, database = scene.query_names[0], scene.images[scene.database_names[0]].pose.cam_in_world
    centre = scene.images[name].pose.cam_in_world
    across = np.cross(centre - database, [0, 1, 0])
    for wrong in (centre + 2 * across / np.linalg.norm(across), database - 2 * (centre - database)):
        result = run(scene, {name: [*wrong, 0.1]}).results[name]
        assert result["status"] == "SCALE_UNOBSERVABLE", result["reason"]
        assert result["priors"]["position"]["verdict"] == "contradicted"
        assert result["cam_from_world"] is None and result["bearing"] is not None


def test_gravity_is_used(run, noisy):
    scene = noisy.scene
    gravity = {name: [*(scene.images[name].pose.rotation @ [0, 1, 0]), 1e-2] for name in scene.query_names}
    without, done = run(scene), run(scene, gravity=gravity)
    for name in scene.query_names:
        prior = done.results[name]["priors"]["gravity"]
        assert prior["verdict"] == "used" and prior["deviation"] < 1
        assert done.results[name]["rotation_stddev_deg"] <= without.results[name]["rotation_stddev_deg"]


def test_priors_of_a_lost_query_are_not_tested(run, exact):
    scene = exact.scene.copy()
    name = scene.query_names[0]
    scene.images[name].keypoints = np.zeros((0, 2), np.float32)
    scene.pairs = {names: pair for names, pair in scene.pairs.items() if name not in names}
    result = run(scene, {name: [0, 0, 0, 1]}).results[name]
    assert result["priors"] == {
        "position": {"verdict": "not_tested", "fixes": "nothing", "deviation": None, "deviation_sigma": None},
        "gravity": None,
    }


@pytest.mark.parametrize(
    "lines, line, words",
    [
        (None, None, "cannot be opened"),
        ([], None, "contains no query"),
        (["query/000.jpg 1 2 3"], 1, "expected `name x y z` and one or three"),
        (["query/000.jpg 1 2 nan 1"], 1, "not finite"),
        (["query/000.jpg 1 2 3 -1"], 1, "not positive"),
        (["query/000.jpg 1 2 3 1 2 0 1 0 1"], 1, "not positive definite"),
        (["query/000.jpg 1 2 3 1", "query/000.jpg 1 2 3 1"], 2, "listed twice"),
        (["# c", "database/000.jpg 1 2 3 1"], 2, "is not the name of a query"),
    ],
)
def test_bad_positions_end_the_run(localize, exact, tmp_path, lines, line, words):
    path = tmp_path / "positions.txt"
    if lines is not None:
        write_lines(path, lines)
    done = localize(*exact.arguments, "--query_position_path", path)
    assert done.exit_code == 1 and not done.output_path.exists()
    place = f"{path}:" if line is None else f"{path}:{line}:"
    assert place in done.stderr and words in done.stderr and len(done.stderr.strip().splitlines()) == 1


def test_gravity_needs_the_direction_of_the_world(localize, exact, tmp_path):
    path = write_lines(tmp_path / "gravity.txt", ["query/000.jpg 0 1 0 1"])
    done = localize(*exact.arguments, "--query_gravity_path", path)
    assert done.exit_code == 1 and "--LazyLocalizer.world_up" in done.stderr
