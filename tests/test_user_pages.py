"""Tests that the commands of docs/users/ do what the pages say, on rendered photos with the names that the pages use.

The intrinsics on the pages are replaced by those of the photos. The command of drones.md is the first of gis.md with
other names; the command of hloc.md is in its tutorial (test_tutorials.py).
"""

import dataclasses
import json
import re
import socket

import cv2
import numpy as np
import pyogrio
from rosbags.rosbag2 import Reader

import tutorials
from colmap_lazyloc.demo import survey
from colmap_lazyloc.demo.renderer import RayGrid
from colmap_lazyloc.demo.scene import build_scene, write_images
from colmap_lazyloc.pose_formats.posed_images import PosedImage, PosedImages
from colmap_lazyloc.pose_formats.registry import write_posed_images
from colmap_lazyloc.results import read_results
from photo_scene import CAMERA, build_courtyard, take_photo
from test_tutorials import environment  # noqa: F401  a fixture

CAMERA_WORDS = re.compile(r"'(PINHOLE|OPENCV) [\d. -]+'")


def type_page(name, folder, environment, **replaced):  # noqa: F811
    """Runs the blocks of `sh` of a page."""
    for block in tutorials.read_blocks(tutorials.DOCS_PATH / "users" / f"{name}.md"):
        text = CAMERA_WORDS.sub(f"'{CAMERA.text()}'", block.text)
        for old, new in replaced.items():
            text = text.replace(old, new)
        tutorials.run_block(dataclasses.replace(block, text=text), folder, environment)


def copy_photos(photos, folder, names, new_name):
    """Copies photos under names of their own; returns them with their poses."""
    folder.mkdir()
    images = []
    for index, name in enumerate(names):
        path = folder / new_name(index)
        if path.suffix == ".png":
            path.write_bytes((photos.image_path / name).read_bytes())
        else:
            cv2.imwrite(str(path), cv2.imread(str(photos.image_path / name)), [cv2.IMWRITE_JPEG_QUALITY, 97])
        images.append(PosedImage(path.name, CAMERA, photos.poses[name]))
    return images


def assert_localized(folder, count):
    results = read_results(folder / "localized" / "results.jsonl")
    assert [result["status"] for result in results.values()] == ["LOCALIZED"] * count


def test_robots(photos, environment, tmp_path):  # noqa: F811
    mapped = copy_photos(photos, tmp_path / "mapping", photos.database_names, lambda index: f"{100 + index}.5.png")
    copy_photos(photos, tmp_path / "new", photos.query_names, lambda index: f"{200 + index}.5.png")
    write_posed_images(tmp_path / "slam.txt", PosedImages(mapped), "tum")
    type_page("robots", tmp_path, environment)
    assert_localized(tmp_path / "localization", 2)
    with Reader(tmp_path / "bag") as bag:
        assert {connection.topic: connection.msgcount for connection in bag.connections} == {
            "/localized_pose": 2,
            "/tf": 2,
        }


def test_gis(environment, tmp_path):  # noqa: F811
    views, new_views = survey.make_views(np.random.default_rng(6))
    rectangles = build_scene(0, texels_per_m=110)
    for name, taken in (("photos", views), ("new_photos", new_views)):
        write_images(tmp_path / name, rectangles, taken, 0, stream=20)
        for view in taken:
            survey.write_gps(tmp_path / name / view.name, view.pose.cam_in_world)
    type_page("gis", tmp_path, environment)
    assert_localized(tmp_path / "localization", len(new_views))
    assert (tmp_path / "localization" / "localized" / "positions.geojson").exists()
    for layer in ("positions", "fields_of_view"):
        assert pyogrio.read_info(tmp_path / "photos.gpkg", layer=layer)["features"] == len(new_views)


def test_splats(photos, environment, tmp_path):  # noqa: F811
    posed = copy_photos(photos, tmp_path / "images", photos.database_names, lambda index: f"{index}.png")
    copy_photos(photos, tmp_path / "new_photos", photos.query_names, lambda index: f"new{index}.png")
    write_posed_images(tmp_path / "transforms.json", PosedImages(posed), "transforms")
    type_page("splats", tmp_path, environment)
    assert len(json.loads((tmp_path / "new.json").read_text())["frames"]) == 2


def test_ar(photos, environment, tmp_path):  # noqa: F811
    posed = copy_photos(photos, tmp_path / "photos", photos.database_names, lambda index: f"{index}.png")
    (query,) = copy_photos(photos, tmp_path / "test", photos.query_names[:1], lambda _: "test.jpg")
    for name in ("test.jpg", "photo.jpg"):
        (tmp_path / name).write_bytes((tmp_path / "test" / query.name).read_bytes())
    write_posed_images(tmp_path / "transforms.json", PosedImages(posed), "transforms")
    (tmp_path / "tokens.txt").write_text("TOKEN\n")
    with socket.create_server(("", 0)) as listener:
        port = str(listener.getsockname()[1])
    serve = "lazyloc serve localization --host 0.0.0.0 --tokens tokens.txt"
    background = f"{serve} --port {port} > log.txt 2>&1 & echo $! > pid"
    curl = "curl --fail --silent --retry 40 --retry-connrefused --retry-delay 1 --output answer.json"
    try:
        type_page("ar", tmp_path, environment, **{serve: background, "curl": curl, ":8000": f":{port}"})
        assert json.loads((tmp_path / "answer.json").read_text())["status"] == "LOCALIZED"
    finally:
        block = tutorials.Block("ar", 0, "sh", "", "kill $(cat pid)", "")
        tutorials.run_block(block, tmp_path, environment)


def test_film(photos, environment, tmp_path):  # noqa: F811
    posed = copy_photos(photos, tmp_path / "set_photos", photos.database_names, lambda index: f"{index}.png")
    write_posed_images(tmp_path / "cameras.xml", PosedImages(posed), "metashape")
    writer = cv2.VideoWriter(
        str(tmp_path / "shot.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 24, (CAMERA.width, CAMERA.height)
    )
    rectangles, rays = build_courtyard(), RayGrid(CAMERA)
    for seed, name in enumerate(photos.query_names):
        writer.write(take_photo(rectangles, rays, photos.poses[name], seed))
    writer.release()
    type_page("film", tmp_path, environment)
    assert_localized(tmp_path / "shot", 2)
    assert (tmp_path / "shot.xml").read_text().count("<camera ") == 2


def test_colmap(photos, environment, tmp_path):  # noqa: F811
    (tmp_path / "sparse").mkdir()
    for name, path in (("database.db", photos.database_path), ("sparse/0", photos.model_path)):
        (tmp_path / name).symlink_to(path)
    (tmp_path / "images").symlink_to(photos.image_path)
    photos.write_queries(tmp_path / "queries.txt", with_camera=False)
    type_page("colmap", tmp_path, environment)
    results = read_results(tmp_path / "localized" / "results.jsonl")
    assert [result["status"] for result in results.values()] == ["LOCALIZED", "LOCALIZED"]
