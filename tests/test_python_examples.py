"""Tests that the examples of the Python package run."""

import json
import os
import pathlib
import subprocess
import sys

import numpy as np

from colmap_lazyloc.extension import core
from colmap_lazyloc.poses import Pose
from conftest import PROJECT_PATH
from test_hloc_to_database import hloc_files
from test_python_localizer import relative_poses
from test_python_processes import ENVIRONMENT

__all__ = ["hloc_files"]  # a fixture

EXAMPLES_PATH = PROJECT_PATH / "examples" / "python"


def run_example(name, *arguments):
    return subprocess.run(
        [sys.executable, str(EXAMPLES_PATH / name), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=300,
        env=ENVIRONMENT,
    )


def test_photo(photos):
    name = photos.query_names[0]
    done = run_example("localize_photo.py", photos.database_path, photos.model_path, photos.image_path / name)
    assert done.returncode == 0, done.stderr
    position = np.array(done.stdout.split()[1:], float)
    assert np.linalg.norm(position - photos.poses[name].cam_in_world) < 0.05
    done = run_example("localize_photo.py", photos.database_path, photos.model_path, "missing.jpg")
    assert done.returncode == 1 and done.stderr.startswith("UNREADABLE_IMAGE: ")


def test_matches(exact, tmp_path):
    scene = exact.scene
    name = scene.query_names[0]
    arrays = {"camera": [520, 520, 320, 240, 640, 480]}
    points = {key: scene.images[key].point_of_keypoint for key in [name, *scene.database_names]}

    def pixels(image):
        """Returns exact pixels of the example's camera, because the scene has others."""
        in_cam = image.pose(all_points(scene)[image.point_of_keypoint])
        return in_cam[:, :2] / in_cam[:, 2:] * 520 + [320, 240]

    arrays["keypoints"] = pixels(scene.images[name])
    for other in scene.database_names:
        image = scene.images[other]
        _, query_index, other_index = np.intersect1d(points[name], points[other], return_indices=True)
        arrays[f"{other}/keypoints"] = pixels(image)
        arrays[f"{other}/matches"] = np.stack([query_index, other_index], axis=1)
        arrays[f"{other}/cam_from_world"] = np.column_stack([image.pose.rotation, image.pose.tvec])
    np.savez(tmp_path / "matches.npz", **arrays)
    done = run_example("localize_matches.py", tmp_path / "matches.npz")
    assert done.returncode == 0 and done.stdout.startswith("LOCALIZED"), (done.stdout, done.stderr)


def all_points(scene):
    """Returns points in the view of the cameras; any do, because pixels are computed from them."""
    num_points = 1 + max(int(image.point_of_keypoint.max()) for image in scene.images.values())
    return np.random.default_rng(0).uniform(-1, 1, (num_points, 3))


def read_statuses(done):
    assert done.returncode == 0, done.stderr
    return {line.split()[0]: line.split()[1] for line in done.stdout.splitlines()}


def printed_poses(done):
    """Returns the poses that the examples of groups print: name, status, quaternion, translation."""
    return {
        words[0]: Pose(np.array(words[2:6], float), np.array(words[6:], float))
        for words in map(str.split, done.stdout.splitlines())
    }


def test_rig(photos, tmp_path):
    """Takes two photos as a rig, because only their poses relative to each other matter."""
    names = photos.query_names[:2]
    origin = photos.poses[names[0]]
    rig = {}
    for name in names:
        rotation = photos.poses[name].rotation @ origin.rotation.T
        translation = photos.poses[name].tvec - rotation @ origin.tvec
        rig[name] = np.column_stack([rotation, translation]).tolist()
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).symlink_to(photos.image_path / name)
    (tmp_path / "rig.json").write_text(json.dumps(rig))
    done = run_example("localize_rig.py", photos.database_path, photos.model_path, tmp_path / "rig.json")
    assert read_statuses(done) == dict.fromkeys(names, "LOCALIZED")
    for name, pose in printed_poses(done).items():
        assert max(pose.errors(photos.poses[name])) < 0.2


def test_trajectory(exact, tmp_path):
    names = exact.scene.query_names
    poses = relative_poses(exact.scene, names)
    lines = [f"{name} {Pose.from_matrix(rotation, 3 * tvec).text()}" for name, (rotation, tvec) in poses.items()]
    (tmp_path / "odometry.txt").write_text("\n".join(lines))
    done = run_example("localize_trajectory.py", exact.database_path, exact.model_path, tmp_path / "odometry.txt")
    assert read_statuses(done) == dict.fromkeys(names, "LOCALIZED")
    for name, pose in printed_poses(done).items():
        assert max(pose.errors(exact.scene.images[name].pose)) < 1e-4


def test_hloc_files(hloc_files):
    folder, folder_name, queries = hloc_files
    files = ["model", "queries.txt", "pairs.txt", "features.h5", "matches.h5"]
    pairs = [line.split() for line in (folder / "pairs.txt").read_text().splitlines()]
    ordered = [pair if pair[0].startswith("q/") else pair[::-1] for pair in pairs]
    (folder / "pairs.txt").write_text("".join(f"{query} {other}\n" for query, other in ordered))
    done = run_example("localize_hloc.py", *(folder / name for name in files))
    assert read_statuses(done) == {folder_name[name]: "LOCALIZED" for name in queries}


def test_results_with_pandas(localize, noisy):
    run = localize(*noisy.arguments)
    done = run_example("read_results.py", run.output_path / "results.jsonl")
    assert done.returncode == 0 and done.stderr == "", done.stderr
    assert f"LOCALIZED    {len(run.poses)}" in done.stdout
    assert all(name in done.stdout for name in run.poses) and "position_stddev" in done.stdout


def test_examples_and_package_have_correct_types(tmp_path):
    package = PROJECT_PATH / "python" / "colmap_lazyloc"
    files = [*EXAMPLES_PATH.glob("*.py"), package]
    config = ["--config-file", PROJECT_PATH / "pyproject.toml", "--cache-dir", tmp_path]
    command = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", *config, *files]
    done = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, env={**ENVIRONMENT, "MYPYPATH": str(package.parent)}
    )
    assert done.returncode == 0, done.stdout


def test_stub_is_that_of_the_module(tmp_path):
    """Make it again by scripts/python.sh -m nanobind.stubgen -i build/python -m _core -O python/colmap_lazyloc."""
    folder = pathlib.Path(core.__file__).parent
    command = [sys.executable, "-m", "nanobind.stubgen", "-q", "-i", folder, "-m", "_core", "-O", tmp_path]
    subprocess.run(list(map(str, command)), check=True, env=ENVIRONMENT)
    expected = (tmp_path / "_core.pyi").read_text()
    assert (PROJECT_PATH / "python" / "colmap_lazyloc" / "_core.pyi").read_text() == expected


def test_reference_is_that_of_the_docstrings():
    done = subprocess.run(
        [sys.executable, "-c", "import make_python_reference as m; assert m.make_page() == m.PAGE_PATH.read_text()"],
        env={**ENVIRONMENT, "PYTHONPATH": f"{ENVIRONMENT['PYTHONPATH']}{os.pathsep}{PROJECT_PATH / 'scripts'}"},
    )
    assert done.returncode == 0, "run scripts/python.sh scripts/make_python_reference.py"
