"""`lazyloc check`, `lazyloc import` and `lazyloc run` with poses that the photos contradict."""

import json
import shutil

import cv2
import numpy as np
import pytest

import photo_scene
from benchmarks.corrupted_poses import CORRUPTIONS, explain_scene, judge, read_scene
from colmap_lazyloc.__main__ import main
from colmap_lazyloc.agreement import photo_pairs
from colmap_lazyloc.agreement.photo_pairs import pairs_of_photos
from colmap_lazyloc.model import Camera, Image, read_model, write_model
from colmap_lazyloc.pose_formats.conventions import CAMERA_AXES
from colmap_lazyloc.pose_formats.posed_images import PosedImage
from colmap_lazyloc.poses import Pose
from conftest import DATA_PATH

SCENES = ("herzjesu", "skull", "headset")


def write_transforms(path, photos, axes):
    """Writes transforms.json with camera axes, which should be those of OpenGL."""
    frames = []
    for name in photos.database_names:
        pose, matrix = photos.poses[name], np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = pose.rotation.T @ CAMERA_AXES[axes], pose.cam_in_world
        frames.append({"file_path": name, "transform_matrix": matrix.tolist()})
    f, cx, cy, k1 = photo_scene.CAMERA.params
    size = {"w": photo_scene.CAMERA.width, "h": photo_scene.CAMERA.height}
    path.write_text(json.dumps({"fl_x": f, "fl_y": f, "cx": cx, "cy": cy, "k1": k1, **size, "frames": frames}))
    return path


def import_poses(photos, path, *more):
    words = ["import", "auto", path, "--image_path", photos.image_path, "--output_path", path.parent / "model", *more]
    return main([str(word) for word in words])


def test_import_names_axes_of_opencv_and_writes_nothing(photos, tmp_path, capsys):
    path = write_transforms(tmp_path / "transforms.json", photos, "opencv")
    assert import_poses(photos, path) == 1
    error = capsys.readouterr().err
    assert f"{path}: the poses do not fit the photos: 0 of " in error
    assert "as poses with camera axes of opencv" in error and "give --camera_axes opencv, or --accept_poses" in error
    assert not (tmp_path / "model").exists()
    assert import_poses(photos, path, "--camera_axes", "opencv") == 0
    assert "poses agree with the photos: " in capsys.readouterr().err
    model = read_model(tmp_path / "model")
    for name in photos.database_names:
        assert max(model.images[name].pose.errors(photos.poses[name])) < 1e-6


def test_import_accepts_wrong_poses_if_asked_to(photos, tmp_path, capsys):
    path = write_transforms(tmp_path / "transforms.json", photos, "opencv")
    assert import_poses(photos, path, "--accept_poses") == 0
    assert "the poses do not fit the photos" in capsys.readouterr().err
    assert (tmp_path / "model").exists()


def test_masks_hide_features(photos, tmp_path):
    model = photo_scene.CAMERA
    camera = Camera(model.model, model.width, model.height, tuple(model.params))
    images = [PosedImage(name, camera, photos.poses[name]) for name in photos.database_names]
    assert len(pairs_of_photos(photos.image_path, images, tmp_path)) > 6  # there are no masks
    for name in photos.database_names[1:]:
        path = tmp_path / f"{name}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), np.zeros((camera.height, camera.width), np.uint8))
    assert pairs_of_photos(photos.image_path, images, tmp_path) == []


