"""Tests of reading databases by image name, of copies with fewer images, and of results files."""

import contextlib
import sqlite3

import numpy as np
import pytest

from colmap_lazyloc.database import DatabaseReader, connect, pair_id, remove_images
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.results import pose_of, read_results
from colmap_lazyloc.testing import synthetic


@pytest.fixture
def path(exact, tmp_path):
    return synthetic.write_database(tmp_path / "database #1.db", exact.scene)


def test_matches_are_those_of_the_names_in_either_order(path, exact):
    (name1, name2), pair = next(iter(exact.scene.pairs.items()))
    with DatabaseReader(path) as reader:
        np.testing.assert_array_equal(reader.inlier_matches(name1, name2), pair.inlier_matches)
        np.testing.assert_array_equal(reader.inlier_matches(name2, name1), pair.inlier_matches[:, ::-1])
        assert reader.num_inliers(name2, name1) == len(pair.inlier_matches)
        assert reader.num_inliers(name1, name1) == 0 and reader.inlier_matches(name1, name1).shape == (0, 2)
        np.testing.assert_array_equal(reader.keypoints(name1), exact.scene.images[name1].keypoints)


def test_pair_ids_are_symmetric_and_unlike():
    assert pair_id(3, 5) == pair_id(5, 3) == 3 * 2147483647 + 5


def test_read_only_connection_cannot_write(path):
    with contextlib.closing(connect(path)) as connection, pytest.raises(sqlite3.OperationalError, match="readonly"):
        connection.execute("DELETE FROM images")


def test_removed_image_leaves_nothing_behind(path, exact):
    removed, kept = exact.scene.query_names[:2]
    image_id = exact.scene.images[removed].image_id
    with contextlib.closing(connect(path, "rw")) as connection, connection:
        remove_images(connection, [image_id])
    database_names = exact.scene.database_names
    with DatabaseReader(path) as reader:
        assert set(reader.image_ids) == set(exact.scene.images) - {removed}
        assert all(reader.num_inliers(kept, name) > 0 for name in database_names)
        reader.image_ids[removed] = image_id
        assert len(reader.keypoints(removed)) == 0
        assert not any(reader.num_inliers(removed, name) for name in database_names)


def test_results_have_poses_only_of_localized_queries(tmp_path):
    path = tmp_path / "results.jsonl"
    pose = '"cam_from_world": {"qvec": [1, 0, 0, 0], "tvec": [1, 2, 3]}'
    path.write_text(f'{{"name": "a", "status": "LOCALIZED", {pose}}}\n{{"name": "b", "status": "DIVERGED", {pose}}}\n')
    results = read_results(path)
    assert pose_of(results["a"]).tvec.tolist() == [1, 2, 3] and pose_of(results["b"]) is None
    path.write_text(2 * path.read_text())
    with pytest.raises(InputError, match="query 'a' has two results"):
        read_results(path)
