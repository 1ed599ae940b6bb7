"""The programs of benchmarks/photos on a small scene: photos are localized as well as images of the database."""

import pathlib
import subprocess
import sys

import pytest

BENCHMARK_PATH = pathlib.Path(__file__).resolve().parents[1] / "benchmarks" / "photos"


def run(script, photos, colmap, work_path, *options):
    arguments = [BENCHMARK_PATH / script, photos.folder, "--colmap", colmap, "--work_path", work_path, *options]
    done = subprocess.run([sys.executable, *map(str, arguments)], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stdout.splitlines() if line.startswith("|")]
    return done.stdout, [[cell.strip() for cell in line.strip("| ").split("|")] for line in lines]


@pytest.fixture(scope="module")
def work_path(tmp_path_factory):
    return tmp_path_factory.mktemp("work")


def test_photos_are_as_accurate_as_images_of_the_database(photos, colmap, work_path):
    output, rows = run("compare_with_database.py", photos, colmap, work_path, "--num_seeds", 1)
    assert "SHA-256" in output
    (accuracy,) = [row for row in rows if row[1] == "2, 4"]  # queries, database images
    position_ratio, rotation_ratio = map(float, accuracy[4].split(" / "))
    assert 0.2 < position_ratio < 5 and 0.2 < rotation_ratio < 5
    assert accuracy[-1] == "0, 0"


def test_index_finds_the_images_and_follows_the_database(photos, colmap, work_path):
    _, rows = run("retrieval.py", photos, colmap, work_path, "--num_retrieved", 4, "--num_images", 5, 9,
                  "--num_features", 50)
    (recall,) = [row for row in rows if row[0] == "4"]
    assert recall[1:] == ["100.0 %"] * 4  # the database has four images
    assert [len(row) for row in rows if row[0] in "59"] == [6, 6]
