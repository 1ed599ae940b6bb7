"""Makes small synthetic scenes with known poses; writes them as COLMAP databases of any version and as COLMAP models.

Poses are cam_from_world. Pixels follow COLMAP's convention (the centre of the upper-left pixel is at 0.5, 0.5).
"""

import copy
import dataclasses
import pathlib
import sqlite3
from collections.abc import Callable, Iterable

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from colmap_lazyloc import model
from colmap_lazyloc.array_types import Array, Floats
from colmap_lazyloc.database import pair_id
from colmap_lazyloc.poses import Pose, look_at
from colmap_lazyloc.program import run_colmap
from colmap_lazyloc.text_files import Path

CALIBRATED, PANORAMIC = 2, 5  # COLMAP's configurations of a two-view geometry

# Scenes

ModelCamera = model.Camera  # a name that the field `model` does not hide


@dataclasses.dataclass
class Camera:
    camera_id: int
    model: str
    width: int
    height: int
    params: list[float]
    has_prior_focal_length: bool = True

    def image_from_cam(self, points_in_cam: Floats) -> Floats:
        """Returns the pixels, n x 2, of n x 3 points in front of the camera."""
        xy = points_in_cam[:, :2] / points_in_cam[:, 2:]
        if self.model == "SIMPLE_RADIAL":
            xy = xy * (1 + self.params[3] * np.sum(xy**2, axis=1, keepdims=True))
        focal = self.params[:2] if self.model == "PINHOLE" else self.params[:1]
        centre = self.params[2:4] if self.model == "PINHOLE" else self.params[1:3]
        return xy * focal + centre

    def is_in_front(self, points_in_cam: Floats) -> Array:
        return points_in_cam[:, 2] > 0.1

    def intrinsics(self) -> ModelCamera:
        return model.Camera(self.model, self.width, self.height, tuple(self.params))


def looking_at(cam_in_world: Floats, target: ArrayLike, roll_deg: float = 0.0) -> Pose:
    """Returns the pose of a camera in a world whose y axis points down."""
    return Pose.from_centre(look_at(cam_in_world, target, (0, 1, 0), roll_deg), cam_in_world)


@dataclasses.dataclass
class Image:
    name: str
    image_id: int
    camera_id: int
    pose: Pose
    keypoints: Array  # float32, one row per keypoint
    point_of_keypoint: Array  # index of the scene point, -1 for none


@dataclasses.dataclass
class Pair:
    """Two images with matches; their relative pose is cam2_from_cam1, in the order of their names in Scene.pairs."""

    matches: Array
    inlier_matches: Array
    rotation: Rotation
    direction: Array
    config: int = CALIBRATED

    def essential_matrix(self) -> Floats:
        x, y, z = self.direction
        essential: Floats = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ self.rotation.as_matrix()
        return essential

    def inverted(self) -> "Pair":
        """Returns the pair with its images exchanged, as COLMAP stores it if the second image has the smaller id."""
        inverse = self.rotation.inv()
        return Pair(
            self.matches[:, ::-1], self.inlier_matches[:, ::-1], inverse, -inverse.apply(self.direction), self.config
        )


@dataclasses.dataclass
class Scene:
    cameras: dict[int, Camera]
    images: dict[str, Image]
    pairs: dict[tuple[str, str], Pair]
    query_names: list[str]
    points: Array | None = None  # n x 3, by the indices of Image.point_of_keypoint

    @property
    def database_names(self) -> list[str]:
        return sorted(set(self.images) - set(self.query_names))

    def copy(self) -> "Scene":
        return copy.deepcopy(self)

    def with_image_ids(self, ids: Iterable[int]) -> "Scene":
        """Returns a copy in which the images have other ids, given in the order of the images."""
        renumbered = self.copy()
        for image, image_id in zip(renumbered.images.values(), ids, strict=True):
            image.image_id = int(image_id)
        return renumbered


