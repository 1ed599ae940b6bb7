"""Tests of LazyLocalizer.Advanced.on_demand: database images have features when a photo needs them."""

import shutil
import sqlite3

import cv2
import pytest

from colmap_lazyloc.database import remove_features
from conftest import assert_refused

ON_DEMAND = ("--LazyLocalizer.Advanced.on_demand", 1)
FEW = (*ON_DEMAND, "--LazyLocalizer.num_retrieved", 4)  # of 6 database images


class Work:
    """A database in which features can be missing, and photos that can be changed."""

    def __init__(self, folder, photos, localize):
        self.folder, self.photos, self.localize = folder, photos, localize
        self.database_path, self.image_path = folder / "database.db", folder / "images"
        shutil.copy(photos.database_path, self.database_path)
        shutil.copytree(photos.image_path, self.image_path)
        self.queries = photos.write_queries(folder / "queries.txt")

    def remove_features(self, names=None):
        if names is None:
            remove_features(self.database_path)
            return
        with sqlite3.connect(self.database_path) as connection:
            for table in ("keypoints", "descriptors"):
                images = f"(SELECT image_id FROM images WHERE name IN ({', '.join('?' * len(names))}))"
                connection.execute(f"DELETE FROM {table} WHERE image_id IN {images}", names)

    def run(self, *more, index="index"):
        words = self.photos.arguments(self.queries, "--retrieval_index_path", self.folder / index, *more)
        words[words.index("--database_path") + 1] = self.database_path
        words[words.index("--image_path") + 1] = self.image_path
        return self.localize(*words)


@pytest.fixture
def work(photos, localize, tmp_path):
    return Work(tmp_path, photos, localize)


def contents(run):
    """Returns what a run has found, without the seconds that it took."""
    results = {name: {**result, "seconds": None} for name, result in run.results.items()}
    model = {path.name: path.read_bytes() for path in (run.output_path / "model").iterdir()}
    return results, run.poses_bytes, model


def test_results_are_those_of_features_in_the_database(work, photos):
    run = work.run(*FEW, index="complete")
    photos.assert_localized(run)
    assert all(len(run.pair_names(name)) == 4 for name in photos.query_names)
    expected = contents(run)
    work.remove_features(photos.database_names[1:4])
    assert contents(work.run(*FEW, index="half")) == expected
    work.remove_features()
    before = work.database_path.read_bytes()
    assert contents(work.run(*FEW)) == expected
    assert work.database_path.read_bytes() == before
    assert contents(work.run(*FEW, "--LazyLocalizer.num_threads", 1)) == expected  # from what was kept
    shutil.rmtree(work.folder / "index.features")
    assert contents(work.run(*FEW, "--LazyLocalizer.Advanced.cache_gb", 0)) == expected


def test_only_what_is_needed_is_extracted_and_kept(work, photos):
    work.remove_features()
    (work.queries).write_text(work.queries.read_text().splitlines()[0] + "\n")
    run = work.run(*FEW)
    kept = work.folder / "index.features"
    assert len(list((work.folder / "index.coarse").iterdir())) == 6
    assert len(list(kept.iterdir())) == 4 == len(run.pair_names(photos.query_names[0]))
    times = {path: path.stat().st_mtime_ns for path in kept.iterdir()}
    first = contents(run)
    assert contents(work.run(*FEW)) == first
    assert {path: path.stat().st_mtime_ns for path in kept.iterdir()} == times
    for path in kept.iterdir():
        path.write_bytes(path.read_bytes()[:-100])
    assert contents(work.run(*FEW)) == first
    assert all(path.stat().st_mtime_ns > time for path, time in times.items())


def test_another_photo_under_the_same_name_is_noticed(work, photos):
    work.remove_features()
    before = contents(work.run(*ON_DEMAND))
    path = work.image_path / photos.database_names[2]
    photo = cv2.imread(str(path))
    photo[:, :240] = 0
    cv2.imwrite(str(path), photo)
    after = contents(work.run(*ON_DEMAND))
    assert after != before and after == contents(work.run(*ON_DEMAND, index="fresh"))


def test_photos_that_cannot_be_used_are_left_out(work, photos):
    work.remove_features()
    first, second, third = photos.database_names[:3]
    (work.image_path / first).write_bytes(b"no photo")
    cv2.imwrite(str(work.image_path / second), cv2.imread(str(work.image_path / second))[:100])
    (work.image_path / third).unlink()
    run = work.run(*ON_DEMAND)
    photos.assert_localized(run)
    assert f"{second}: is not a readable image of the size of its camera, 480 x 360" in run.stderr
    for name in photos.query_names:
        assert run.pair_names(name) == photos.database_names[3:]


def test_without_the_option_images_without_features_are_left_out(work, photos):
    work.remove_features(photos.database_names[:2])
    run = work.run()
    for name in photos.query_names:
        assert run.pair_names(name) == photos.database_names[2:]
    work.remove_features()
    assert_refused(work.run(), "no posed image has descriptors", "feature_extractor")


def test_options_that_exclude_it(work, photos):
    assert_refused(work.run(*ON_DEMAND, "--shard", "1/2"), "on_demand excludes --shard")
    words = ["--database_path", work.database_path, "--input_path", photos.model_path, *ON_DEMAND]
    assert_refused(work.localize(*words), "on_demand needs --image_path")
    shutil.rmtree(work.image_path / "database")
    work.remove_features()
    assert_refused(work.run(*ON_DEMAND), "no posed image has descriptors", "or a photo below --image_path")
