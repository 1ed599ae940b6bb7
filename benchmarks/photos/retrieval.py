"""Measures the retrieval index: its recall, its size, and the time to build and to update it.

    python -m benchmarks retrieval --help

Recall: every fourth image of a scene is a query, all others are the database. COLMAP matches each query with all
database images; the K images with the most verified matches are the best ones. The recall is the share of the best
images that are among the first K of the index.

Growth: synthetic databases of the given --sizes, whose descriptors are drawn at random from the scene's, with noise. To
measure an update, one image is then removed and another one added.

Prints tables; databases with matches are kept in --work_path.
"""

import argparse
import pathlib
import resource
import shutil
import sqlite3
import sys
import tempfile

import numpy as np

from benchmarks.localization.environment import describe_environment
from benchmarks.localization.matches import MIN_NUM_INLIERS, MatchDatabase
from benchmarks.photos import photo_scenes
from colmap_lazyloc.errors import command
from colmap_lazyloc.program import find_colmap, run_colmap

NOISE = 8  # standard deviation per element of a synthetic descriptor; the norm of a descriptor is 512
DESCRIPTOR_SIZE = 128


@command
def main(arguments=None):
    options = parse(arguments)
    print("# Retrieval\n", *describe_environment(), "", sep="\n")
    fold = photo_scenes.make_fold(options.scene_path, 0, options.work_path, options.colmap)
    print(recall_table(fold, options.num_retrieved), "\n")
    print(growth_table(fold, options.sizes))


def recall_table(fold: photo_scenes.Fold, counts: list[int]) -> str:
    with MatchDatabase(fold.matched_path) as database:
        num_inliers = {
            query: {name: database.num_inliers(query, name) for name in fold.database_names}
            for query in fold.query_names
        }
    lines = [
        f"{fold.scene.name}, {len(fold.query_names)} queries, {len(fold.database_names)} database images\n",
        "| K | share of the K best images found | share of the 5 best images found | best image found "
        "| matches with the K returned images divided by matches with the K best images |",
        "|---|---|---|---|---|",
    ]
    for count in counts:
        records = fold.localize_photos("retrieval", "--LazyLocalizer.num_retrieved", count)
        found = {query: {pair["name"] for pair in record["pairs"]} for query, record in records.items()}
        recalls = [[recall(num_inliers[query], found[query], most) for query in found] for most in (count, 5, 1)]
        shares = [share(num_inliers[query], found[query], count) for query in found]
        percentages = (f"{100 * np.mean(values):.1f} %" for values in [*recalls, shares])
        lines.append(f"| {count} | {' | '.join(percentages)} |")
    return "\n".join(lines)


def best_images(num_inliers: dict[str, int], count: int) -> list[str]:
    """Returns the `count` images with the most verified matches, or fewer if fewer have enough."""
    best = sorted(num_inliers, key=lambda name: -num_inliers[name])[:count]
    return [name for name in best if num_inliers[name] >= MIN_NUM_INLIERS]


def recall(num_inliers: dict[str, int], found: set[str], count: int) -> float:
    best = best_images(num_inliers, count)
    return len(found.intersection(best)) / len(best)


def share(num_inliers: dict[str, int], found: set[str], count: int) -> float:
    """Returns the number of verified matches of the found images divided by that of the best images."""
    best = best_images(num_inliers, count)
    return sum(num_inliers[name] for name in found) / sum(num_inliers[name] for name in best)


def growth_table(fold: photo_scenes.Fold, sizes: list[tuple[int, int]]) -> str:
    lines = [
        "Synthetic descriptors\n",
        "| images x features per image | size of the index, MB | make the index, core-s | open the index, core-s "
        "| update after removing an image, core-s | update after adding an image, core-s |",
        "|---|---|---|---|---|---|",
    ]
    for count, num_features in sizes:
        with tempfile.TemporaryDirectory(dir=fold.work_path) as folder:
            lines.append(growth_row(fold, pathlib.Path(folder), count, num_features))
            print(lines[-1], file=sys.stderr)
    return "\n".join(lines)


