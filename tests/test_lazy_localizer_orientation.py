"""Tests of photos that EXIF turns: their poses are those of the pixels as stored, their features those of the upright
photo."""

import shutil
import sqlite3

import pytest

import photo_scene
from benchmarks.photos.oriented_photos import MIRRORS, TURNS, stored_camera, stored_pose, write_oriented

UPRIGHT = ["--SiftExtraction.upright", "1"]


@pytest.fixture(scope="module")
def turned(photos, tmp_path_factory):
    """The photos, with queries stored in each orientation that turns them."""
    folder = tmp_path_factory.mktemp("turned")
    shutil.copytree(photos.image_path, folder / "images")
    lines = []
    poses = {}
    for name in photos.query_names:
        for orientation in TURNS:
            stored = f"{name[:-4]}_{orientation}.jpg"
            write_oriented(folder / "images" / stored, photos.image_path / name, orientation)
            poses[stored] = stored_pose(photos.poses[name], orientation)
            lines.append(f"{stored} {stored_camera(photo_scene.CAMERA, orientation).text()}\n")
    (folder / "queries.txt").write_text("".join(lines))
    scene = photo_scene.PhotoScene(folder, {**photos.poses, **poses})
    shutil.copytree(photos.model_path, scene.model_path)
    shutil.copy(photos.database_path, scene.database_path)
    return scene


def assert_localized(scene, run, orientations=tuple(TURNS)):
    names = [name for name in scene.query_names if name.endswith(tuple(f"_{each}.jpg" for each in orientations))]
    assert names
    scene.assert_localized(run, names)


def test_features_with_an_orientation_of_their_own(turned, localize):
    assert_localized(turned, localize(*turned.arguments(turned.folder / "queries.txt")))


@pytest.fixture(scope="module")
def upright_databases(colmap, turned, tmp_path_factory):
    """Databases of upright SIFT features: of COLMAP 3, which stores no gravity, and of COLMAP 4."""
    folder = tmp_path_factory.mktemp("upright")
    names = turned.database_names
    photo_scene.program.extract_features(
        colmap, folder / "made.db", turned.image_path, names, photo_scene.CAMERA, *photo_scene.SIFT, *UPRIGHT
    )
    paths = {version: shutil.copy(folder / "made.db", folder / f"{version}.db") for version in (3, 4)}
    with sqlite3.connect(paths[3]) as old, sqlite3.connect(paths[4]) as new:
        has_gravity = "gravity" in [row[1] for row in old.execute("PRAGMA table_info(pose_priors)")]
        (old if has_gravity else new).execute(f"ALTER TABLE pose_priors {'DROP' if has_gravity else 'ADD'} gravity")
    return paths


@pytest.mark.parametrize("version, localized", [(3, (1,)), (4, tuple(TURNS))])
def test_upright_features_are_turned_as_those_of_the_database(turned, upright_databases, localize, version, localized):
    arguments = turned.arguments(turned.folder / "queries.txt", *UPRIGHT)
    arguments[1] = upright_databases[version]
    run = localize(*arguments)
    assert_localized(turned, run, localized)
    others = [name for name in run.statuses if not name.endswith(tuple(f"_{each}.jpg" for each in localized))]
    assert all(run.statuses[name] != "LOCALIZED" for name in others)


def test_mirror_images_are_refused(turned, localize, tmp_path):
    """No pose fits them, and what is symmetric would give a wrong one."""
    names = [f"query/mirrored_{orientation}.jpg" for orientation in MIRRORS]
    for name, orientation in zip(names, MIRRORS, strict=True):
        write_oriented(turned.image_path / name, turned.image_path / turned.query_names[0], orientation)
    (tmp_path / "queries.txt").write_text("".join(f"{name}\n" for name in names))
    run = localize(*turned.arguments(tmp_path / "queries.txt"))
    assert run.exit_code == 0
    for name in names:
        assert run.statuses[name] == "UNREADABLE_IMAGE"
        assert f"{name} is stored as a mirror image" in run.results[name]["reason"]
