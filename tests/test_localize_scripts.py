"""Tests of the shell scripts that localize from photos, or from a user's own matches."""

import shutil
import subprocess

import pytest

import photo_scene
from colmap_lazyloc.poses import read_poses
from colmap_lazyloc.testing import synthetic
from conftest import SCRIPTS_PATH


@pytest.fixture
def run_script(colmap):
    def run(name, *arguments):
        return subprocess.run(
            [SCRIPTS_PATH / name, *map(str, arguments)],
            capture_output=True,
            text=True,
            timeout=300,
            env={"COLMAP": str(colmap), "PATH": "/usr/bin:/bin"},
        )

    return run


def test_folder_of_photos(photos, run_script, tmp_path):
    folder = tmp_path / "my photos"
    (folder / "query").mkdir(parents=True)
    for name in photos.query_names:
        shutil.copy(photos.image_path / name, folder / name)
    (folder / "notes.txt").write_text("no photo")
    model, _, _, *params = photos.camera_words.split()
    done = run_script(
        "localize_images.sh",
        photos.database_path,
        photos.model_path,
        folder,
        tmp_path / "localized",
        "--ImageReader.camera_model",
        model,
        "--ImageReader.camera_params",
        ",".join(params),
        *photo_scene.SIFT,
    )
    assert done.returncode == 0, done.stderr
    poses = read_poses(tmp_path / "localized" / "poses.txt")
    assert sorted(poses) == photos.query_names
    for name, pose in poses.items():
        assert pose.errors(photos.poses[name])[0] < 0.05
    assert sorted(path.name for path in tmp_path.iterdir()) == ["localized", "localized.index", "my photos"]


def test_own_matches(colmap, noisy, run_script, tmp_path):
    scene = noisy.scene.copy()
    text = "".join(
        f"{name1} {name2}\n" + "".join(f"{a} {b}\n" for a, b in pair.matches.tolist()) + "\n"
        for (name1, name2), pair in scene.pairs.items()
        if (name1 in scene.database_names) != (name2 in scene.database_names)
    )
    (tmp_path / "matches.txt").write_text(text)
    scene.pairs = {}
    database = synthetic.write_built_colmap_database(tmp_path / "keypoints.db", scene, colmap)
    before = database.read_bytes()
    done = run_script(
        "localize_matches.sh", database, tmp_path / "matches.txt", noisy.model_path, tmp_path / "localized"
    )
    assert done.returncode == 0, done.stderr
    assert database.read_bytes() == before
    poses = read_poses(tmp_path / "localized" / "poses.txt")
    assert sorted(poses) == sorted(name for name in scene.images if name not in scene.database_names)
    for name, pose in poses.items():
        assert pose.errors(scene.images[name].pose)[0] < 0.05


@pytest.mark.parametrize("name", ["localize_images.sh", "localize_matches.sh", "localize_hloc.sh"])
def test_usage(run_script, name):
    done = run_script(name, "one")
    assert done.returncode == 1 and f"scripts/{name} " in done.stderr


def test_folder_without_photos(photos, run_script, tmp_path):
    done = run_script("localize_images.sh", photos.database_path, photos.model_path, tmp_path, tmp_path / "localized")
    assert done.returncode == 1 and str(tmp_path) in done.stderr and done.stderr.count("\n") == 1
