"""Tests that upgrade_database makes a COLMAP 3.10 database, which COLMAP 4 cannot open, one that it can."""

import sqlite3

import numpy as np
import pytest

from colmap_lazyloc import upgrade_database
from colmap_lazyloc.testing import synthetic


def upgrade(*arguments):
    return upgrade_database.main(list(map(str, arguments)))


@pytest.fixture()
def database_path(tmp_path, exact):
    path = synthetic.write_database(tmp_path / "database.db", exact.scene, "3.10")
    with sqlite3.connect(path) as connection:
        synthetic.insert(
            connection, "pose_priors", image_id=1, position=np.array([1, 2, 3], "<f8").tobytes(), coordinate_system=1
        )
    connection.close()
    return path


def opens_in_colmap4(path):
    import pycolmap

    try:
        pycolmap.Database.open(str(path)).close()
    except Exception as error:
        assert "No registered database factory succeeded" in str(error)
        return False
    return True


def assert_holds_scene(path, scene):
    import pycolmap

    with pycolmap.Database.open(str(path)) as database:
        assert {image.name for image in database.read_all_images()} == set(scene.images)
        for image in scene.images.values():
            np.testing.assert_array_equal(database.read_keypoints(image.image_id)[:, :2], image.keypoints)
        priors = database.read_all_pose_priors()
        assert [list(prior.position) for prior in priors] == [[1, 2, 3]]
        assert priors[0].corr_data_id.id == 1


def test_copy_opens_and_the_original_stays(database_path, exact):
    before = database_path.read_bytes()
    assert upgrade(database_path) == 0
    assert database_path.read_bytes() == before
    assert_holds_scene(database_path.with_name("database_colmap4.db"), exact.scene)
    assert not opens_in_colmap4(database_path), "else this script is of no use any more"


def test_output_path(database_path, exact, tmp_path):
    assert upgrade(database_path, "--output_path", tmp_path / "copy.db") == 0
    assert_holds_scene(tmp_path / "copy.db", exact.scene)


def test_in_place(database_path, exact):
    assert upgrade(database_path, "--in_place") == 0
    assert [path.name for path in database_path.parent.glob("*.db")] == ["database.db"]
    assert_holds_scene(database_path, exact.scene)


def test_database_that_colmap4_has_left_half_migrated(database_path, exact):
    assert not opens_in_colmap4(database_path)
    assert upgrade(database_path, "--in_place") == 0
    assert_holds_scene(database_path, exact.scene)


def test_what_stands_in_the_write_ahead_log_is_copied(database_path, tmp_path):
    connection = sqlite3.connect(database_path)
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("UPDATE images SET name = 'renamed.jpg' WHERE image_id = 1")
    connection.commit()
    assert upgrade(database_path, "--output_path", tmp_path / "copy.db") == 0
    connection.close()
    copy = sqlite3.connect(tmp_path / "copy.db")
    assert copy.execute("SELECT name FROM images WHERE image_id = 1").fetchone() == ("renamed.jpg",)
    copy.close()


@pytest.mark.parametrize("schema", ["3.6", "3.8", "4.2"])
def test_database_that_needs_nothing_is_left_alone(tmp_path, exact, schema, capsys):
    path = tmp_path / "database.db"
    if schema == "4.2":
        from colmap_lazyloc.testing import synthetic_pycolmap

        synthetic_pycolmap.write_pycolmap_database(path, exact.scene)
    else:
        synthetic.write_database(path, exact.scene, schema)
    before = path.read_bytes()
    assert upgrade(path, "--in_place") == 0 and "as it is" in capsys.readouterr().out
    assert path.read_bytes() == before
    assert opens_in_colmap4(path)


def test_mistakes_are_one_line(tmp_path, database_path, capsys):
    (tmp_path / "text.db").write_text("no database at all, but long enough to be looked at" * 10)
    (tmp_path / "taken.db").touch()
    sqlite3.connect(tmp_path / "empty.db").close()
    for arguments, words in [
        ([tmp_path / "missing.db"], "missing.db: no such file"),
        ([tmp_path / "text.db"], "text.db: file is not a database"),
        ([tmp_path / "empty.db"], "empty.db: is no COLMAP database"),
        ([database_path, "--output_path", tmp_path / "taken.db"], "taken.db: is there already"),
    ]:
        assert upgrade(*arguments) == 1
        error = capsys.readouterr().err
        assert error.count("\n") == 1 and words in error
    assert (tmp_path / "taken.db").read_bytes() == b""
