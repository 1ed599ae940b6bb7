"""Reads COLMAP databases without writing to them, and removes images from copies."""

import contextlib
import pathlib
import sqlite3
import struct
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from colmap_lazyloc.array_types import Array
from colmap_lazyloc.model import CAMERA_MODEL_IDS, CAMERA_MODELS, Camera
from colmap_lazyloc.text_files import Path

CAMERA_SENSOR = 0  # COLMAP's type of a sensor
MAX_NUM_IMAGES = 2147483647  # COLMAP's constant, from which pair ids are computed


def pair_id(image_id1: int, image_id2: int) -> int:
    """Returns COLMAP's id of a pair of images; their order does not matter."""
    return min(image_id1, image_id2) * MAX_NUM_IMAGES + max(image_id1, image_id2)


def connect(path: Path, mode: str = "ro", is_immutable: bool = False) -> sqlite3.Connection:
    """Opens a database in SQLite's mode "ro", "rw" or "rwc"; immutable: as a file that no program changes meanwhile."""
    uri = pathlib.Path(path).resolve().as_uri()
    return sqlite3.connect(f"{uri}?mode={mode}{'&immutable=1' if is_immutable else ''}", uri=True)


def remove_images(connection: sqlite3.Connection, image_ids: Iterable[int]) -> None:
    """Removes images with their features and matches; rigs and frames stay."""
    connection.execute("CREATE TEMP TABLE removed (image_id INTEGER PRIMARY KEY)")
    connection.executemany("INSERT INTO removed VALUES (?)", ((image_id,) for image_id in image_ids))
    for table in ("matches", "two_view_geometries"):
        connection.execute(
            f"DELETE FROM {table} WHERE pair_id / {MAX_NUM_IMAGES} IN removed OR pair_id % {MAX_NUM_IMAGES} IN removed"
        )
    for table in ("keypoints", "descriptors", "images"):
        connection.execute(f"DELETE FROM {table} WHERE image_id IN removed")
    connection.execute("DROP TABLE removed")


