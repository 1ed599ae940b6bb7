"""Tests of photos with a rough position: they are compared with the database images near it first."""

import pathlib
import shutil
import sqlite3

import cv2
import numpy as np
import pytest

import photo_scene
from colmap_lazyloc.__main__ import main
from colmap_lazyloc.database import add_images, remove_features
from colmap_lazyloc.demo import survey
from colmap_lazyloc.localizer import Localizer
from colmap_lazyloc.model import Camera, Image, write_model
from colmap_lazyloc.poses import Pose, read_poses
from colmap_lazyloc.report import __main__ as report
from conftest import assert_refused

CAMERA = Camera("SIMPLE_PINHOLE", 64, 48, (60.0, 32.0, 24.0))  # of the images that are far away
NUM_FAR = 170
POSITIONS = "--LazyLocalizer.Advanced.photo_position_path"
ON_DEMAND, FEW = "--LazyLocalizer.Advanced.on_demand", ("--LazyLocalizer.num_retrieved", 4)
CENTRE = (0.0, -3.2, 1.6)  # of the courtyard's photos


class Place:
    """The courtyard's six database images, and many from elsewhere; none has features in the database."""

    def __init__(self, folder, photos, localize):
        self.folder, self.photos, self.localize = folder, photos, localize
        self.images, self.model, self.database = folder / "images", folder / "model", folder / "database.db"
        shutil.copytree(photos.image_path, self.images)
        rng = np.random.default_rng(0)
        poses = {name: photos.poses[name] for name in photos.database_names}
        cameras = dict.fromkeys(poses, photo_scene.CAMERA)
        for i in range(NUM_FAR):
            name = f"database/far{i:03}.png"
            poses[name] = Pose.from_centre(np.eye(3), np.array([100.0 + i, 0, 1.6]))
            cameras[name] = CAMERA
            cv2.imwrite(str(self.images / name), rng.integers(0, 255, (48, 64, 3), np.uint8))
        ids = {photo_scene.CAMERA: 1, CAMERA: 2}
        images = [Image(name, ids[cameras[name]], poses[name], i + 1) for i, name in enumerate(sorted(poses))]
        write_model(self.model, {number: camera for camera, number in ids.items()}, images)
        self.far = {name: camera for name, camera in cameras.items() if camera == CAMERA}
        self.make_database()
        remove_features(self.database)
        self.queries = photos.write_queries(folder / "queries.txt")

    def make_database(self):
        """Makes the database with the features of the courtyard's images."""
        shutil.copy(self.photos.database_path, self.database)
        add_images(self.database, self.far)

    def positions(self, centre, stddev=0.5):
        path = self.folder / "positions.txt"
        x, y, z = centre
        path.write_text("".join(f"{name} {x} {y} {z} {stddev}\n" for name in self.photos.query_names))
        return path

    def run(self, *more, index="index", on_demand=1):
        words = self.photos.arguments(self.queries, "--retrieval_index_path", self.folder / index, *FEW, *more)
        words += [ON_DEMAND, on_demand]
        for name, path in (("database", self.database), ("input", self.model), ("image", self.images)):
            words[words.index(f"--{name}_path") + 1] = path
        run = self.localize(*words)
        self.photos.assert_localized(run)
        return run

    def num_kept(self, kind, index="index"):
        return len(list((self.folder / f"{index}.{kind}").iterdir()))


@pytest.fixture
def place(photos, localize, tmp_path):
    return Place(tmp_path, photos, localize)


def test_only_near_images_are_opened(place, photos):
    path = place.positions(CENTRE)
    near = place.run(POSITIONS, path)
    assert not (place.folder / "index").exists()
    assert place.num_kept("coarse") == 6 + 47 and place.num_kept("features") <= 8
    for index, words in enumerate((("--LazyLocalizer.num_threads", 1), ("--LazyLocalizer.num_threads", 4))):
        assert place.run(POSITIONS, path, *words, index=f"other{index}").poses_bytes == near.poses_bytes
    for name in photos.query_names:
        assert set(near.pair_names(name)).intersection(photos.database_names), name
    # A position that the pose is compared with does the same.
    place.run("--query_position_path", path, index="prior")
    assert not (place.folder / "prior").exists()


