"""Scenes whose queries are photos: features and matches by our own colmap, in a work folder; the scene is only read."""

import dataclasses
import hashlib
import json
import os
import pathlib
import shutil
import sqlite3
import subprocess
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "localization"))

from geometry import pose_errors, Pose  # noqa: E402
from matches import MAX_NUM_IMAGES  # noqa: E402
from scenes import camera_text, load_scene, Scene  # noqa: E402

QUERY_STEP = 4


@dataclasses.dataclass(frozen=True)
class Run:
    """Of colmap lazy_localizer: records of results.jsonl by query."""

    records: dict[str, dict]

    def errors(self, scene: Scene) -> dict[str, tuple[float, float]]:
        """Position error in the scene's unit, rotation error in degrees; infinite where there is no pose."""
        errors = {}
        for name, record in self.records.items():
            errors[name] = (np.inf, np.inf)
            if pose := record["cam_from_world"]:
                errors[name] = pose_errors(Pose.from_qvec_tvec(pose["qvec"], pose["tvec"]), scene.true_pose(name))
        return errors

    def stage_seconds(self) -> dict[str, list[float]]:
        stages: dict[str, list[float]] = {}
        for record in self.records.values():
            for stage, seconds in record["seconds"].items():
                stages.setdefault(stage, []).append(seconds)
        return stages


@dataclasses.dataclass(frozen=True)
class Fold:
    """Every fourth image is a query, from the image `first` on; the others are the database."""

    scene: Scene
    work_path: pathlib.Path
    query_names: list[str]
    database_names: list[str]
    colmap: pathlib.Path

    # With the verified matches of all queries with all database images.
    matched_path = property(lambda self: self.work_path / "matched.db")
    # Without the queries.
    photo_path = property(lambda self: self.work_path / "photo.db")
    index_path = property(lambda self: self.work_path / "photo.index")
    query_list_path = property(lambda self: self.work_path / "queries.txt")

    def localize(self, database_path: pathlib.Path, tag: str, *options) -> Run:
        output_path = self.work_path / tag
        run_colmap(self.colmap, "lazy_localizer", "--database_path", database_path, "--output_path", output_path,
                   "--input_path", self.scene.model_path, "--query_list_path", self.query_list_path, *options)
        lines = (output_path / "results.jsonl").read_text().splitlines()
        return Run({record["name"]: record for record in map(json.loads, lines)})

    def localize_photos(self, tag: str, *options) -> Run:
        return self.localize(self.photo_path, tag, "--image_path", self.scene.path / "images",
                             "--retrieval_index_path", self.index_path, *options)


def run_colmap(colmap: pathlib.Path, *arguments):
    done = subprocess.run(list(map(str, [colmap, *arguments])), capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(f"colmap {arguments[0]} failed:\n{done.stderr[-2000:]}")
    return done.stdout


def gpu_option(colmap: pathlib.Path, command: str):
    script = pathlib.Path(__file__).parents[2] / "scripts" / "gpu_option.sh"
    return subprocess.check_output([script, command], env={**os.environ, "COLMAP": str(colmap)}, text=True).strip()


def make_fold(scene_path: pathlib.Path, first: int, work_path: pathlib.Path, colmap: pathlib.Path) -> Fold:
    scene = load_scene(scene_path)
    names = sorted(scene.images)
    query_names = names[first::QUERY_STEP]
    database_names = [name for name in names if name not in query_names]
    fold = Fold(scene, work_path / scene.name / str(first), query_names, database_names, colmap)
    if (fold.work_path / "done").exists():
        return fold
    shutil.rmtree(fold.work_path, ignore_errors=True)
    fold.work_path.mkdir(parents=True)
    fold.query_list_path.write_text("".join(f"{name} {camera_text(scene.camera(name))}\n" for name in query_names))
    features_path = extract_features(scene, fold.work_path.parent, colmap)
    shutil.copyfile(features_path, fold.photo_path)
    remove_images(fold.photo_path, query_names)
    shutil.copyfile(features_path, fold.matched_path)
    pairs_path = fold.work_path / "pairs.txt"
    pairs_path.write_text("".join(f"{query} {name}\n" for query in query_names for name in database_names))
    run_colmap(colmap, "matches_importer", "--database_path", fold.matched_path, "--match_list_path", pairs_path,
               gpu_option(colmap, "matches_importer"), 0)
    (fold.work_path / "done").touch()
    return fold


def extract_features(scene: Scene, work_path: pathlib.Path, colmap: pathlib.Path) -> pathlib.Path:
    """A database of COLMAP's SIFT features of all images, with the scene's cameras."""
    path, staged_path, names_path = (work_path / name for name in ("features.db", "features.new", "names.txt"))
    if path.exists():
        return path
    staged_path.unlink(missing_ok=True)
    for camera_id, camera in scene.cameras.items():
        names = [name for name, image in scene.images.items() if image.camera_id == camera_id]
        names_path.write_text("".join(f"{name}\n" for name in sorted(names)))
        run_colmap(colmap, "feature_extractor", "--database_path", staged_path, "--image_path", scene.path / "images",
                   "--image_list_path", names_path, "--ImageReader.single_camera", 1, "--ImageReader.camera_model",
                   camera.model, "--ImageReader.camera_params", ",".join(map(repr, camera.params)),
                   gpu_option(colmap, "feature_extractor"), 0)
    staged_path.rename(path)
    return path


def remove_images(database_path: pathlib.Path, names: list[str]):
    """And the room that they took in the file."""
    connection = sqlite3.connect(database_path)
    for name in names:
        (image_id,) = connection.execute("SELECT image_id FROM images WHERE name = ?", (name,)).fetchone()
        for table in ("matches", "two_view_geometries"):
            pair = f"pair_id / {MAX_NUM_IMAGES}, pair_id % {MAX_NUM_IMAGES}"
            connection.execute(f"DELETE FROM {table} WHERE ? IN ({pair})", (image_id,))
        for table in ("keypoints", "descriptors", "images"):
            connection.execute(f"DELETE FROM {table} WHERE image_id = ?", (image_id,))
    connection.commit()
    connection.execute("VACUUM")
    connection.close()


def copy_without_verification(database_path: pathlib.Path) -> pathlib.Path:
    """With the raw matches only: lazy_localizer verifies them itself."""
    path = database_path.with_suffix(".raw.db")
    shutil.copyfile(database_path, path)
    connection = sqlite3.connect(path)
    connection.execute("DELETE FROM two_view_geometries")
    connection.commit()
    connection.close()
    return path


def sha256(path: pathlib.Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