def growth_row(fold: photo_scenes.Fold, folder: pathlib.Path, count: int, num_features: int) -> str:
    database_path, index_path = folder / "synthetic.db", folder / "synthetic.index"
    synthetic = SyntheticDatabase(fold.photo_path, database_path, num_features)
    synthetic.add(range(1, count + 1))
    seconds = [index_core_seconds(fold, database_path, index_path, f"made, {count} images")]
    size_mb = index_path.stat().st_size / 1e6
    seconds.append(index_core_seconds(fold, database_path, index_path, "0 added, 0 removed"))
    synthetic.remove(count // 2)
    seconds.append(index_core_seconds(fold, database_path, index_path, "0 added, 1 removed"))
    synthetic.add([count + 1])
    seconds.append(index_core_seconds(fold, database_path, index_path, "1 added, 0 removed"))
    synthetic.close()
    return f"| {count:,} x {num_features:,} | {size_mb:.1f} | " + " | ".join(f"{value:.2f}" for value in seconds) + " |"


def index_core_seconds(fold: photo_scenes.Fold, database_path, index_path, expected: str) -> float:
    before = core_seconds()
    output = run_colmap(fold.colmap, "lazy_indexer", "--database_path", database_path, "--index_path", index_path)
    if expected not in output:
        raise RuntimeError(f"lazy_indexer says '{output.strip()}' instead of '{expected}'")
    return core_seconds() - before


def core_seconds() -> float:
    """Returns the CPU time of all child processes, because wall-clock time depends on what else the machine runs."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


class SyntheticDatabase:
    """A COLMAP database whose images have descriptors similar to those of another one."""

    def __init__(self, source_path: pathlib.Path, path: pathlib.Path, num_features: int):
        shutil.copyfile(source_path, path)
        self._connection = sqlite3.connect(path)
        blobs = self._connection.execute("SELECT data FROM descriptors WHERE rows > 0 ORDER BY image_id").fetchall()
        self._pool = np.concatenate([np.frombuffer(blob, np.uint8).reshape(-1, DESCRIPTOR_SIZE) for (blob,) in blobs])
        self._num_features = num_features
        # Keep a row to change and insert, because the columns differ between COLMAP's versions.
        for table in ("keypoints", "descriptors"):
            self._connection.execute(f"CREATE TEMP TABLE {table}_row AS SELECT * FROM {table} LIMIT 1")
        for table in ("keypoints", "descriptors", "images"):
            self._connection.execute(f"DELETE FROM {table}")

    def add(self, image_ids):
        for image_id in image_ids:
            random = np.random.default_rng(image_id)
            rows = self._pool[random.integers(len(self._pool), size=self._num_features)]
            noisy = np.clip(rows + np.rint(random.normal(0, NOISE, rows.shape)), 0, 255).astype(np.uint8)
            keypoints = random.uniform(0, 480, (self._num_features, 2)).astype(np.float32)
            self._connection.execute(
                "INSERT INTO images (image_id, name, camera_id) VALUES (?, ?, 1)", (image_id, f"{image_id:06}.jpg")
            )
            for table, values in (("descriptors", noisy), ("keypoints", keypoints)):
                self._connection.execute(
                    f"UPDATE {table}_row SET image_id = ?, rows = ?, cols = ?, data = ?",
                    (image_id, *values.shape, values.tobytes()),
                )
                self._connection.execute(f"INSERT INTO {table} SELECT * FROM {table}_row")
        self._connection.commit()

    def close(self):
        self._connection.close()

    def remove(self, image_id: int):
        for table in ("keypoints", "descriptors", "images"):
            self._connection.execute(f"DELETE FROM {table} WHERE image_id = ?", (image_id,))
        self._connection.commit()


def parse(arguments) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene_path", type=pathlib.Path, help="folder with images/ and model/ (text)")
    parser.add_argument("--colmap", type=pathlib.Path, default=find_colmap(), help="path of our colmap program")
    parser.add_argument("--work_path", type=pathlib.Path, required=True, help="folder for databases and indices")
    parser.add_argument("--num_retrieved", type=int, nargs="*", default=[5, 10, 20], metavar="K")
    parser.add_argument(
        "--sizes",
        type=size,
        nargs="*",
        default=[(43, 8000), (1000, 8000), (10000, 1500)],
        metavar="IMAGESxFEATURES",
        help="of the synthetic databases, for example 43x8000",
    )
    return parser.parse_args(arguments)


def size(text: str) -> tuple[int, int]:
    num_images, num_features = map(int, text.split("x"))
    return num_images, num_features
