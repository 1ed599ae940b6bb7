"""Tests of COLMAP's matchers with our exact matches: `colmap lazy_exhaustive_matcher` and others."""

import itertools
import shutil
import sqlite3
import subprocess

import numpy as np
import pytest

from colmap_lazyloc.database import remove_matches
from colmap_lazyloc.program import find_option, gpu_option

MAX_RATIO, MAX_DISTANCE_RAD = 0.8, 0.7  # COLMAP's
MAX_IMAGE_ID = 2147483647


@pytest.fixture
def database(photos, tmp_path):
    path = tmp_path / "database.db"
    shutil.copy(photos.database_path, path)
    remove_matches(path)
    return path


def read_all(database, query):
    with sqlite3.connect(f"file:{database}?mode=ro", uri=True) as connection:
        return connection.execute(query).fetchall()


def read_matches(database, table="matches"):
    """Returns the matches of each pair of images, by their ids."""
    return {
        divmod(pair_id, MAX_IMAGE_ID): np.frombuffer(data or b"", np.uint32).reshape(-1, 2).tolist()
        for pair_id, data in read_all(database, f"SELECT pair_id, data FROM {table}")
    }


def nearest(angles):
    """Returns the column of the smallest angle of each row, -1 where it does not stand out."""
    columns = np.argmin(angles, axis=1)
    first, second = np.partition(angles, 1, axis=1)[:, :2].T
    return np.where((first <= MAX_DISTANCE_RAD) & (first < MAX_RATIO * second), columns, -1)


def exact_matches(descriptors1, descriptors2):
    angles = np.arccos(np.minimum(descriptors1 @ descriptors2.T / 512**2, 1))
    forth, back = nearest(angles), nearest(angles.T)
    return [[row, column] for row, column in enumerate(forth) if column >= 0 and back[column] == row]


def match(colmap, database, command, *options):
    words = [str(word) for word in (colmap, command, "--database_path", database, *options)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return read_matches(database)


def pair_list(database):
    """Returns the options for a list of three pairs."""
    names = [name for (name,) in read_all(database, "SELECT name FROM images ORDER BY image_id")]
    path = database.with_name("pairs.txt")
    path.write_text("".join(f"{first} {second}\n" for first, second in itertools.pairwise(names[:4])))
    return ["--match_type", "pairs", "--match_list_path", path]


@pytest.mark.parametrize(
    "command, options, num_pairs",
    [
        ("lazy_exhaustive_matcher", lambda _: (), 15),
        ("lazy_sequential_matcher", lambda _: ("--SequentialMatching.overlap", 1), 5),
        ("lazy_matches_importer", pair_list, 3),
    ],
)
def test_matches_are_exact_and_verified(colmap, database, command, options, num_pairs):
    matches = match(colmap, database, command, *options(database))
    descriptors = {
        image_id: np.frombuffer(data, np.uint8).reshape(rows, -1).astype(np.float32)
        for image_id, rows, data in read_all(database, "SELECT image_id, rows, data FROM descriptors")
    }
    assert len(matches) == num_pairs
    for (first, second), found in matches.items():
        assert sorted(found) == exact_matches(descriptors[first], descriptors[second])
    assert max(map(len, matches.values())) > 100
    verified = read_matches(database, "two_view_geometries")
    assert verified.keys() == matches.keys() and max(map(len, verified.values())) > 100


def test_other_options_are_those_of_colmap(colmap, database, tmp_path):
    exact = match(colmap, database, "lazy_exhaustive_matcher")
    for option, value in (("cross_check", 0), ("max_ratio", 0.95)):
        other = tmp_path / f"{option}.db"
        shutil.copy(database, other)
        remove_matches(other)
        name = find_option(colmap, "exhaustive_matcher", rf"SiftMatching\.{option}", "of matching")
        found = match(colmap, other, "lazy_exhaustive_matcher", name, value)
        assert sum(map(len, found.values())) > 1.05 * sum(map(len, exact.values()))


def test_guided_matching(colmap, database, tmp_path):
    match(colmap, database, "lazy_exhaustive_matcher")
    guided = tmp_path / "guided.db"
    shutil.copy(database, guided)
    remove_matches(guided)
    name = find_option(colmap, "exhaustive_matcher", r"\w+Matching\.guided_matching", "of guided matching")
    match(colmap, guided, "lazy_exhaustive_matcher", name, 1)
    plain, more = (read_matches(path, "two_view_geometries") for path in (database, guided))
    assert sum(map(len, more.values())) > sum(map(len, plain.values()))


def test_same_geometries_with_any_number_of_threads(colmap, database, tmp_path):
    """Not so with COLMAP's matchers: a thread's random numbers go on from pair to pair."""
    name = find_option(colmap, "exhaustive_matcher", r"\w+Matching\.num_threads", "of threads")
    geometries = []
    for num_threads in (1, 2, 4):
        path = tmp_path / f"{num_threads}.db"
        shutil.copy(database, path)
        match(colmap, path, "lazy_exhaustive_matcher", name, num_threads)
        geometries.append(read_all(path, "SELECT * FROM two_view_geometries ORDER BY pair_id"))
    assert len(geometries[0]) == 15
    assert geometries[1] == geometries[0] and geometries[2] == geometries[0]


@pytest.mark.parametrize("value", [0, 1])
def test_the_gpu_can_be_named(colmap, database, value):
    """Without a GPU, COLMAP refuses it, as in its own command."""
    words = [colmap, "lazy_exhaustive_matcher", "--database_path", database, gpu_option(colmap, "exhaustive_matcher")]
    done = subprocess.run([*map(str, words), str(value)], capture_output=True, text=True, timeout=120)
    assert (done.returncode == 0) == bool(read_matches(database)) and (value == 1 or done.returncode == 0)


def test_help(colmap):
    done = subprocess.run([colmap, "lazy_matches_importer", "-h"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    assert "COLMAP's matches_importer" in done.stdout and "--match_list_path" in done.stdout + done.stderr
