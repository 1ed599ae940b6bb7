"""Tests the accuracy of single images on real scenes with ground truth, by the protocol of their README."""

import numpy as np
import pytest

from benchmarks.uncertainty import depth_several
from benchmarks.uncertainty.depth_points import triangulated_depths
from benchmarks.uncertainty.localizer import position_error
from colmap_lazyloc.model import read_model
from conftest import DATA_PATH

# Largest median errors of position and rotation, in metres and degrees.
THRESHOLDS = {
    "fountain": (0.0034, 0.03),
    "herzjesu": (0.007, 0.03),
    "office": (0.0065, 0.27),
    "kitchen": (0.0165, 0.72),
    "kitti1": (0.0095, 0.05),
}

# Queries whose distance is nearly open: the two images of one stereo frame see this one, without the rig.
MAY_BE_OPEN = {"kitti1": {"right/000050.png"}}


def true_poses(scene):
    return {name: image.cam_from_world for name, image in read_model(DATA_PATH / scene / "model").images.items()}


def arguments_of(scene):
    folder = DATA_PATH / scene
    arguments = ["--database_path", folder / "database.db", "--input_path", folder / "model"]
    if (folder / "queries.txt").exists():
        arguments += ["--query_list_path", folder / "queries.txt"]
    return arguments if scene == "kitti1" else [*arguments, "--LazyLocalizer.leave_one_out", 1]


def evaluated_names(scene, truth):
    """Returns all queries; for kitti1 every second left image: left/000001.png, left/000004.png, ..."""
    queries = DATA_PATH / scene / "queries.txt"
    names = queries.read_text().split() if queries.exists() else sorted(truth)
    if scene == "kitti1":
        names = [name for name in names if name.startswith("left/") and int(name[-10:-4]) % 3 == 1]
    return names


@pytest.mark.parametrize("scene", THRESHOLDS)
def test_every_query_is_localized_with_small_median_errors(localize, scene):
    """Poses of any confidence count, because the default minimum refuses some right ones."""
    if not (DATA_PATH / scene / "database.db").exists():
        pytest.skip(f"{DATA_PATH / scene} is missing; LAZYLOC_SHARED_DATA names the folder of the real scenes")
    options = ("--LazyLocalizer.Advanced.use_rigs", 0, "--LazyLocalizer.min_confidence", 0)
    run = localize(*arguments_of(scene), *options)
    assert {name for name, status in run.statuses.items() if status != "LOCALIZED"} <= MAY_BE_OPEN.get(scene, set())
    truth = true_poses(scene)
    names = evaluated_names(scene, truth)
    errors = np.array([run.poses[name].errors(truth[name]) for name in names])
    median_position_error, median_rotation_error_deg = np.median(errors, axis=0)
    print(f"{scene}: {len(names)} queries, median {median_position_error:.5f} m, {median_rotation_error_deg:.4f} deg")
    assert len(names) == {"fountain": 11, "herzjesu": 25, "office": 19, "kitchen": 25, "kitti1": 17}[scene]
    assert median_position_error <= THRESHOLDS[scene][0]
    assert median_rotation_error_deg <= THRESHOLDS[scene][1]


def test_covariance_of_poses_by_one_image_and_depth_holds(localize, tmp_path):
    """The poses of kitchen are off by several pixels. With what is expected by default the median is 47, not 2.4."""
    database_path = DATA_PATH / "kitchen" / "database.db"
    if not database_path.exists():
        pytest.skip(f"{database_path} is missing; LAZYLOC_SHARED_DATA names the folder of the real scenes")
    model = read_model(DATA_PATH / "kitchen" / "model")
    maps = depth_several.write_real_maps(tmp_path / "maps", model, triangulated_depths(database_path, model), "5 %")
    options = ("--LazyLocalizer.num_retrieved", 1, "--depth_path", maps)
    run = localize(*arguments_of("kitchen"), *options)
    truth = true_poses("kitchen")
    squares = []
    for name, result in run.results.items():
        noise = result["database_pose_noise"]
        assert noise["source"] == "database_pairs" and noise["num_pairs"] >= 2, name
        if name in run.poses:
            centre = truth[name].cam_in_world
            squares.append(position_error(run.poses[name], result["covariance"], centre)[1] ** 2)
    assert len(squares) >= 20
    assert 1.2 <= np.median(squares) <= 6
