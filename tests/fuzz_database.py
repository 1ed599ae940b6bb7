"""Damages one record of a small database at a time, by seed, and checks what `colmap lazy_localizer` makes of it.

    scripts/python.sh tests/fuzz_database.py build/bin/colmap --seeds 0 2000 --jobs 2

A seed whose checks fail is printed with what was damaged; `--keep FOLDER` keeps its database. tests/test_fuzz.py runs
the first seeds.
"""

import argparse
import concurrent.futures
import dataclasses
import json
import pathlib
import random
import re
import shutil
import sqlite3
import struct
import subprocess
import sys
import tempfile

import cv2
import numpy as np

from colmap_lazyloc.database import MAX_NUM_IMAGES
from colmap_lazyloc.testing import synthetic
from conftest import split_summary

MAX_SECONDS = 120
PAGE_SIZE = 4096
# Tables without constraints, so that a record can have any value. Rigs are those of COLMAP 4.
TABLES = """
CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY, model, width, height, params, prior_focal_length);
CREATE TABLE images (image_id INTEGER PRIMARY KEY, name, camera_id);
CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY, rows, cols, data);
CREATE TABLE descriptors (image_id INTEGER PRIMARY KEY, rows, cols, data);
CREATE TABLE matches (pair_id INTEGER PRIMARY KEY, rows, cols, data);
CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY, rows, cols, data, config, F, E, H, qvec, tvec,
    camera1, camera2);
CREATE TABLE rigs (rig_id INTEGER PRIMARY KEY, ref_sensor_id, ref_sensor_type);
CREATE TABLE rig_sensors (rig_id, sensor_id, sensor_type, sensor_from_rig);
CREATE TABLE frames (frame_id INTEGER PRIMARY KEY, rig_id);
CREATE TABLE frame_data (frame_id, data_id, sensor_id, sensor_type);
"""
KEYED_TABLES = ("cameras", "images", "keypoints", "descriptors", "matches", "two_view_geometries")
DAMAGED_TABLES = (*KEYED_TABLES, "frame_data", "rig_sensors")
PHOTO = "photo.png"
INTEGERS = (-1, 0, 1, 2, 7, 255, 2**31 - 2, 2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**62, 2**63 - 1, -(2**31), -(2**63))
NAMES = (
    "",
    " ",
    "\n",
    "two\nlines",
    "\x1b[31mred",
    "nul\0nul",
    "tab\there",
    "\x7f",
    "\r",
    "x" * 100000,
    "\u202e",
    "'\"",
)
FLOATS = (float("nan"), float("inf"), float("-inf"), 1e30, -1e30, 1e-40, 3e38, 0.0, -1.0)
CONTROL_CHARACTERS = re.compile("[\x00-\x09\x0b-\x1f\x7f]")


@dataclasses.dataclass
class Damage:
    """What was damaged. `queries`: those whose results may differ, None for any query."""

    text: str
    queries: set[str] | None
    may_fail: bool = False  # true if exit code 1 is right