def split_tracks(scene: Scene) -> None:
    """Keeps each scene point's matches with one database image only, so that no track has two of them."""
    places = {name: place for place, name in enumerate(scene.database_names)}
    for (name1, _), pair in scene.pairs.items():
        points = scene.images[name1].point_of_keypoint[pair.inlier_matches[:, 0]]
        pair.inlier_matches = pair.matches = pair.inlier_matches[points % len(places) == places[name1]]


def arc(num: int, radius: float = 6.0, height: float = 1.0, phase: float = 0.0) -> Floats:
    """Returns projection centres, n x 3, on a waving arc of 80 degrees about the origin."""
    angles = np.radians(np.linspace(-40, 40, num) + phase)
    return np.stack([radius * np.sin(angles), height * np.sin(5 * angles), -radius * np.cos(angles)], axis=1)


def make_scene(
    database_centres: Iterable[ArrayLike],
    query_centres: Iterable[ArrayLike],
    noise_px: float = 0.0,
    outlier_ratio: float = 0.0,
    num_points: int = 240,
    visible_ratio: float = 0.7,
    seed: int = 0,
    database_pairs: bool = False,
    is_planar: bool = False,
) -> Scene:
    """Makes cameras that look at points in a cube of 3 units around the origin, or in an inclined square in it.

    Each query is matched with each database image; with database_pairs, each image is matched with each other. Only
    the raw matches have outliers.
    """
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.5, 1.5, (num_points, 3))
    if is_planar:
        points[:, 2] = 0.4 * points[:, 0] + 0.2 * points[:, 1]
    cameras = {
        1: Camera(1, "SIMPLE_RADIAL", 640, 480, [520.0, 320.0, 240.0, -0.05]),
        2: Camera(2, "PINHOLE", 600, 500, [480.0, 490.0, 301.5, 248.5]),
    }
    scene = Scene(cameras, {}, {}, [], points)
    for is_query, centres in ((False, database_centres), (True, query_centres)):
        for i, centre in enumerate(centres):
            name = f"query/{i:03d}.jpg" if is_query else f"database/{i:03d}.jpg"
            pose = looking_at(np.asarray(centre, float), rng.uniform(-0.3, 0.3, 3), rng.uniform(-8, 8))
            camera_id = 2 if is_query else 1
            keypoints, owners = observe(cameras[camera_id], pose, points, noise_px, visible_ratio, rng)
            scene.images[name] = Image(name, len(scene.images) + 1, camera_id, pose, keypoints, owners)
            if is_query:
                scene.query_names.append(name)
    names = list(scene.images)
    for i, name1 in enumerate(names):
        for name2 in names[i + 1 :]:
            if database_pairs or (name1 not in scene.query_names and name2 in scene.query_names):
                scene.pairs[name1, name2] = match(scene.images[name1], scene.images[name2], outlier_ratio, rng)
    return scene


def observe(
    camera: Camera, pose: Pose, points: Floats, noise_px: float, visible_ratio: float, rng: Generator
) -> tuple[Array, Array]:
    points_in_cam = pose(points)
    xy = camera.image_from_cam(points_in_cam) + rng.normal(0, noise_px, (len(points), 2))
    is_inside = np.all((xy >= 0) & (xy <= [camera.width, camera.height]), axis=1) & camera.is_in_front(points_in_cam)
    visible = rng.permutation(np.flatnonzero(is_inside & (rng.random(len(points)) < visible_ratio)))
    num_distractors = 20
    distractors = rng.uniform(0, [camera.width, camera.height], (num_distractors, 2))
    keypoints = np.concatenate([xy[visible], distractors]).astype(np.float32)
    owners = np.concatenate([visible, np.full(num_distractors, -1)])
    order = rng.permutation(len(owners))
    return keypoints[order], owners[order]


