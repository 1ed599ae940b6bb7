"""Accuracy of single images on real scenes with ground truth, by the protocol of their README. Skipped where the data is missing."""

import os
import pathlib

import numpy as np
import pytest

from conftest import PROJECT_PATH
import synthetic_database as synthetic

DATA_PATH = pathlib.Path(os.environ.get("LAZYLOC_SHARED_DATA", PROJECT_PATH.parent / "shared" / "data"))

# Largest median errors of position and rotation, in metres and degrees.
THRESHOLDS = {
    "fountain": (0.0034, 0.03),
    "herzjesu": (0.0065, 0.03),
    "office": (0.0065, 0.27),
    "kitchen": (0.0165, 0.72),
    "kitti1": (0.0095, 0.05),
}


def read_poses(path):
    """Of a COLMAP images.txt whose images have no points: every other line is empty."""
    lines = [line.split() for line in path.read_text().splitlines() if line and not line.startswith("#")]
    return {words[9]: synthetic.Pose(np.array(words[1:5], float), np.array(words[5:8], float)) for words in lines}


def arguments_of(scene):
    folder = DATA_PATH / scene
    arguments = ["--database_path", folder / "database.db", "--input_path", folder / "model"]
    if (folder / "queries.txt").exists():
        arguments += ["--query_list_path", folder / "queries.txt"]
    return arguments if scene == "kitti1" else [*arguments, "--LazyLocalizer.leave_one_out", 1]


def evaluated_names(scene, truth):
    """All queries; of kitti1's, every second left one: left/000001.png, left/000004.png, ..."""
    queries = DATA_PATH / scene / "queries.txt"
    names = queries.read_text().split() if queries.exists() else sorted(truth)
    if scene == "kitti1":
        names = [name for name in names if name.startswith("left/") and int(name[-10:-4]) % 3 == 1]
    return names


@pytest.mark.parametrize("scene", THRESHOLDS)
def test_every_query_is_localized_with_small_median_errors(localize, scene):
    if not (DATA_PATH / scene / "database.db").exists():
        pytest.skip(f"{DATA_PATH / scene} is missing; LAZYLOC_SHARED_DATA names the folder of the real scenes")
    run = localize(*arguments_of(scene), "--LazyLocalizer.Advanced.use_rigs", 0, "--strict", 1)
    assert run.exit_code == 0, run.statuses
    truth = read_poses(DATA_PATH / scene / "model" / "images.txt")
    names = evaluated_names(scene, truth)
    errors = np.array([run.poses[name].errors(truth[name]) for name in names])
    median_position_error, median_rotation_error_deg = np.median(errors, axis=0)
    print(f"{scene}: {len(names)} queries, median {median_position_error:.5f} m, {median_rotation_error_deg:.4f} deg")
    assert len(names) == {"fountain": 11, "herzjesu": 25, "office": 19, "kitchen": 25, "kitti1": 17}[scene]
    assert median_position_error <= THRESHOLDS[scene][0]
    assert median_rotation_error_deg <= THRESHOLDS[scene][1]