class Scene:
    """Two places that share nothing: queries 0 and 1 see the first one, 2 to 4 the second; 3 and 4 are a rig."""

    def __init__(self, folder):
        self.folder = folder
        scene = synthetic.make_scene(
            synthetic.arc(8), synthetic.arc(5, radius=5, height=-0.7, phase=4), num_points=70, noise_px=0.3
        )
        names = scene.database_names
        self.place_of_name = {name: int(i >= 4) for i, name in enumerate(names)}
        self.place_of_name.update({name: int(i >= 2) for i, name in enumerate(scene.query_names)})
        for pair in list(scene.pairs):
            if self.place_of_name[pair[0]] != self.place_of_name[pair[1]]:
                del scene.pairs[pair]
        for image in scene.images.values():
            image.camera_id += 2 * self.place_of_name[image.name]
        for camera_id in (3, 4):
            scene.cameras[camera_id] = dataclasses.replace(scene.cameras[camera_id - 2], camera_id=camera_id)
        self.scene = scene
        self.name_of_id = {image.image_id: name for name, image in scene.images.items()}
        self.database_path = folder / "database.db"
        self._write_database()
        self.model_path = synthetic.write_model(folder / "model", scene)
        self.list_path = folder / "queries.txt"
        self.list_path.write_text("\n".join([*scene.query_names, f"{PHOTO} PINHOLE 160 120 150 150 80 60"]) + "\n")
        cv2.imwrite(str(folder / PHOTO), np.random.default_rng(0).integers(0, 255, (120, 160), np.uint8))

    def _write_database(self):
        connection = sqlite3.connect(self.database_path)
        connection.execute(f"PRAGMA page_size = {PAGE_SIZE}")
        connection.executescript(TABLES)
        synthetic.insert_scene(connection, self.scene)
        rng = np.random.default_rng(0)
        for image in self.scene.images.values():
            shapes = np.tile(np.float32([2, 0, 0, 2]), (len(image.keypoints), 1))
            data = np.hstack([image.keypoints, shapes]).tobytes()
            connection.execute("UPDATE keypoints SET cols = 6, data = ? WHERE image_id = ?", (data, image.image_id))
        for name in self.scene.database_names:
            descriptors = rng.integers(0, 60, (len(self.scene.images[name].keypoints), 128), np.uint8)
            values = (self.scene.images[name].image_id, *descriptors.shape, descriptors.tobytes())
            connection.execute("INSERT INTO descriptors VALUES (?, ?, ?, ?)", values)
        unverified = self.pair_id(self.scene.query_names[0], self.scene.database_names[0])
        connection.execute("DELETE FROM two_view_geometries WHERE pair_id = ?", (unverified,))
        left, right = (self.scene.images[name] for name in self.scene.query_names[3:])
        connection.execute("UPDATE images SET camera_id = 5 WHERE image_id = ?", (right.image_id,))
        connection.execute(
            "INSERT INTO cameras SELECT 5, model, width, height, params, 1 FROM cameras WHERE camera_id = 4"
        )
        right_from_left = right.pose.rotation @ left.pose.rotation.T
        x, y, z, w = synthetic.Rotation.from_matrix(right_from_left).as_quat()
        place = struct.pack("<7d", w, x, y, z, *(right.pose.tvec - right_from_left @ left.pose.tvec))
        connection.execute("INSERT INTO rigs VALUES (1, 4, 0)")
        connection.execute("INSERT INTO rig_sensors VALUES (1, 5, 0, ?)", (place,))
        connection.execute("INSERT INTO frames VALUES (1, 1)")
        connection.execute("INSERT INTO frame_data VALUES (1, ?, 4, 0), (1, ?, 5, 0)", (left.image_id, right.image_id))
        connection.commit()
        connection.close()

    def pair_id(self, name1, name2):
        return synthetic.pair_id(self.scene.images[name1].image_id, self.scene.images[name2].image_id)

    def queries_of_place(self, place):
        return {name for name in self.scene.query_names if self.place_of_name[name] == place}

    def queries_of_image(self, image_id):
        """Returns the queries that need an image: itself with its rig, or those that see its place."""
        name = self.name_of_id.get(image_id)
        if name is None:
            return set()
        if name not in self.scene.query_names:
            return self.queries_of_place(self.place_of_name[name])
        rig = self.scene.query_names[3:]
        return set(rig) if name in rig else {name}

    def queries_of_record(self, table, key):
        if table == "cameras":
            return self.queries_of_place(int(key >= 3))
        if table in ("images", "keypoints"):
            return self.queries_of_image(key)
        if table in ("matches", "two_view_geometries"):
            queries = [self.queries_of_image(image_id) for image_id in divmod(key, MAX_NUM_IMAGES)]
            return min(queries, key=len)  # the query's own, because only queries have pairs
        return set() if table == "descriptors" else set(self.scene.query_names[3:])  # rigs


def damaged_number(rng, old):
    choices = [*INTEGERS, old + 1, old - 1, None, 1.5, "text", b"blob", str(old), float(old) + 0.25]
    return rng.choice(choices)


