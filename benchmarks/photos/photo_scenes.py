"""Makes scenes whose queries are photos, with features and matches of our colmap; the original scene is only read."""

import contextlib
import dataclasses
import hashlib
import pathlib
import shutil
from collections.abc import Sequence

import numpy as np

from benchmarks.localization.scenes import Scene, load_scene
from colmap_lazyloc.database import connect, remove_images
from colmap_lazyloc.program import extract_features, gpu_option, run_colmap
from colmap_lazyloc.results import pose_of, read_results

QUERY_STEP = 4


@dataclasses.dataclass(frozen=True)
class Fold:
    """A division of a scene: every fourth image from `first` on is a query, the others are the database."""

    scene: Scene
    work_path: pathlib.Path
    query_names: list[str]
    database_names: list[str]
    colmap: pathlib.Path

    # This database has the verified matches of all queries with all database images.
    matched_path = property(lambda self: self.work_path / "matched.db")
    # This database does not have the queries.
    photo_path = property(lambda self: self.work_path / "photo.db")
    index_path = property(lambda self: self.work_path / "photo.index")
    query_list_path = property(lambda self: self.work_path / "queries.txt")

    def localize(self, database_path: pathlib.Path, tag: str, *options) -> dict[str, dict]:
        """Runs lazy_localizer; returns its results by query."""
        output_path = self.work_path / tag
        run_colmap(
            self.colmap,
            "lazy_localizer",
            "--database_path",
            database_path,
            "--output_path",
            output_path,
            "--input_path",
            self.scene.model_path,
            "--query_list_path",
            self.query_list_path,
            *options,
        )
        return read_results(output_path / "results.jsonl")

    def errors(self, records: dict[str, dict]) -> list[tuple[float, float]]:
        """Returns position errors in the scene's unit and rotation errors in degrees; infinite for lost queries."""
        poses = {name: pose_of(record) for name, record in records.items()}
        return [pose.errors(self.scene.true_pose(name)) if pose else (np.inf, np.inf) for name, pose in poses.items()]

    def localize_photos(self, tag: str, *options) -> dict[str, dict]:
        return self.localize(
            self.photo_path,
            tag,
            "--image_path",
            self.scene.path / "images",
            "--retrieval_index_path",
            self.index_path,
            *options,
        )


def make_fold(
    scene_path: pathlib.Path,
    first: int,
    work_path: pathlib.Path,
    colmap: pathlib.Path,
    *,
    is_matched: bool = True,
    extraction: Sequence[object] = (),
) -> Fold:
    """Makes the databases of a fold, unless they are there. Without `is_matched`, only the one of photos. `extraction`
    has options of feature_extractor."""
    scene = load_scene(scene_path)
    names = sorted(scene.images)
    query_names = names[first::QUERY_STEP]
    database_names = [name for name in names if name not in query_names]
    folder = str(first) if is_matched else f"{first}_photos"
    fold = Fold(scene, work_path / scene.name / folder, query_names, database_names, colmap)
    if (fold.work_path / "done").exists():
        return fold
    shutil.rmtree(fold.work_path, ignore_errors=True)
    fold.work_path.mkdir(parents=True)
    fold.query_list_path.write_text("".join(f"{name} {scene.camera(name).text()}\n" for name in query_names))
    features_path = extract_scene_features(scene, fold.work_path.parent, colmap, extraction)
    shutil.copyfile(features_path, fold.photo_path)
    remove_queries(fold)
    if is_matched:
        match_queries(fold, features_path)
    (fold.work_path / "done").touch()
    return fold


def match_queries(fold: Fold, features_path: pathlib.Path):
    """Matches the queries with all database images."""
    colmap = fold.colmap
    shutil.copyfile(features_path, fold.matched_path)
    pairs_path = fold.work_path / "pairs.txt"
    pairs_path.write_text("".join(f"{query} {name}\n" for query in fold.query_names for name in fold.database_names))
    run_colmap(
        colmap,
        "matches_importer",
        "--database_path",
        fold.matched_path,
        "--match_list_path",
        pairs_path,
        gpu_option(colmap, "matches_importer"),
        0,
    )


def extract_scene_features(
    scene: Scene, work_path: pathlib.Path, colmap: pathlib.Path, extraction: Sequence[object] = ()
) -> pathlib.Path:
    """Creates a database with COLMAP's features of all images (by default, SIFT) and the scene's cameras; returns its
    path."""
    path, staged_path = work_path / "features.db", work_path / "features.new"
    if path.exists():
        return path
    staged_path.unlink(missing_ok=True)
    for camera_id, camera in scene.cameras.items():
        names = sorted(name for name, image in scene.images.items() if image.camera_id == camera_id)
        extract_features(colmap, staged_path, scene.path / "images", names, camera, *extraction)
    staged_path.rename(path)
    return path


def remove_queries(fold: Fold):
    """Removes the queries from the photos' database, and shrinks the file."""
    with contextlib.closing(connect(fold.photo_path, "rw")) as connection:
        ids = dict(connection.execute("SELECT name, image_id FROM images"))
        remove_images(connection, [ids[name] for name in fold.query_names])
        connection.commit()
        connection.execute("VACUUM")


def copy_without_verification(database_path: pathlib.Path) -> pathlib.Path:
    """Copies a database with only the raw matches, so that lazy_localizer verifies them itself."""
    path = database_path.with_suffix(".raw.db")
    shutil.copyfile(database_path, path)
    with contextlib.closing(connect(path, "rw")) as connection, connection:
        connection.execute("DELETE FROM two_view_geometries")
    return path


def sha256(path: pathlib.Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
