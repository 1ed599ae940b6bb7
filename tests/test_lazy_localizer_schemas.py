"""Tests that the same matches give the same poses from databases of every COLMAP generation."""

import sqlite3

import numpy as np
import pytest

from colmap_lazyloc.testing import synthetic

WRITERS = ["pycolmap", "built", "3.10", "3.8", "3.6"]


@pytest.fixture(scope="module")
def write(colmap):
    def write_with(writer, path, scene, geometry):
        if writer == "pycolmap":
            from colmap_lazyloc.testing import synthetic_pycolmap

            return synthetic_pycolmap.write_pycolmap_database(path, scene, geometry)
        if writer == "built":
            return synthetic.write_built_colmap_database(path, scene, colmap, geometry)
        return synthetic.write_database(path, scene, writer, geometry)

    return write_with


@pytest.fixture(scope="module")
def references(localize, write, noisy, tmp_path_factory):
    """Returns the runs on pycolmap's databases, by the geometry that these hold."""
    folder = tmp_path_factory.mktemp("references")

    def run(geometry):
        database_path = write("pycolmap", folder / f"{geometry}.db", noisy.scene, geometry)
        run = localize("--database_path", database_path, "--input_path", noisy.model_path)
        run.assert_localized(noisy.scene, noisy.scene.query_names, 0.012, 0.12)
        return run

    return {geometry: run(geometry) for geometry in ("pose", "essential", None)}


def assert_same_poses(run, reference, max_error):
    assert run.exit_code == 0, run.stderr
    assert list(run.poses) == list(reference.poses)
    for name, pose in run.poses.items():
        position_error, rotation_error_deg = pose.errors(reference.poses[name])
        assert position_error <= max_error, name
        assert np.radians(rotation_error_deg) <= max_error, name


# COLMAP 3.6 stores no relative poses.
@pytest.mark.parametrize(
    "writer, geometry",
    [
        (writer, geometry)
        for writer in WRITERS[1:]
        for geometry in ("pose", "essential", None)
        if (writer, geometry) != ("3.6", "pose")
    ],
)
def test_same_poses_from_every_schema(localize, write, noisy, tmp_path, references, writer, geometry):
    database_path = write(writer, tmp_path / "database.db", noisy.scene, geometry)
    run = localize("--database_path", database_path, "--input_path", noisy.model_path)
    assert_same_poses(run, references[geometry], max_error=1e-9)


def test_decomposed_matrices_give_the_stored_poses(references):
    """The essential matrix belongs to the stored pose, so its decomposition differs only by rounding."""
    assert_same_poses(references["essential"], references["pose"], max_error=1e-8)


def test_raw_matches_give_nearly_the_stored_poses(references):
    """RANSAC finds almost the same inliers as those stored, so the poses differ by less than the noise."""
    assert_same_poses(references[None], references["pose"], max_error=0.005)


@pytest.mark.parametrize("num_cols", [4, 6])
def test_keypoints_with_scales_or_affine_shapes(localize, noisy, tmp_path, references, num_cols):
    scene = noisy.scene.copy()
    for image in scene.images.values():
        more = np.full((len(image.keypoints), num_cols - 2), 2.5, np.float32)
        image.keypoints = np.concatenate([image.keypoints, more], axis=1)
    database_path = synthetic.write_database(tmp_path / "database.db", scene)
    run = localize("--database_path", database_path, "--input_path", noisy.model_path)
    assert_same_poses(run, references["pose"], max_error=1e-9)


def test_database_that_pycolmap_migrated(localize, noisy, tmp_path, references):
    import pycolmap

    database_path = synthetic.write_database(tmp_path / "database.db", noisy.scene, "3.8")
    pycolmap.Database.open(str(database_path)).close()
    connection = sqlite3.connect(database_path)
    assert "camera1" in {row[1] for row in connection.execute("PRAGMA table_info(two_view_geometries)")}
    connection.close()
    run = localize("--database_path", database_path, "--input_path", noisy.model_path)
    assert_same_poses(run, references["pose"], max_error=1e-9)


def test_uncalibrated_geometries_are_estimated_again(localize, noisy, tmp_path, references):
    """COLMAP stores only F if it does not trust the focal length. The five-point RANSAC then starts from the stored
    inliers, but in the reference from all raw matches, so the poses agree only to within the noise."""
    database_path = synthetic.write_database(tmp_path / "database.db", noisy.scene, geometry="essential")
    with sqlite3.connect(database_path) as connection:
        connection.execute("UPDATE two_view_geometries SET config = 3, E = zeroblob(72)")
    connection.close()
    run = localize("--database_path", database_path, "--input_path", noisy.model_path)
    assert_same_poses(run, references[None], max_error=2e-3)


def test_some_pairs_verified_and_others_not(localize, noisy, tmp_path):
    database_path = synthetic.write_database(tmp_path / "database.db", noisy.scene)
    with sqlite3.connect(database_path) as connection:
        connection.execute("DELETE FROM two_view_geometries WHERE pair_id % 2 = 0")
    connection.close()
    run = localize("--database_path", database_path, "--input_path", noisy.model_path)
    run.assert_localized(noisy.scene, noisy.scene.query_names, 0.012, 0.12)
    for name in noisy.scene.query_names:
        assert run.pair_names(name) == noisy.scene.database_names
