"""A damaged record of the database gives the queries that need it a status, and is left out for the others."""

import shutil
import sqlite3

import numpy as np
import pytest

from colmap_lazyloc.database import pair_id

QUERY, OTHERS = "query/001.jpg", ["query/000.jpg", "query/002.jpg"]


class Damaged:
    """A copy of the exact scene's database to damage, and the run without damage."""

    def __init__(self, folder, exact, localize):
        self.exact, self.localize = exact, localize
        self.scene = exact.scene
        self.path = shutil.copy(exact.database_path, folder / "database.db")
        self.ids = {name: image.image_id for name, image in self.scene.images.items()}
        self.good = localize(*exact.arguments)

    def sql(self, statement, *values):
        with sqlite3.connect(self.path) as connection:
            connection.execute(statement, values)
        connection.close()

    def run(self, *arguments, exit_code=0):
        done = self.localize("--database_path", self.path, "--input_path", self.exact.model_path, *arguments)
        assert done.exit_code == exit_code, done.stderr
        return done

    def assert_same(self, done, names):
        """Checks that queries are as without damage, times aside."""
        for name in names:
            results = [dict(run.results[name], seconds=None) for run in (done, self.good)]
            assert results[0] == results[1], name

    def keypoints_with(self, name, value):
        keypoints = self.scene.images[name].keypoints.copy()
        keypoints[7, 1] = value
        return keypoints.tobytes()

    def pair(self, name):
        return pair_id(self.ids[name], self.ids[QUERY])


@pytest.fixture
def damaged(tmp_path, exact, localize):
    return Damaged(tmp_path, exact, localize)


OWN_RECORDS = {
    "not finite": lambda d: d.sql(
        "UPDATE keypoints SET data = ? WHERE image_id = ?", d.keypoints_with(QUERY, np.nan), d.ids[QUERY]
    ),
    "cut short": lambda d: d.sql("UPDATE keypoints SET data = substr(data, 1, 100) WHERE image_id = ?", d.ids[QUERY]),
    "impossible": lambda d: d.sql("UPDATE keypoints SET rows = 2147483647 WHERE image_id = ?", d.ids[QUERY]),
    "negative": lambda d: d.sql("UPDATE keypoints SET rows = -1 WHERE image_id = ?", d.ids[QUERY]),
}


@pytest.mark.parametrize("damage", OWN_RECORDS)
def test_query_with_damaged_keypoints(damaged, damage):
    OWN_RECORDS[damage](damaged)
    done = damaged.run()
    result = done.results[QUERY]
    assert result["status"] == "DAMAGED_DATA"
    assert result["reason"].startswith(f"table keypoints, image {damaged.ids[QUERY]} ({QUERY}): ")
    assert result["cam_from_world"] is None and QUERY not in done.poses
    damaged.assert_same(done, OTHERS)
    assert damaged.run("--strict", 1, exit_code=2).statuses[QUERY] == "DAMAGED_DATA"


CAMERAS = {
    "unknown camera model 99": ("UPDATE cameras SET model = 99 WHERE camera_id = 2",),
    "does not exist": ("DELETE FROM cameras WHERE camera_id = 2",),
    "takes 4 parameters, not 1": (
        "UPDATE cameras SET params = ? WHERE camera_id = 2",
        np.array([480.0]).tobytes(),
    ),
    "not a finite number": (
        "UPDATE cameras SET params = ? WHERE camera_id = 2",
        np.array([np.nan, 490, 300, 250]).tobytes(),
    ),
}


@pytest.mark.parametrize("problem", CAMERAS)
def test_damaged_camera_of_all_queries(damaged, problem):
    damaged.sql(*CAMERAS[problem])
    done = damaged.run()
    assert set(done.statuses.values()) == {"DAMAGED_DATA"}
    for result in done.results.values():
        assert result["reason"].startswith("table cameras, camera 2: ") and problem in result["reason"]


def test_damaged_camera_of_the_database_images(damaged):
    damaged.sql("UPDATE cameras SET width = 'wide' WHERE camera_id = 1")
    done = damaged.run()
    assert set(done.statuses.values()) == {"DAMAGED_DATA"}
    assert "table cameras, camera 1: width is not an integer (9 damaged records)" in done.results[QUERY]["reason"]