def damaged_blob(rng, old):
    old = old or b""
    kind = rng.randrange(9)
    size = len(old)
    if kind == 0:
        return old[: rng.randrange(size + 1)]
    if kind == 1:
        return old + rng.randbytes(rng.choice((1, 4, 8, 1000)))
    if kind == 2:
        return rng.choice((None, b"", "text", 7, 1.5))
    if kind == 3:
        return rng.choice((b"\0", b"\xff", b"\x7f")) * size
    if kind == 4:
        return rng.randbytes(size)
    changed = bytearray(old)
    if kind in (5, 6) and size > 0:
        for _ in range(rng.randint(1, 8)):
            changed[rng.randrange(size)] ^= 1 << rng.randrange(8)
    elif size >= 8:
        form, width = rng.choice((("<f", 4), ("<d", 8), ("<I", 4)))
        value = rng.choice((0, 1, 2**31, 2**32 - 1)) if form == "<I" else rng.choice(FLOATS)
        for _ in range(rng.choice((1, 1, 10))):
            struct.pack_into(form, changed, width * rng.randrange(size // width), value)
    return bytes(changed)


def damaged_value(rng, column, old, connection):
    if column == "name":
        others = [name for (name,) in connection.execute("SELECT name FROM images")]
        return rng.choice([*NAMES, None, 5, b"\xff\xfe", old.upper(), old + "\n", rng.choice(others), "\udcff"])
    if isinstance(old, bytes) or old is None:
        return damaged_blob(rng, old)
    return damaged_number(rng, old)


def damage_record(rng, path, scene):
    """Changes one value of a record, or removes, doubles or moves the record."""
    connection = sqlite3.connect(path)
    table = rng.choice(DAMAGED_TABLES)
    columns = [row[1] for row in connection.execute(f"PRAGMA table_info({table})")]
    rowid = rng.choice([row[0] for row in connection.execute(f"SELECT rowid FROM {table}")])
    record = dict(zip(columns, connection.execute(f"SELECT * FROM {table} WHERE rowid = ?", (rowid,)).fetchone()))
    queries = scene.queries_of_record(table, rowid)
    column = rng.choice(columns)
    if rng.random() < 0.05:
        connection.execute(f"DELETE FROM {table} WHERE rowid = ?", (rowid,))
        damage = Damage(f"{table} {rowid}: deleted", queries, may_fail=table == "images")
    elif column == columns[0] and table in KEYED_TABLES:
        keys = [row[0] for row in connection.execute(f"SELECT {column} FROM {table}")]
        key = rng.choice([rng.choice(keys), rowid + 1, rowid + MAX_NUM_IMAGES, *INTEGERS])
        if key != rowid:
            connection.execute(f"DELETE FROM {table} WHERE {column} = ?", (key,))
        connection.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = ?", (key, rowid))
        queries = queries | scene.queries_of_record(table, key)
        damage = Damage(f"{table} {rowid}: {column} is now {key}", queries, may_fail=table == "images")
    elif {"rows", "cols"} <= record.keys() and rng.random() < 0.1:
        connection.execute(f"UPDATE {table} SET rows = cols, cols = rows WHERE rowid = ?", (rowid,))
        damage = Damage(f"{table} {rowid}: rows and cols exchanged", queries)
    else:
        damage = damage_value(rng, connection, scene, table, rowid, column, record[column], queries)
    connection.commit()
    connection.close()
    return damage


def damage_value(rng, connection, scene, table, rowid, column, old, queries):
    value = damaged_value(rng, column, old, connection)
    if isinstance(value, str) and "\udcff" in value:
        connection.execute(f"UPDATE {table} SET {column} = CAST(x'66ff67' AS TEXT) WHERE rowid = ?", (rowid,))
    else:
        connection.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = ?", (value, rowid))
    if column == "name" and isinstance(value, str):
        for image_id, name in scene.name_of_id.items():
            queries = queries | (scene.queries_of_image(image_id) if name == value else set())
    if column == "data_id" and isinstance(value, int):
        queries = queries | scene.queries_of_image(value)
    return Damage(f"{table} {rowid}: {column} is now {value!r:.60}", queries, may_fail=column == "name")


def damage_pages(rng, path):
    """Changes bytes of the file, as a disk may."""
    content = bytearray(path.read_bytes())
    page = rng.randrange(len(content) // PAGE_SIZE)
    size = rng.choice((1, 1, 2, 8, 100, PAGE_SIZE))
    # The beginning of a page says what is where in it.
    begin = rng.choice((rng.randrange(16), rng.randrange(100), rng.randrange(PAGE_SIZE)))
    begin = page * PAGE_SIZE + min(begin, PAGE_SIZE - size)
    content[begin : begin + size] = rng.choice((bytes(size), b"\xff" * size, rng.randbytes(size)))
    path.write_bytes(content)
    return Damage(f"{size} bytes from {begin - page * PAGE_SIZE} on in page {page}", None, may_fail=True)


def lines_by_name(path):
    results = [json.loads(line) for line in (path / "results.jsonl").read_text().splitlines()]
    for result in results:
        del result["seconds"]
    return {result["name"]: result for result in results}


def messages_of(done):
    """Returns the lines of the standard error output but for how photos are extracted and the summary."""
    lines = split_summary(done.stderr)[0].splitlines()
    return [line for line in lines if not line.startswith("photos of ")]


def problem_of(done, damage, output_path, good):
    """Returns what is wrong with a run; empty if nothing is. `good`: the results without damage, by name."""
    allowed = (0, 1) if damage.may_fail else (0,)
    if done.returncode not in allowed:
        return f"exit code {done.returncode}: {done.stderr[-2000:]}"
    lines = messages_of(done)
    num_errors = sum(line.startswith("ERROR: ") for line in lines)
    if CONTROL_CHARACTERS.search(done.stderr) or num_errors != done.returncode:
        return f"not one line of error: {done.stderr!r:.2000}"
    if any(not line.startswith(("ERROR: ", "WARNING: ")) for line in lines):
        return f"other output: {done.stderr!r:.2000}"
    if done.returncode == 1:
        return "output although the run failed" if output_path.exists() else ""
    results = lines_by_name(output_path)
    for name, result in results.items():
        if result["status"] == "DAMAGED_DATA" and "table " not in result["reason"]:
            return f"{name}: the reason names no record: {result['reason']}"
        if CONTROL_CHARACTERS.search(result["reason"]):
            return f"{name}: control characters in the reason: {result['reason']!r}"
    if damage.queries is None:
        return ""
    for name in set(good) - damage.queries - {PHOTO}:
        if results.get(name) != good[name]:
            return f"{name} differs: {results.get(name)}"
    return ""


class Fuzzer:
    def __init__(self, colmap, folder):
        self.colmap = colmap
        self.scene = Scene(folder)
        done = self.run(self.scene.database_path, folder / "good", self.photo_arguments(folder, has_index=False))
        assert (done.returncode, messages_of(done)) == (0, []), done.stderr
        self.good = lines_by_name(folder / "good")
        statuses = {result["status"] for name, result in self.good.items() if name != PHOTO}
        assert statuses == {"LOCALIZED"} and self.good[PHOTO]["status"] == "TOO_FEW_INLIERS", self.good

    def run(self, database_path, output_path, arguments):
        command = [self.colmap, "lazy_localizer", "--database_path", database_path, "--input_path"]
        command += [self.scene.model_path, "--output_path", output_path, "--LazyLocalizer.num_threads", 1, *arguments]
        return subprocess.run(
            list(map(str, command)), capture_output=True, text=True, errors="replace", timeout=MAX_SECONDS
        )

    def photo_arguments(self, folder, has_index):
        """Returns the options for a list with a photo, which is compared with all database images."""
        arguments = ["--query_list_path", self.scene.list_path, "--image_path", self.scene.folder]
        return [*arguments, "--retrieval_index_path", folder / "index"] if has_index else arguments

    def check(self, seed, keep=None):
        """Returns what is wrong with the run of a seed; empty if nothing is."""
        rng = random.Random(seed)
        with tempfile.TemporaryDirectory(dir=self.scene.folder) as name:
            folder = pathlib.Path(name)
            path = shutil.copy(self.scene.database_path, folder / "database.db")
            damage = damage_pages(rng, path) if rng.random() < 0.2 else damage_record(rng, path, self.scene)
            has_list, has_index = rng.random() < 0.25, rng.random() < 0.5
            arguments = self.photo_arguments(folder, has_index) if has_list else []
            if has_list and rng.random() < 0.5:
                arguments += ["--SiftExtraction.max_num_features", -1, "--SiftExtraction.first_octave", -2]
            try:
                done = self.run(path, folder / "out", arguments)
                problem = problem_of(done, damage, folder / "out", self.good)
            except subprocess.TimeoutExpired:
                problem = "timeout"
            if problem and keep:
                shutil.copytree(folder, pathlib.Path(keep) / str(seed), dirs_exist_ok=True)
        return problem and f"seed {seed}, {damage.text}: {problem}"


def run_seeds(colmap, folder, seeds, num_jobs, keep=None):
    """Returns what is wrong, one line per seed."""
    fuzzer = Fuzzer(colmap, pathlib.Path(folder))
    with concurrent.futures.ThreadPoolExecutor(num_jobs) as pool:
        return [problem for problem in pool.map(lambda seed: fuzzer.check(seed, keep), seeds) if problem]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("colmap")
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 2000), metavar=("FROM", "TO"))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--keep", help="folder for the databases of seeds that fail")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        problems = run_seeds(arguments.colmap, folder, range(*arguments.seeds), arguments.jobs, arguments.keep)
    print("\n".join(problems) or f"nothing is wrong with seeds {arguments.seeds[0]} to {arguments.seeds[1] - 1}")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
