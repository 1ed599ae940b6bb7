"""hloc's HDF5 files become a database with the same keypoints and matches, and the same poses."""

import shutil
import sqlite3
import subprocess
import sys

import h5py
import numpy as np
import pytest

import photo_scene
from colmap_lazyloc import hloc_to_database
from colmap_lazyloc.database import DatabaseReader, pair_id
from colmap_lazyloc.poses import read_poses
from colmap_lazyloc.testing import synthetic
from conftest import SCRIPTS_PATH


@pytest.fixture
def hloc_files(tmp_path, noisy):
    """Writes the scene in hloc's form: keypoints half a pixel less, names in folders, pairs in either order, named as
    older and newer versions of hloc do."""
    scene = noisy.scene
    folder_name = {
        name: f"{'db' if image.pose is not None and name in scene.database_names else 'q'}/{name}"
        for name, image in scene.images.items()
    }
    with h5py.File(tmp_path / "features.h5", "w") as features:
        for name, image in scene.images.items():
            features[f"{folder_name[name]}/keypoints"] = image.keypoints[:, :2].astype(float) - 0.5
    pairs = [names for names in scene.pairs if (names[0] in scene.database_names) != (names[1] in scene.database_names)]
    with h5py.File(tmp_path / "matches.h5", "w") as matches:
        for index, (name1, name2) in enumerate(pairs):
            first, second = (name1, name2) if index % 2 else (name2, name1)
            columns = (0, 1) if index % 2 else (1, 0)
            matched_points = np.full(len(scene.images[first].keypoints), -1, np.int32)
            for point1, point2 in scene.pairs[name1, name2].matches[:, columns]:
                matched_points[point1] = point2
            key = "/_"[index % 3 == 0].join(folder_name[name].replace("/", "-") for name in (first, second))
            matches[f"{key}/matches0"] = matched_points
    (tmp_path / "pairs.txt").write_text("".join(f"{folder_name[a]} {folder_name[b]}\n" for a, b in pairs))
    queries = [name for name in scene.images if name not in scene.database_names]
    intrinsics = {name: scene.cameras[scene.images[name].camera_id].intrinsics() for name in queries}
    lines = [f"{folder_name[name]} {intrinsics[name].text()}\n" for name in queries]
    (tmp_path / "queries.txt").write_text("".join(lines))
    (tmp_path / "model").mkdir()
    synthetic.write_model(tmp_path / "model", scene, binary=False)
    images = tmp_path / "model" / "images.txt"
    text = images.read_text()
    for name in scene.database_names:
        text = text.replace(f" {name}\n", f" {folder_name[name]}\n")
    images.write_text(text)
    return tmp_path, folder_name, queries


def convert(folder):
    return hloc_to_database.main(
        [
            "--features_path",
            f"{folder}/features.h5",
            "--matches_path",
            f"{folder}/matches.h5",
            "--pairs_path",
            f"{folder}/pairs.txt",
            "--model_path",
            f"{folder}/model",
            "--query_list_path",
            f"{folder}/queries.txt",
            "--database_path",
            f"{folder}/out.db",
        ]
    )


def test_database_holds_what_the_files_hold(hloc_files, noisy):
    folder, folder_name, _ = hloc_files
    assert convert(folder) == 0
    scene = noisy.scene
    with DatabaseReader(folder / "out.db") as reader, sqlite3.connect(folder / "out.db") as connection:
        ids = reader.image_ids
        assert sorted(ids) == sorted(folder_name.values())
        for name, image in scene.images.items():
            np.testing.assert_allclose(reader.keypoints(folder_name[name]), image.keypoints[:, :2], atol=1e-4)
        for (name1, name2), pair in scene.pairs.items():
            id1, id2 = ids[folder_name[name1]], ids[folder_name[name2]]
            stored = connection.execute("SELECT data FROM matches WHERE pair_id = ?", (pair_id(id1, id2),)).fetchone()
            if stored is None:
                assert (name1 in scene.database_names) == (name2 in scene.database_names)
                continue
            indices = np.frombuffer(stored[0], np.uint32).reshape(-1, 2)[:, :: 1 if id1 < id2 else -1]
            expected = dict(map(tuple, pair.matches))
            assert {(a, b) for a, b in indices.tolist()} <= set(map(tuple, pair.matches.tolist()))
            assert len(indices) >= 0.9 * len(expected)  # hloc's form holds one match per keypoint