PAIRS = {
    "a match names a keypoint": lambda d, pair: d.sql(
        "UPDATE two_view_geometries SET rows = 30, data = ? WHERE pair_id = ?",
        np.array([[0, 100000]] * 30, np.uint32).tobytes(),
        pair,
    ),
    "rows is out of range: -5": lambda d, pair: d.sql(
        "UPDATE two_view_geometries SET rows = -5 WHERE pair_id = ?", pair
    ),
    "config is out of range: 77": lambda d, pair: d.sql(
        "UPDATE two_view_geometries SET config = 77 WHERE pair_id = ?", pair
    ),
    "qvec has 20 bytes": lambda d, pair: d.sql(
        "UPDATE two_view_geometries SET qvec = substr(qvec, 1, 20) WHERE pair_id = ?", pair
    ),
}


@pytest.mark.parametrize("problem", PAIRS)
def test_damaged_pair_is_left_out(damaged, problem):
    PAIRS[problem](damaged, damaged.pair("database/004.jpg"))
    done = damaged.run()
    damaged.assert_same(done, OTHERS)
    assert done.statuses[QUERY] == "LOCALIZED" and done.results[QUERY]["reason"] == ""
    assert "database/004.jpg" not in done.pair_names(QUERY)
    (record,) = done.results[QUERY]["damaged_records"]
    assert record.startswith("table two_view_geometries, pair of ") and problem in record
    assert QUERY in record and "database/004.jpg" in record
    assert done.stderr == f"WARNING: {record}: leaving it out of the pairs of queries\n"


def test_damaged_raw_matches(damaged):
    damaged.sql("DELETE FROM two_view_geometries")
    damaged.sql("UPDATE matches SET data = x'00' WHERE pair_id = ?", damaged.pair("database/004.jpg"))
    done = damaged.run()
    assert set(done.statuses.values()) == {"LOCALIZED"}
    assert len(done.results[QUERY]["damaged_records"]) == 1 and "table matches" in done.stderr


def test_damaged_database_image_is_left_out_for_all(damaged):
    name = "database/003.jpg"
    damaged.sql(
        "UPDATE keypoints SET data = ? WHERE image_id = ?", damaged.keypoints_with(name, np.inf), damaged.ids[name]
    )
    done = damaged.run()
    assert set(done.statuses.values()) == {"LOCALIZED"}
    for query in done.results:
        assert name not in done.pair_names(query)
    assert done.stderr.count("WARNING") == 1, done.stderr  # once, not for each query


def test_all_pairs_damaged(damaged):
    damaged.sql("UPDATE two_view_geometries SET config = 77")
    done = damaged.run()
    assert set(done.statuses.values()) == {"DAMAGED_DATA"}
    assert "(9 damaged records)" in done.results[QUERY]["reason"]


def test_control_characters_are_escaped(damaged):
    damaged.sql("UPDATE images SET name = 'a' || char(27) || '[31m' WHERE image_id = ?", damaged.ids[QUERY])
    damaged.sql("UPDATE keypoints SET cols = 3 WHERE image_id = ?", damaged.ids[QUERY])
    done = damaged.run()
    (result,) = (result for result in done.results.values() if result["status"] == "DAMAGED_DATA")
    assert result["name"] == "a\x1b[31m" and "(a\\x1b[31m): " in result["reason"]


def test_image_without_a_readable_name(damaged):
    damaged.sql("UPDATE images SET name = x'00ff' WHERE image_id = ?", damaged.ids[QUERY])
    done = damaged.run()
    assert sorted(done.results) == OTHERS
    damaged.assert_same(done, OTHERS)
    warning = f"database.db: table images, image {damaged.ids[QUERY]}: name is not text: leaving the image out\n"
    assert done.stderr.endswith(warning) and done.stderr.startswith("WARNING: ")


def test_damaged_row_of_a_listed_query(damaged, tmp_path):
    damaged.sql("UPDATE images SET camera_id = 'x' WHERE image_id = ?", damaged.ids[QUERY])
    (tmp_path / "list.txt").write_text(f"{QUERY}\n")
    done = damaged.run("--query_list_path", tmp_path / "list.txt")
    assert done.statuses == {QUERY: "DAMAGED_DATA"}
    assert done.results[QUERY]["reason"] == f"table images, image {damaged.ids[QUERY]}: camera_id is not an integer"