def match(image1: Image, image2: Image, outlier_ratio: float, rng: Generator) -> Pair:
    keypoint2 = {int(point): j for j, point in enumerate(image2.point_of_keypoint) if point >= 0}
    pairs = [(i, keypoint2[int(point)]) for i, point in enumerate(image1.point_of_keypoint) if int(point) in keypoint2]
    inliers = np.array(pairs, dtype=np.uint32).reshape(-1, 2)
    num_outliers = int(outlier_ratio * len(inliers))
    outliers = np.stack(
        [rng.choice(len(image.keypoints), num_outliers, replace=False) for image in (image1, image2)], axis=1
    ).astype(np.uint32)
    matches = rng.permutation(np.concatenate([inliers, outliers]), axis=0)
    rotation = Rotation.from_matrix(image2.pose.rotation @ image1.pose.rotation.T)
    translation = image2.pose.tvec - rotation.apply(image1.pose.tvec)
    length = np.linalg.norm(translation)
    if length < 1e-9:
        return Pair(matches, inliers, rotation, np.zeros(3), PANORAMIC)
    return Pair(matches, inliers, rotation, translation / length)


# Databases

_COMMON_TABLES = """
CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, model INTEGER NOT NULL,
    width INTEGER NOT NULL, height INTEGER NOT NULL, params BLOB, prior_focal_length INTEGER NOT NULL);
CREATE TABLE images (image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, name TEXT NOT NULL UNIQUE,
    camera_id INTEGER NOT NULL, {priors}
    CONSTRAINT image_id_check CHECK(image_id >= 0 and image_id < 2147483647),
    FOREIGN KEY(camera_id) REFERENCES cameras(camera_id));
CREATE UNIQUE INDEX index_name ON images(name);
CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL,
    data BLOB, FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE descriptors (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL,
    data BLOB, FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE matches (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB);
CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL,
    cols INTEGER NOT NULL, data BLOB, config INTEGER NOT NULL, F BLOB, E BLOB, H BLOB {poses});
"""
_PRIORS = "prior_qw REAL, prior_qx REAL, prior_qy REAL, prior_qz REAL, prior_tx REAL, prior_ty REAL, prior_tz REAL,"
_POSES = ", qvec BLOB, tvec BLOB"
_POSE_PRIORS = """
CREATE TABLE pose_priors (image_id INTEGER PRIMARY KEY NOT NULL, position BLOB, coordinate_system INTEGER NOT NULL,
    FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
"""
SCHEMAS = {
    "3.6": _COMMON_TABLES.format(priors=_PRIORS, poses="") + "PRAGMA user_version = 3600;",
    "3.8": _COMMON_TABLES.format(priors=_PRIORS, poses=_POSES) + "PRAGMA user_version = 3800;",
    "3.10": _COMMON_TABLES.format(priors="", poses=_POSES) + _POSE_PRIORS + "PRAGMA user_version = 3900;",
}


def write_database(path: Path, scene: Scene, schema: str = "3.10", geometry: str | None = "pose") -> pathlib.Path:
    """Writes a database. geometry: "pose", "essential" (a matrix but no pose), or None for raw matches only."""
    connection = sqlite3.connect(path)
    connection.executescript(SCHEMAS[schema])
    insert_scene(connection, scene, geometry)
    connection.close()
    return pathlib.Path(path)


def write_built_colmap_database(path: Path, scene: Scene, colmap: Path, geometry: str | None = "pose") -> pathlib.Path:
    """Writes a database that the program under test has created, so that it has the schema of its COLMAP."""
    run_colmap(colmap, "database_creator", "--database_path", path)
    connection = sqlite3.connect(path)
    insert_scene(connection, scene, geometry)
    connection.close()
    return pathlib.Path(path)


