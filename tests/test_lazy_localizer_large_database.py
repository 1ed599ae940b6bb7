"""Tests that a database of 20,000 images gives the same poses, in memory that hardly grows with the database."""

import itertools
import json
import sqlite3
import sys

import numpy as np
import pytest

from colmap_lazyloc.database import pair_id
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.testing import synthetic

NUM_IMAGES = 20_000
NUM_FILLER_KEYPOINTS = 500
# The program needs memory for each image's name, ids, camera and pose, in the tables by name and by id and once more in
# the model that it writes. If it read all keypoints, they alone would take 20,000 x 500 x 16 bytes = 153 MiB, and the
# matches between neighbours as much again.
MAX_GROWTH_MIB = 60
# Reports the peak memory of the program; the launcher is so small that its own memory does not count.
LAUNCHER = """
import json, resource, subprocess, sys
code = subprocess.call(sys.argv[2:])
peak_kib = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
json.dump({"peak_mib": peak_kib / 1024}, open(sys.argv[1], "w"))
sys.exit(code)
"""


@pytest.fixture(scope="module")
def core():
    """Makes thirty database images and ten queries that see the same points."""
    return synthetic.make_scene(synthetic.arc(30), synthetic.arc(10, radius=5), noise_px=0.5, visible_ratio=0.4)


def write_large(folder, core, num_images):
    """Writes the core's images, spread over the ids, and others that are matched with their neighbours."""
    rng = np.random.default_rng(0)
    scene = core.with_image_ids(np.sort(rng.choice(num_images, len(core.images), replace=False)) + 1)
    core_ids = {image.image_id for image in scene.images.values()}
    filler_ids = [image_id for image_id in range(1, num_images + 1) if image_id not in core_ids]
    connection = sqlite3.connect(folder / "database.db")
    connection.executescript("PRAGMA synchronous = OFF;" + synthetic.SCHEMAS["3.10"])
    synthetic.insert_scene(connection, scene)
    insert_fillers(connection, filler_ids, rng)
    connection.close()
    for image_id in filler_ids:
        name, nothing = filler_name(image_id), np.zeros(0)
        pose = Pose(np.array([1.0, 0, 0, 0]), np.array([100.0, 0.1 * image_id, 0]))
        scene.images[name] = synthetic.Image(name, image_id, 1, pose, nothing, nothing)
    synthetic.write_model(folder / "model", scene)
    return ["--database_path", folder / "database.db", "--input_path", folder / "model"]


def filler_name(image_id):
    return f"filler/{image_id:05d}.jpg"


def insert_fillers(connection, ids, rng):
    keypoints = rng.uniform(0, 480, (NUM_FILLER_KEYPOINTS, 2)).astype("<f4").tobytes()
    matches = np.repeat(np.arange(NUM_FILLER_KEYPOINTS, dtype="<u4"), 2).tobytes()
    pairs = [(pair_id(id1, id2), NUM_FILLER_KEYPOINTS, matches) for id1, id2 in itertools.pairwise(ids)]
    with connection:
        connection.executemany(
            "INSERT INTO images (image_id, name, camera_id) VALUES (?, ?, 1)",
            [(image_id, filler_name(image_id)) for image_id in ids],
        )
        connection.executemany(
            "INSERT INTO keypoints VALUES (?, ?, 2, ?)",
            [(image_id, NUM_FILLER_KEYPOINTS, keypoints) for image_id in ids],
        )
        connection.executemany("INSERT INTO matches VALUES (?, ?, 2, ?)", pairs)
        connection.executemany(
            "INSERT INTO two_view_geometries (pair_id, rows, cols, data, config) VALUES (?, ?, 2, ?, 2)", pairs
        )


@pytest.fixture(scope="module")
def runs(localize, core, tmp_path_factory):
    """Returns the run and its peak memory by the database's size."""

    def measure(num_images):
        folder = tmp_path_factory.mktemp(f"images_{num_images}")
        arguments = write_large(folder, core, num_images)
        run = localize(
            *arguments,
            "--LazyLocalizer.num_threads",
            2,
            launcher=[sys.executable, "-c", LAUNCHER, folder / "memory.json"],
        )
        (folder / "database.db").unlink()
        return run, json.loads((folder / "memory.json").read_text())["peak_mib"]

    return {num_images: measure(num_images) for num_images in (200, NUM_IMAGES)}


def test_poses_are_right_and_those_of_a_small_database(runs, core):
    large, small = runs[NUM_IMAGES][0], runs[200][0]
    large.assert_localized(core, core.query_names, 0.014, 0.14)
    assert large.poses_bytes == small.poses_bytes


def test_model_holds_all_images(runs):
    assert len(runs[NUM_IMAGES][0].model_images) == NUM_IMAGES


def test_memory_hardly_grows_with_the_database(runs):
    growth_mib = runs[NUM_IMAGES][1] - runs[200][1]
    print(f"peak memory: {runs[200][1]:.1f} MiB with 200 images, {runs[NUM_IMAGES][1]:.1f} MiB with {NUM_IMAGES}")
    assert growth_mib < MAX_GROWTH_MIB