def assert_script_localizes(folder, colmap, truth):
    """Checks the script's poses against the true ones, by name; the bounds suit a scene of a few metres."""
    done = subprocess.run(
        [
            SCRIPTS_PATH / "localize_hloc.sh",
            folder / "features.h5",
            folder / "matches.h5",
            folder / "pairs.txt",
            folder / "model",
            folder / "queries.txt",
            folder / "localized",
        ],
        env={"COLMAP": str(colmap), "PYTHON": sys.executable, "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    poses = read_poses(folder / "localized" / "poses.txt")
    assert sorted(poses) == sorted(truth)
    for name, pose in poses.items():
        position_error, rotation_error_deg = pose.errors(truth[name])
        assert position_error < 0.05 and rotation_error_deg < 0.3, name


def test_script_localizes_from_hloc_files(hloc_files, noisy, colmap):
    folder, folder_name, queries = hloc_files
    assert_script_localizes(folder, colmap, {folder_name[name]: noisy.scene.images[name].pose for name in queries})


def write_hloc_features(path, connection):
    """Writes features as hloc's extract_features does: a group per image, descriptors in columns."""
    with h5py.File(path, "w") as file:
        for name, rows, cols, keypoints, descriptors in connection.execute(
            "SELECT name, k.rows, k.cols, k.data, d.data FROM images JOIN keypoints k USING (image_id) "
            "JOIN descriptors d USING (image_id)"
        ):
            group = file.create_group(name)
            group["keypoints"] = np.frombuffer(keypoints, np.float32).reshape(rows, cols)[:, :2] - np.float32(0.5)
            group["keypoints"].attrs["uncertainty"] = 1.0
            group["descriptors"] = np.frombuffer(descriptors, np.uint8).reshape(rows, 128).T.astype(np.float16)
            group["scores"] = np.ones(rows, np.float16)
            group["image_size"] = np.array([photo_scene.CAMERA.width, photo_scene.CAMERA.height])


def write_hloc_matches(path, connection, pairs):
    """Writes matches as hloc's match_features does: for each keypoint of image 1 the index of its match in image 2."""
    ids = dict(connection.execute("SELECT name, image_id FROM images"))
    num_keypoints = dict(connection.execute("SELECT image_id, rows FROM keypoints"))
    with h5py.File(path, "w") as file:
        for name1, name2 in pairs:
            id1, id2 = ids[name1], ids[name2]
            rows, data = connection.execute(
                "SELECT rows, data FROM matches WHERE pair_id = ?", (pair_id(id1, id2),)
            ).fetchone()
            indices = np.frombuffer(data or b"", np.uint32).reshape(rows, 2)[:, :: 1 if id1 < id2 else -1]
            matched_points = np.full(num_keypoints[id1], -1, np.int16)
            matched_points[indices[:, 0]] = indices[:, 1]
            group = file.create_group(f"{name1.replace('/', '-')}/{name2.replace('/', '-')}")
            group["matches0"] = matched_points
            group["matching_scores0"] = (matched_points >= 0).astype(np.float16)


def test_script_localizes_photos_from_colmap_features_in_hloc_files(photos, colmap, tmp_path):
    """Writes COLMAP's features and matches of rendered photos into HDF5 files in hloc's form."""
    database_path = tmp_path / "database.db"
    shutil.copy(photos.database_path, database_path)
    photo_scene.extract_features(colmap, database_path, photos.image_path, photos.query_names)
    photo_scene.match_exhaustively(colmap, database_path)
    pairs = [(query, name) for query in photos.query_names for name in photos.database_names]
    (tmp_path / "pairs.txt").write_text("".join(f"{query} {name}\n" for query, name in pairs))
    with sqlite3.connect(database_path) as connection:
        write_hloc_features(tmp_path / "features.h5", connection)
        write_hloc_matches(tmp_path / "matches.h5", connection, pairs)
    photos.write_queries(tmp_path / "queries.txt")
    shutil.copytree(photos.model_path, tmp_path / "model")
    assert_script_localizes(tmp_path, colmap, {name: photos.poses[name] for name in photos.query_names})


def test_mistakes_are_one_line_and_make_no_database(hloc_files, capsys):
    folder, folder_name, queries = hloc_files
    good = (folder / "pairs.txt").read_text()
    for text, word in [
        ("one\n", "pairs.txt"),
        (good + f"{folder_name[queries[0]]} db/none.jpg\n", "db/none.jpg"),
        (good + " ".join(folder_name[name] for name in queries[:2]) + "\n", "has no matches"),
    ]:
        (folder / "pairs.txt").write_text(text)
        assert convert(folder) == 1
        error = capsys.readouterr().err
        assert error.startswith("colmap_lazyloc.hloc_to_database: ") and word in error and error.count("\n") == 1
        assert not (folder / "out.db").exists()
    (folder / "pairs.txt").write_text(good)
    (folder / "out.db").write_text("mine")
    assert convert(folder) == 1 and (folder / "out.db").read_text() == "mine"
