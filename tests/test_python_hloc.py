"""Tests of `colmap_lazyloc.hloc`, which takes the place of hloc.localize_sfm."""

import pickle
import subprocess
import sys

import h5py
import numpy as np
import pytest

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.hloc import localize_lazyloc
from colmap_lazyloc.poses import read_poses
from test_hloc_to_database import convert, hloc_files
from test_python_processes import ENVIRONMENT

__all__ = ["hloc_files"]  # a fixture


def arguments_of(folder):
    return {
        "reference_sfm": folder / "model",
        "queries": folder / "queries.txt",
        "retrieval": folder / "pairs.txt",
        "features": folder / "features.h5",
        "matches": folder / "matches.h5",
        "results": folder / "results.txt",
    }


def test_poses_have_the_bytes_of_the_program_on_the_same_matches(localize, hloc_files, noisy):
    folder, folder_name, queries = hloc_files
    assert convert(folder) == 0
    files = ["--query_list_path", folder / "queries.txt", "--pairs_path", folder / "pairs.txt"]
    run = localize("--database_path", folder / "out.db", "--input_path", folder / "model", *files)
    found = localize_lazyloc.main(**arguments_of(folder), prepend_camera_name=True)
    assert {name: result.status for name, result in found.items()} == run.statuses
    written = read_poses(folder / "results.txt")
    assert len(written) == len(queries) == len(run.poses)
    for name in queries:
        pose = run.poses[folder_name[name]]
        assert found[folder_name[name]].pose.bits() == pose.bits()
        short = "/".join(folder_name[name].split("/")[-2:])
        assert written[short].bits() == pose.bits()
        assert max(pose.errors(noisy.scene.images[name].pose)) < 0.1


def test_log_has_the_form_of_inloc(hloc_files):
    """Reads the log as hloc.visualization.visualize_loc_from_log does without a reconstruction."""
    folder, folder_name, queries = hloc_files
    found = localize_lazyloc.main(**arguments_of(folder))
    logs = pickle.loads((folder / "results.txt_logs.pkl").read_bytes())
    with h5py.File(folder / "features.h5") as features:
        for name in (folder_name[name] for name in queries):
            loc = logs["loc"][name]
            inliers = np.array(loc["PnP_ret"]["inlier_mask"])
            counts = np.array([np.sum(loc["indices_db"][inliers] == i) for i in range(len(loc["db"]))])
            assert counts.sum() == inliers.sum() == loc["PnP_ret"]["num_inliers"] == len(found[name].observations) > 100
            best = int(np.argmax(counts))
            own, other = (loc[key][loc["indices_db"] == best] for key in ("keypoints_query", "keypoints_db"))
            assert len(own) == len(other) > counts[best] > 10
            assert set(map(tuple, other)) <= set(
                map(tuple, features[loc["db"][best]]["keypoints"][:].astype(np.float32))
            )


def test_query_without_a_pose_has_no_line(hloc_files):
    folder, folder_name, queries = hloc_files
    pairs = (folder / "pairs.txt").read_text().splitlines(keepends=True)
    lost = folder_name[queries[0]]
    (folder / "pairs.txt").write_text("".join(line for line in pairs if lost not in line.split()))
    found = localize_lazyloc.main(**arguments_of(folder), config={"seed": 3})
    assert found[lost].status == "NO_PAIRS" and lost.split("/")[-1] not in read_poses(folder / "results.txt")
    assert pickle.loads((folder / "results.txt_logs.pkl").read_bytes())["loc"][lost]["num_matches"] == 0


@pytest.mark.parametrize(
    ("results", "message"),
    [("no_folder/results.txt", "cannot be written: its folder does not exist"), ("model", "is a folder; name a file")],
)
def test_output_is_checked_before_any_work(hloc_files, results, message):
    folder = hloc_files[0]
    files = arguments_of(folder) | {"results": folder / results, "features": folder / "not_read.h5"}
    with pytest.raises(InputError, match=f"{results}: {message}"):
        localize_lazyloc.main(**files)


@pytest.mark.parametrize(
    "change", [lambda name: name.partition("/")[2], lambda name: f"data/{name}", lambda name: f"{name}x"]
)
def test_unknown_names_in_pairs_are_shown_with_the_nearest(hloc_files, change):
    folder, _, _ = hloc_files
    pairs = [line.split()[:2] for line in (folder / "pairs.txt").read_text().splitlines()]
    (folder / "pairs.txt").write_text("".join(f"{change(first)} {change(second)}\n" for first, second in pairs))
    with pytest.raises(InputError) as error:
        localize_lazyloc.main(**arguments_of(folder))
    name, known = change(pairs[0][0]), pairs[0][0]
    ending = f"no pair of a query with an image of the model: {name} is neither; the nearest is {known}"
    assert str(error.value).endswith(ending)


def test_missing_matches_are_named(hloc_files):
    folder, _, _ = hloc_files
    with h5py.File(folder / "matches.h5", "a") as matches:
        for key in list(matches):
            del matches[key]
    with pytest.raises(InputError, match="has no matches of"):
        localize_lazyloc.main(**arguments_of(folder))


def test_flags_are_those_of_localize_sfm(hloc_files):
    folder, _, queries = hloc_files
    flags = [str(word) for name, value in arguments_of(folder).items() for word in (f"--{name}", value)]
    command = [sys.executable, "-m", "colmap_lazyloc.hloc", *flags, "--ransac_thresh", "8", "--covisibility_clustering"]
    done = subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT)
    assert done.returncode == 0 and done.stdout == f"{len(queries)} of {len(queries)} queries localized\n", done.stderr
    assert len(read_poses(folder / "results.txt")) == len(queries)
    command[command.index(str(folder / "model"))] = str(folder / "nowhere")
    done = subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT)
    assert done.returncode == 1 and "nowhere" in done.stderr and done.stderr.count("\n") == 1