def test_run_stops_before_anything_is_made(photos, colmap, monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("COLMAP", str(colmap))
    path = write_transforms(tmp_path / "transforms.json", photos, "opencv")
    words = ["run", "--database_images", photos.image_path / "database", "--queries", photos.image_path / "query"]
    words += ["--poses", path, "--output", tmp_path / "out", *photo_scene.SIFT]
    assert main([str(word) for word in words]) == 1
    assert "--camera_axes opencv" in capsys.readouterr().err
    assert not (tmp_path / "out" / "database.db").exists()
    assert main([str(word) for word in [*words, "--camera_axes", "opencv"]]) == 0
    assert "2 of 2 queries localized" in capsys.readouterr().out


@pytest.fixture
def model_of(photos, tmp_path):
    """Returns a function that writes a model of the database images with other poses."""

    def write(change):
        camera = photo_scene.CAMERA
        cameras = {1: Camera(camera.model, camera.width, camera.height, tuple(camera.params))}
        images = [
            Image(name, 1, change(name, photos.poses[name]), index)
            for index, name in enumerate(photos.database_names, start=1)
        ]
        return write_model(tmp_path / "changed", cameras, images)

    return write


def check(database, model):
    return main(["check", str(database), str(model)])


def test_check_of_right_and_of_inverse_poses(photos, colmap, model_of, tmp_path, capsys):
    database_path = shutil.copy(photos.database_path, tmp_path / "database.db")
    photo_scene.match_exhaustively(colmap, database_path)
    assert check(database_path, model_of(lambda name, pose: pose)) == 0
    assert capsys.readouterr().out.startswith("poses agree with the photos: ")
    assert check(database_path, model_of(lambda name, pose: pose.inverse())) == 2
    printed = capsys.readouterr().out
    assert "read as world_from_cam" in printed
    words = printed.partition("to mend them: lazyloc ")[2].split()
    assert main([str(tmp_path / "mended") if word == "MENDED" else word for word in words]) == 0
    assert check(database_path, tmp_path / "mended") == 0


def test_check_of_bad_input(photos, model_of, tmp_path, capsys):
    model = model_of(lambda name, pose: pose)
    assert check(tmp_path / "none.db", model) == 1
    assert check(photos.database_path, tmp_path / "none") == 1
    (tmp_path / "text.db").write_text("no database")
    assert check(tmp_path / "text.db", model) == 1
    renamed = tmp_path / "changed" / "images.txt"
    renamed.write_text(renamed.read_text().replace("database/", "other/"))
    assert check(photos.database_path, model) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 4 and "too few" in lines[3]
    for line, text in zip(lines, ("none.db: does not exist", "none: holds no COLMAP model", "text.db: is not")):
        assert text in line


@pytest.mark.skipif(not DATA_PATH.exists(), reason=f"{DATA_PATH} is missing")
@pytest.mark.parametrize("name", SCENES)
def test_real_scene(name):
    scene = read_scene(DATA_PATH / name, by_photos=False)
    right = explain_scene(scene)
    assert right.given.agrees and right.reading is None and not right.is_hopeless
    for corruption in ("OpenGL's axes", "inverse poses", "lexical order", "another set"):
        corrupt, title = CORRUPTIONS[corruption]
        assert judge(explain_scene(corrupt(scene)), title, np.inf) == "right", corruption


@pytest.mark.skipif(not DATA_PATH.exists(), reason=f"{DATA_PATH} is missing")
def test_photos_of_a_real_scene():
    scene = read_scene(DATA_PATH / "herzjesu", by_photos=True)
    assert len(scene.pairs) > 30
    assert explain_scene(scene).given.agrees
    # Errors are in the same pixels, however many are seen.
    camera = next(iter(read_model(DATA_PATH / "herzjesu" / "model").cameras.values()))
    focal_px = camera.params[0] * (photo_pairs.UNIT_NUM_PX / (camera.width * camera.height)) ** 0.5
    assert [pair.focal_px for pair in scene.pairs] == pytest.approx([focal_px] * len(scene.pairs), rel=0.01)
    mirrored = CORRUPTIONS["mirrored axes"][0](scene)
    assert "left-handed" in explain_scene(mirrored).reading.title


@pytest.mark.skipif(not DATA_PATH.exists(), reason=f"{DATA_PATH} is missing")
def test_no_more_photos_are_matched_than_are_used(monkeypatch):
    tried = []

    def match(images, features, *pair):
        tried.append(pair)
        return photo_pairs_match(images, features, *pair)

    photo_pairs_match = photo_pairs._match
    monkeypatch.setattr(photo_pairs, "_match", match)
    some = [(pair.first, pair.second) for pair in read_scene(DATA_PATH / "herzjesu", by_photos=True).pairs]
    num_tried = len(tried)
    monkeypatch.setattr(photo_pairs, "NUM_AT_ONCE", photo_pairs.NUM_RANDOM)
    every = [(pair.first, pair.second) for pair in read_scene(DATA_PATH / "herzjesu", by_photos=True).pairs]
    assert some == every and 2 * num_tried < len(tried)


def test_few_matches_need_few_trials():
    """Of 20 matches, nearly all must fit, which a few trials of seven matches find."""
    counts = [photo_pairs._num_trials(count) for count in (20, 25, 30, 40, 600)]
    assert counts == sorted(counts)
    assert counts[0] < 10 and counts[2] < 200 and counts[-2:] == [photo_pairs.MAX_NUM_TRIALS] * 2


@pytest.mark.parametrize(
    ("num_coarse", "details"), [(8, [photo_pairs.COARSE]), (7, [photo_pairs.COARSE, photo_pairs.FINE])]
)
def test_photos_are_seen_with_more_pixels_if_few_pairs_match(num_coarse, details, monkeypatch, tmp_path):
    used = []

    def find_pairs(folder, images, masks, near, seen, detail):
        used.append(detail)
        return [None] * (num_coarse if detail == photo_pairs.COARSE else 15)

    monkeypatch.setattr(photo_pairs, "_find_pairs", find_pairs)
    camera = Camera("PINHOLE", 640, 480, (500.0, 500.0, 320.0, 240.0))
    images = [PosedImage(f"{index}.jpg", camera, Pose.from_centre(np.eye(3), [index, 0, 0])) for index in range(6)]
    assert len(pairs_of_photos(tmp_path, images)) == (num_coarse if len(details) == 1 else 15)
    assert used == details