def test_a_wrong_position_costs_only_time(place):
    without = place.run(index="without")
    assert place.num_kept("coarse", "without") == 6 + NUM_FAR
    for index, centre in (("far", (160, 0, 1.6)), ("nowhere", (1e7, 0, 0))):
        wrong = place.run(POSITIONS, place.positions(centre), index=index)
        assert wrong.poses_bytes == without.poses_bytes
        assert place.num_kept("coarse", index) == 6 + NUM_FAR
    # A position that tells too little is not used.
    assert place.run(POSITIONS, place.positions(CENTRE, 100), index="vague").poses_bytes == without.poses_bytes


def test_features_in_the_database(place, photos):
    place.make_database()
    rng = np.random.default_rng(1)
    with sqlite3.connect(place.database) as connection:
        for (image_id,) in connection.execute("SELECT image_id FROM images WHERE name LIKE '%far%'").fetchall():
            keypoints, descriptors = rng.random((20, 4), np.float32), rng.integers(0, 90, (20, 128), np.uint8)
            for table, array in (("keypoints", keypoints), ("descriptors", descriptors)):
                # Descriptors of COLMAP 4 have a type as well: that of the images that are there.
                row = connection.execute(f"SELECT * FROM {table} LIMIT 1")
                values = dict(zip((column for column, *_ in row.description), row.fetchone()))
                values.update(image_id=image_id, rows=array.shape[0], cols=array.shape[1], data=array.tobytes())
                marks = ", ".join("?" * len(values))
                connection.execute(f"INSERT INTO {table} ({', '.join(values)}) VALUES ({marks})", [*values.values()])
    near = place.run(POSITIONS, place.positions(CENTRE), on_demand=0)
    assert not (place.folder / "index").exists()
    for name in photos.query_names:
        assert set(photos.database_names).issubset(near.pair_names(name)) and len(near.pair_names(name)) == 6 + 47
    without = place.run(index="without", on_demand=0)
    wrong = place.run(POSITIONS, place.positions((160, 0, 1.6)), index="far", on_demand=0)
    assert wrong.poses_bytes == without.poses_bytes
    assert (place.folder / "far").exists()


def test_python(place, photos):
    run = place.run("--query_position_path", place.positions(CENTRE))
    sift = {"max_num_features": 1500, "first_octave": 0}
    options = {"image_path": place.images, "LazyLocalizer.Advanced.on_demand": 1, "LazyLocalizer.num_retrieved": 4}
    localizer = Localizer(place.database, place.model, options={**options, "SiftExtraction": sift})
    for name in photos.query_names:
        result = localizer.localize_photo(name, photos.camera_words, position=(CENTRE, 0.5))
        assert result.as_dict()["world_from_cam"] == run.results[name]["world_from_cam"]


def test_run_by_gps(place, photos, colmap, monkeypatch):
    monkeypatch.setenv("COLMAP", str(colmap))
    monkeypatch.setattr(report, "main", lambda words: pathlib.Path(words[words.index("--output") + 1]).write_text(""))
    survey.ORIGIN.write(place.model)
    (place.folder / "new").mkdir()
    for index, name in enumerate(photos.query_names):
        path = place.folder / "new" / f"{index}.jpg"
        cv2.imwrite(str(path), cv2.imread(str(place.images / name)), [cv2.IMWRITE_JPEG_QUALITY, 97])
        survey.write_gps(path, np.array(CENTRE) + [3, -4, 30])
    output = place.folder / "out"
    words = ["run", "--database_images", place.images / "database", "--poses", place.model, "--accept_poses"]
    words += ["--queries", place.folder / "new", "--output", output, *FEW, *photo_scene.SIFT]
    assert main([str(word) for word in words]) == 0
    poses = read_poses(output / "localized" / "poses.txt")
    for index, name in enumerate(photos.query_names):
        assert np.linalg.norm(poses[f"query/{index}.jpg"].cam_in_world - photos.poses[name].cam_in_world) < 0.05
    assert not (output / "database.index").exists()
    assert len(list((output / "database.index.coarse").iterdir())) < 85


def test_bad_positions(place, localize):
    words = ["--database_path", place.database, "--input_path", place.model, POSITIONS, place.positions(CENTRE)]
    assert_refused(localize(*words), "photo_position_path needs --image_path")