def insert_scene(connection: sqlite3.Connection, scene: Scene, geometry: str | None = "pose") -> None:
    """Fills the tables of any 3.x schema; omits values for which the schema has no column."""
    for camera in scene.cameras.values():
        params = np.array(camera.params, "<f8").tobytes()
        insert(
            connection,
            "cameras",
            camera_id=camera.camera_id,
            model=model.CAMERA_MODEL_IDS[camera.model],
            width=camera.width,
            height=camera.height,
            params=params,
            prior_focal_length=int(camera.has_prior_focal_length),
        )
    for image in scene.images.values():
        insert(connection, "images", image_id=image.image_id, name=image.name, camera_id=image.camera_id)
        insert(connection, "keypoints", image_id=image.image_id, **_columns(image.keypoints, "<f4"))
    for (name1, name2), pair in scene.pairs.items():
        id1, id2 = scene.images[name1].image_id, scene.images[name2].image_id
        stored = pair if id1 < id2 else pair.inverted()
        insert(connection, "matches", pair_id=pair_id(id1, id2), **_columns(stored.matches, "<u4"))
        if geometry is not None:
            insert(
                connection,
                "two_view_geometries",
                pair_id=pair_id(id1, id2),
                config=stored.config,
                **_columns(stored.inlier_matches, "<u4"),
                **_geometry_columns(stored, geometry),
            )
    connection.commit()


def _columns(rows: Array, dtype: str) -> dict[str, object]:
    return {"rows": len(rows), "cols": rows.shape[1], "data": np.ascontiguousarray(rows, dtype).tobytes()}


def _geometry_columns(pair: Pair, geometry: str) -> dict[str, bytes]:
    """Returns a geometry as COLMAP 3 stores it: zeros for a missing matrix, the identity for a missing pose."""
    x, y, z, w = pair.rotation.as_quat() if geometry == "pose" else [0, 0, 0, 1]
    tvec = pair.direction if geometry == "pose" else np.zeros(3)
    columns = {
        "F": np.zeros(9),
        "E": pair.essential_matrix().ravel(),
        "H": np.zeros(9),
        "qvec": np.array([w, x, y, z]),
        "tvec": tvec,
    }
    return {name: numbers.astype("<f8").tobytes() for name, numbers in columns.items()}


def insert(connection: sqlite3.Connection, table: str, **values: object) -> None:
    known = {row[1] for row in connection.execute(f"PRAGMA table_info({table})")}
    values = {column: value for column, value in values.items() if column in known}
    placeholders = ", ".join("?" * len(values))
    connection.execute(f"INSERT INTO {table} ({', '.join(values)}) VALUES ({placeholders})", list(values.values()))


# Models


def stored_images(scene: Scene, names: Iterable[str]) -> list[model.Image]:
    return [
        model.Image(image.name, image.camera_id, image.pose, image.image_id)
        for image in (scene.images[name] for name in names)
    ]


def write_depth_maps(
    folder: Path,
    scene: Scene,
    disturb: Callable[[Array, Generator], Array] = lambda depths, rng: depths,
    names: Iterable[str] | None = None,
    seed: int = 0,
) -> pathlib.Path:
    """Writes NAME.npy with the depths at each image's keypoints, unknown elsewhere. disturb: changes the depths."""
    assert scene.points is not None
    folder, points, rng = pathlib.Path(folder), scene.points, np.random.default_rng(seed)
    for name in scene.database_names if names is None else names:
        image, camera = scene.images[name], scene.cameras[scene.images[name].camera_id]
        is_point = image.point_of_keypoint >= 0
        depths = np.full((camera.height, camera.width), np.nan, np.float32)
        column, row = np.floor(image.keypoints[is_point]).astype(int).T
        depths[row, column] = disturb(image.pose(points[image.point_of_keypoint[is_point]])[:, 2], rng)
        path = folder / f"{name}.npy"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, depths)
    return folder


def write_model(path: Path, scene: Scene, names: Iterable[str] | None = None, binary: bool = True) -> pathlib.Path:
    """Writes a COLMAP model without points. names: its images; default: all database images."""
    cameras = {camera.camera_id: camera.intrinsics() for camera in scene.cameras.values()}
    images = stored_images(scene, scene.database_names if names is None else names)
    return model.write_model(path, cameras, images, binary)