def add_images(path: pathlib.Path, cameras: Mapping[str, Camera]) -> None:
    """Adds images and their cameras, numbered in the order of the names; images that are there stay as they are.

    COLMAP numbers images in the order in which its threads finish them, if it adds them itself.
    """
    camera_ids: dict[Camera, int] = {}
    rig_ids: dict[Camera, int] = {}
    with contextlib.closing(connect(path, "rw")) as connection, connection:
        known = {name for (name,) in connection.execute("SELECT name FROM images")}
        # In databases of COLMAP 4, each image needs a frame, and each camera a rig.
        has_frames = bool(connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'frame_data'").fetchall())
        for name in sorted(cameras.keys() - known):
            camera = cameras[name]
            if camera not in camera_ids:
                params = struct.pack(f"<{len(camera.params)}d", *camera.params)
                values = CAMERA_MODEL_IDS[camera.model], camera.width, camera.height, params
                camera_ids[camera] = _insert(connection, "cameras", _CAMERA_COLUMNS, (*values, 1))
                if has_frames:
                    rig_ids[camera] = _insert(connection, "rigs", _RIG_COLUMNS, (camera_ids[camera], CAMERA_SENSOR))
            image_id = _insert(connection, "images", ("name", "camera_id"), (name, camera_ids[camera]))
            if has_frames:
                frame_id = _insert(connection, "frames", ("rig_id",), (rig_ids[camera],))
                data = frame_id, image_id, camera_ids[camera], CAMERA_SENSOR
                _insert(connection, "frame_data", _FRAME_DATA_COLUMNS, data)


def set_cameras(path: pathlib.Path, cameras: Mapping[str, Camera]) -> None:
    """Gives images by name the intrinsics of a camera, in place of those that they have."""
    with contextlib.closing(connect(path, "rw")) as connection, connection:
        for name, camera in cameras.items():
            values = CAMERA_MODEL_IDS[camera.model], struct.pack(f"<{len(camera.params)}d", *camera.params)
            connection.execute(
                "UPDATE cameras SET model = ?, params = ? WHERE camera_id = "
                "(SELECT camera_id FROM images WHERE name = ?)",
                (*values, name),
            )


def copy_database(source: pathlib.Path, target: pathlib.Path) -> None:
    """Copies a database, with what its write-ahead log still holds."""
    with contextlib.closing(connect(source)) as database, contextlib.closing(connect(target, "rwc")) as copy:
        database.backup(copy)


def remove_matches(path: pathlib.Path) -> None:
    """Removes the matches of all images, and the geometries of their pairs."""
    with contextlib.closing(connect(path, "rw")) as connection, connection:
        for table in ("matches", "two_view_geometries"):
            connection.execute(f"DELETE FROM {table}")


def remove_features(path: pathlib.Path) -> None:
    """Removes the features of all images, and their matches."""
    remove_matches(path)
    with contextlib.closing(connect(path, "rw")) as connection, connection:
        for table in ("keypoints", "descriptors"):
            connection.execute(f"DELETE FROM {table}")


def tidy_images(path: pathlib.Path) -> None:
    """Removes images without keypoints, and numbers the others in the order of their names.

    COLMAP's retrieval fails if an image has no keypoints, because its photo could not be used. It numbers the images
    that it adds in the order in which its threads finish them: another one each time. Images whose number changes must
    not have matches.
    """
    with contextlib.closing(connect(path, "rw")) as connection, connection:
        without = connection.execute("SELECT image_id FROM images EXCEPT SELECT image_id FROM keypoints").fetchall()
        remove_images(connection, [image_id for (image_id,) in without])
        tables = [table for (table,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        if "frame_data" in tables:
            ids = f"sensor_type = {CAMERA_SENSOR} AND data_id NOT IN (SELECT image_id FROM images)"
            connection.execute(f"DELETE FROM frame_data WHERE {ids}")
            connection.execute("DELETE FROM frames WHERE frame_id NOT IN (SELECT frame_id FROM frame_data)")
        _number_images(connection, tables)


def _number_images(connection: sqlite3.Connection, tables: Sequence[str]) -> None:
    """Numbers images in the order of their names."""
    ids = [image_id for (image_id,) in connection.execute("SELECT image_id FROM images ORDER BY name")]
    connection.execute("CREATE TEMP TABLE numbers (old INTEGER PRIMARY KEY, new)")
    connection.executemany("INSERT INTO numbers VALUES (?, ?)", zip(ids, range(1, len(ids) + 1)))
    connection.execute("DELETE FROM numbers WHERE old = new")
    for table in tables:
        columns = {row[1] for row in connection.execute(f"PRAGMA table_info({table})")}
        for column in _IMAGE_ID_COLUMNS.keys() & columns:
            # Goes through numbers that no image has, because ids are unique at every moment.
            number = f"(SELECT new FROM numbers WHERE old = {table}.{column})"
            rows = f"{_IMAGE_ID_COLUMNS[column]} AND {column} IN (SELECT old FROM numbers)"
            connection.execute(f"UPDATE {table} SET {column} = {_UNUSED} + {number} WHERE {rows}")
            rows = f"{_IMAGE_ID_COLUMNS[column]} AND {column} > {_UNUSED}"
            connection.execute(f"UPDATE {table} SET {column} = {column} - {_UNUSED} WHERE {rows}")
    connection.execute("DROP TABLE numbers")


# The columns that hold ids of images, in the tables of COLMAP 3 and of COLMAP 4, and the rows for which they do.
_IMAGE_ID_COLUMNS = {
    "image_id": "TRUE",
    "data_id": f"sensor_type = {CAMERA_SENSOR}",
    "corr_data_id": f"corr_sensor_type = {CAMERA_SENSOR}",
}
_UNUSED = MAX_NUM_IMAGES // 2
_CAMERA_COLUMNS = ("model", "width", "height", "params", "prior_focal_length")
_RIG_COLUMNS = ("ref_sensor_id", "ref_sensor_type")
_FRAME_DATA_COLUMNS = ("frame_id", "data_id", "sensor_id", "sensor_type")


def _insert(connection: sqlite3.Connection, table: str, columns: Sequence[str], values: Sequence[object]) -> int:
    """Inserts a row and returns its id."""
    places = ", ".join("?" * len(values))
    row = connection.execute(f"INSERT INTO {table} ({', '.join(columns)}) VALUES ({places})", values)
    return int(row.lastrowid or 0)


class DatabaseReader:
    """Reads keypoints and verified matches by image name; use it in a `with` statement."""

    def __init__(self, path: pathlib.Path | str):
        self.path = pathlib.Path(path)
        # Take the file as immutable if it has no write-ahead log, because SQLite makes one otherwise, even for reading.
        has_log = pathlib.Path(f"{path}-wal").exists()
        self._connection = connect(path, is_immutable=not has_log)
        self._connection.text_factory = lambda name: name.decode(errors="backslashreplace")
        self.image_ids: dict[str, int] = dict(self._connection.execute("SELECT name, image_id FROM images"))
        rows = self._connection.execute("SELECT pair_id, rows FROM two_view_geometries WHERE rows > 0")
        self._num_inliers: dict[int, int] = dict(rows)

    def __enter__(self) -> "DatabaseReader":
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    def num_inliers(self, name1: str, name2: str) -> int:
        """Returns the number of verified matches of two images."""
        return self._num_inliers.get(self._pair_id(name1, name2), 0)

    def verified_pairs(self, min_num_inliers: int) -> list[tuple[str, str]]:
        """Returns the names of the images of pairs with at least a number of verified matches."""
        return self._names_of_pairs(pair for pair, count in self._num_inliers.items() if count >= min_num_inliers)

    def matched_pairs(self) -> list[tuple[str, str]]:
        """Returns the names of the images of pairs with matches before verification."""
        rows = self._connection.execute("SELECT pair_id FROM matches WHERE rows > 0 ORDER BY pair_id")
        return self._names_of_pairs(pair for (pair,) in rows)

    def _names_of_pairs(self, pair_ids: Iterable[int]) -> list[tuple[str, str]]:
        names = {image_id: name for name, image_id in self.image_ids.items()}
        pairs = (divmod(pair, MAX_NUM_IMAGES) for pair in pair_ids)
        return [(names[first], names[second]) for first, second in pairs if first in names and second in names]

    def has_keypoints(self, name: str) -> bool:
        """True if features of the image were extracted, even if none were found."""
        query = "SELECT 1 FROM keypoints JOIN images USING (image_id) WHERE name = ?"
        return self._connection.execute(query, (name,)).fetchone() is not None

    def num_descriptors(self) -> int:
        """Returns the number of descriptors of all images."""
        (num_descriptors,) = self._connection.execute("SELECT SUM(rows) FROM descriptors").fetchone()
        return int(num_descriptors or 0)

    def keypoints(self, name: str) -> Array:
        """Returns the keypoints' x and y in pixels, n x 2."""
        query = "SELECT rows, cols, data FROM keypoints WHERE image_id = ?"
        row = self._connection.execute(query, (self.image_ids[name],)).fetchone()
        if row is None or row[0] == 0:
            return np.empty((0, 2))
        return np.frombuffer(row[2], dtype=np.float32).reshape(row[0], row[1])[:, :2].astype(np.float64)

    def camera(self, name: str) -> Camera | None:
        """Returns the intrinsics of an image; None if the camera's model is unknown here."""
        query = "SELECT model, width, height, params FROM cameras WHERE camera_id = "
        query += "(SELECT camera_id FROM images WHERE image_id = ?)"
        row = self._connection.execute(query, (self.image_ids[name],)).fetchone()
        if row is None or not 0 <= row[0] < len(CAMERA_MODELS):
            return None
        model, num_params = CAMERA_MODELS[row[0]]
        params = np.frombuffer(row[3] or b"", "<f8")
        return Camera(model, row[1], row[2], tuple(params.tolist())) if len(params) == num_params else None

    def frames(self) -> list[list[str]]:
        """Returns the names of the images of each frame of a rig; none in databases that have no rigs."""
        tables = self._connection.execute("SELECT name FROM sqlite_master WHERE name = 'frame_data'").fetchall()
        frames: dict[int, list[str]] = {}
        names = {image_id: name for name, image_id in self.image_ids.items()}
        rows = self._connection.execute("SELECT frame_id, data_id, sensor_type FROM frame_data") if tables else ()
        for frame_id, data_id, sensor_type in rows:
            if sensor_type == CAMERA_SENSOR and data_id in names:
                frames.setdefault(frame_id, []).append(names[data_id])
        return [sorted(frame) for frame in frames.values()]

    def inlier_matches(self, name1: str, name2: str) -> Array:
        """Returns the verified matches, m x 2: keypoint index in the first image and in the second image."""
        return self._read_matches("two_view_geometries", name1, name2)

    def raw_matches(self, name1: str, name2: str) -> Array:
        """Returns the matches before verification, m x 2, as `inlier_matches` does."""
        return self._read_matches("matches", name1, name2)

    def _read_matches(self, table: str, name1: str, name2: str) -> Array:
        query = f"SELECT rows, data FROM {table} WHERE pair_id = ? AND rows > 0"
        row = self._connection.execute(query, (self._pair_id(name1, name2),)).fetchone()
        if row is None:
            return np.empty((0, 2), dtype=np.int64)
        matches = np.frombuffer(row[1], dtype=np.uint32).reshape(row[0], 2).astype(np.int64)
        return matches if self.image_ids[name1] < self.image_ids[name2] else matches[:, ::-1]

    def _pair_id(self, name1: str, name2: str) -> int:
        return pair_id(self.image_ids[name1], self.image_ids[name2])
