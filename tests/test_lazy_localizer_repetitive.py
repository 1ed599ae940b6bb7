"""Tests a facade of identical windows: many matches are one window too far to the side, and agree with the epipolar
geometry nearly as well as the correct ones."""

import json

import numpy as np
import pytest

from colmap_lazyloc.result import Result
from colmap_lazyloc.testing import synthetic

PERIOD = 2.0  # from window to window, along x
NUM_WINDOWS, NUM_POINTS_A_WINDOW, NUM_SINGLE_POINTS = 20, 60, 360


def make_facade(wrong_window_ratio, wrong_pair_ratio=0.0, noise_px=0.7, outlier_ratio=0.3, seed=0):
    """Makes images taken from a street 8 units in front of the facade.

    wrong_window_ratio: share of the matches of window points that lead to the next window on either side.
    wrong_pair_ratio: share of the pairs in which three quarters do so, all on the same side.
    outlier_ratio: number of additional random matches over the number of these matches.
    """
    rng = np.random.default_rng(seed)
    window = rng.uniform([0, -3, 0], [PERIOD, 3, 0.3], (NUM_POINTS_A_WINDOW, 3))
    shifts = (np.arange(NUM_WINDOWS) - NUM_WINDOWS / 2)[:, None, None] * [PERIOD, 0, 0]
    points = np.concatenate(
        [(shifts + window).reshape(-1, 3), rng.uniform([-20, -3, -1.5], [20, 3, 0.3], (NUM_SINGLE_POINTS, 3))]
    )
    scene = synthetic.Scene({1: synthetic.Camera(1, "PINHOLE", 1024, 768, [800, 800, 512, 384])}, {}, {}, [])
    database = [(f"database/{i:03d}.jpg", x, 0.5) for i, x in enumerate(np.linspace(-8, 8, 16))]
    queries = [(f"query/{i:03d}.jpg", x, 2.0) for i, x in enumerate(rng.uniform(-7, 7, 6))]
    for name, x, spread in database + queries:
        centre = np.array([x, rng.uniform(-0.2, 0.2), rng.uniform(-spread, spread) - 8])
        pose = synthetic.looking_at(centre, [x + rng.uniform(-2, 2), rng.uniform(-0.5, 0.5), 0])
        observed = synthetic.observe(scene.cameras[1], pose, points, noise_px, 0.5, rng)
        scene.images[name] = synthetic.Image(name, len(scene.images) + 1, 1, pose, *observed)
    scene.query_names.extend(name for name, *_ in queries)
    for name1, *_ in database:
        for name2, *_ in queries:
            shift = rng.choice([-1, 1]) if rng.random() < wrong_pair_ratio else 0
            chances = (0.75, [shift]) if shift else (wrong_window_ratio, [-1, 1])
            matches = match_windows(scene.images[name1], scene.images[name2], *chances, rng)
            num_outliers = int(outlier_ratio * len(matches))
            outliers = [rng.integers(len(scene.images[name].keypoints), size=num_outliers) for name in (name1, name2)]
            matches = np.concatenate([matches, np.stack(outliers, axis=1)]).astype(np.uint32)
            scene.pairs[name1, name2] = synthetic.Pair(matches, matches, synthetic.Rotation.identity(), np.zeros(3))
    return scene


def match_windows(image1, image2, wrong_ratio, shifts, rng):
    keypoint1 = {int(point): i for i, point in enumerate(image1.point_of_keypoint) if point >= 0}
    matches = []
    for keypoint2, point in enumerate(image2.point_of_keypoint):
        if point < 0:
            continue
        if point < NUM_WINDOWS * NUM_POINTS_A_WINDOW and rng.random() < wrong_ratio:
            point += NUM_POINTS_A_WINDOW * rng.choice(shifts)
        if point in keypoint1 and rng.random() < 0.6:
            matches.append((keypoint1[point], keypoint2))
    return np.array(matches).reshape(-1, 2)


@pytest.mark.parametrize("wrong_window_ratio, wrong_pair_ratio", [(0.0, 0.0), (0.3, 0.0), (0.5, 0.0), (0.3, 0.3)])
def test_every_query_is_localized(localize, tmp_path, write_scene_files, wrong_window_ratio, wrong_pair_ratio):
    scene = make_facade(wrong_window_ratio, wrong_pair_ratio)
    # Accepts less than by default, because the confidence in a pose before a facade that repeats is low.
    arguments = write_scene_files(tmp_path, scene, geometry=None).arguments
    run = localize(*arguments, "--LazyLocalizer.min_confidence", "0.5")
    assert sorted(run.poses) == scene.query_names, run.statuses
    errors = [pose.errors(scene.images[name].pose) for name, pose in run.poses.items()]
    # The bounds are in units of which a window's width has 2; with noise alone the median is 0.01.
    assert np.median([position_error for position_error, _ in errors]) <= 0.03
    assert max(position_error for position_error, _ in errors) <= 0.2


def test_runner_up_is_one_window_to_the_side(localize, tmp_path, write_scene_files):
    scene = make_facade(0.0, wrong_pair_ratio=0.4)
    run = localize(*write_scene_files(tmp_path, scene, geometry=None).arguments, "--LazyLocalizer.min_confidence", 0)
    competing = {name: r for name, r in run.results.items() if r["evidence"]["competing_ratio"] > 0.5}
    assert competing
    for name, result in competing.items():
        no_points = np.empty((0, 3))
        runner_up = Result(name, json.dumps(result), no_points, no_points, np.empty(0), no_points).runner_up
        assert "agree on this one" in runner_up.explanation
        assert 0.03 < runner_up.odds < 1
        np.testing.assert_allclose(runner_up.pose.cam_in_world, result["runner_up"]["position"])
        offset = runner_up.pose.cam_in_world - result["position"]
        truth = scene.images[name].pose.cam_in_world
        assert min(np.linalg.norm(truth - place) for place in (runner_up.pose.cam_in_world, result["position"])) < 0.5
        # A quarter of the window, because the pose is not refined.
        np.testing.assert_allclose([abs(offset[0]), *offset[1:]], [PERIOD, 0, 0], atol=0.5)
