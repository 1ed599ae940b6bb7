"""Measures memory and time of one process over the number of queries, all of them in one synthetic database.

    scripts/python.sh -m benchmarks streaming --work_path WORK [--num_queries 1000 10000 100000] -- [OPTION...]

Each query is one of a few hundred synthetic images under another name, so that the database is made in minutes; the
program does not know that, and localizes each one.
"""

import argparse
import json
import pathlib
import shutil
import sqlite3
import subprocess
import sys
import time

import numpy as np

from colmap_lazyloc.database import pair_id
from colmap_lazyloc.program import find_colmap
from colmap_lazyloc.testing import synthetic

NUM_DATABASE_IMAGES = 12
NUM_TEMPLATES = 200
# Fills the cache of keypoints of a thread (16 MiB) with the first thousand queries.
NUM_KEYPOINTS = 1100
# Reports the peak memory of the program; this process is so small that its own memory does not count.
LAUNCHER = """
import json, resource, subprocess, sys
code = subprocess.call(sys.argv[2:], stdout=subprocess.DEVNULL)
usage = resource.getrusage(resource.RUSAGE_CHILDREN)
json.dump({"peak_mib": usage.ru_maxrss / 1024, "cpu_s": usage.ru_utime + usage.ru_stime}, open(sys.argv[1], "w"))
sys.exit(code)
"""


def make_templates() -> synthetic.Scene:
    """Makes the database images, and the images that the queries are copies of."""
    scene = synthetic.make_scene(
        synthetic.arc(NUM_DATABASE_IMAGES), synthetic.arc(NUM_TEMPLATES, radius=5), noise_px=0.5, num_points=120
    )
    rng = np.random.default_rng(0)
    for image in scene.images.values():
        num_more = NUM_KEYPOINTS - len(image.keypoints)
        more = rng.uniform(0, 480, (num_more, 2)).astype(np.float32)
        image.keypoints = np.concatenate([image.keypoints, more])
        image.point_of_keypoint = np.concatenate([image.point_of_keypoint, np.full(num_more, -1)])
    return scene


def query_name(i: int) -> str:
    """Returns the name of a query."""
    return f"query/{i:07d}.jpg"


def write_database(folder: pathlib.Path, num_queries: int):
    """Writes a database with that many queries, and the model of its database images."""
    scene = make_templates()
    synthetic.write_model(folder / "model", scene)
    path = folder / "database.db"
    connection = sqlite3.connect(path)
    connection.executescript("PRAGMA synchronous = OFF; PRAGMA journal_mode = OFF;" + synthetic.SCHEMAS["3.10"])
    synthetic.insert_scene(connection, scene)
    template_ids = [scene.images[name].image_id for name in scene.query_names]
    database_ids = [scene.images[name].image_id for name in scene.database_names]
    first_id = len(scene.images) + 1
    select = "SELECT rows, cols, data, config, F, E, H, qvec, tvec FROM two_view_geometries WHERE pair_id = ?"
    geometries = [[connection.execute(select, [pair_id(d, t)]).fetchone() for d in database_ids] for t in template_ids]
    keypoints = [
        connection.execute("SELECT rows, cols, data FROM keypoints WHERE image_id = ?", [t]).fetchone()
        for t in template_ids
    ]
    with connection:
        for i in range(num_queries):
            image_id, template = first_id + i, i % NUM_TEMPLATES
            connection.execute("INSERT INTO images VALUES (?, ?, 2)", [image_id, query_name(i)])
            connection.execute("INSERT INTO keypoints VALUES (?, ?, ?, ?)", [image_id, *keypoints[template]])
            connection.executemany(
                "INSERT INTO two_view_geometries (pair_id, rows, cols, data, config, F, E, H, qvec, tvec) "
                "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                [(pair_id(d, image_id), *row) for d, row in zip(database_ids, geometries[template], strict=True)],
            )
    connection.close()


def measure(folder: pathlib.Path, num_queries: int, more_arguments: list[str]) -> dict:
    """Localizes the first queries. Returns time, memory and the size of the results."""
    queries, output, usage = folder / "queries.txt", folder / f"output_{num_queries}", folder / "usage.json"
    queries.write_text("".join(query_name(i) + "\n" for i in range(num_queries)))
    shutil.rmtree(output, ignore_errors=True)
    arguments = ["--database_path", folder / "database.db", "--input_path", folder / "model", "--output_path", output]
    arguments += ["--query_list_path", queries, *more_arguments]
    command = [sys.executable, "-c", LAUNCHER, usage, find_colmap(), "lazy_localizer", *arguments]
    start = time.monotonic()
    subprocess.run(list(map(str, command)), check=True)
    seconds = time.monotonic() - start
    num_localized = sum(not line.startswith("#") for line in (output / "poses.txt").read_text().splitlines())
    num_bytes = sum(path.stat().st_size for path in output.rglob("*") if path.is_file())
    shutil.rmtree(output)
    return {
        "queries": num_queries,
        "localized": num_localized,
        **json.loads(usage.read_text()),
        "wall_s": seconds,
        "output_mib": num_bytes / 2**20,
    }


def main(arguments=None):
    """Makes the database, if there is none, and prints a line for each number of queries."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work_path", type=pathlib.Path, required=True)
    parser.add_argument("--num_queries", type=int, nargs="+", default=[1000, 10_000, 100_000])
    parser.add_argument("more_arguments", nargs="*", help="of colmap lazy_localizer, after --")
    options = parser.parse_args(arguments)
    if not options.work_path.exists():
        options.work_path.mkdir(parents=True)
        write_database(options.work_path, max(options.num_queries))
    print(
        "| queries | localized | peak MiB | CPU s | wall s | CPU ms / query | output MiB |\n" + "|---" * 7 + "|",
        flush=True,
    )
    for num_queries in options.num_queries:
        m = measure(options.work_path, num_queries, options.more_arguments)
        print(
            f"| {num_queries:,} | {m['localized']:,} | {m['peak_mib']:.1f} | {m['cpu_s']:.1f} | {m['wall_s']:.1f} "
            f"| {1000 * m['cpu_s'] / num_queries:.2f} | {m['output_mib']:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
