"""Tests of `colmap lazy_feature_extractor`: the database is the one that COLMAP's feature_extractor writes."""

import shutil
import sqlite3
import subprocess

import cv2
import numpy as np
import pytest

import photo_scene
from colmap_lazyloc.program import gpu_option
from conftest import DATA_PATH
from exif import write_jpeg

BY_COLMAP = "Creating SIFT CPU feature extractor"  # what COLMAP logs when it makes its own
AFFINE = ["--SiftExtraction.estimate_affine_shape", "1"]
SIZE = (photo_scene.CAMERA.height, photo_scene.CAMERA.width)


@pytest.fixture
def work(photos, tmp_path):
    """Returns a folder with photos of several kinds: without EXIF, with it, of other sizes, tiny, and no photo."""
    folder = tmp_path / "images"
    (folder / "plain").mkdir(parents=True)
    shutil.copy(photos.image_path / photos.database_names[0], folder / "plain" / "0.png")
    photo = cv2.imread(str(folder / "plain" / "0.png"))
    for index, focal_length in enumerate((28, 28, 50)):
        write_jpeg(folder / f"exif{index}.jpg", np.roll(photo, 40 * index, axis=1), focal_length)
    cv2.imwrite(str(folder / "large.jpg"), cv2.resize(photo, (680, 510), interpolation=cv2.INTER_CUBIC))
    cv2.imwrite(str(folder / "tiny.png"), photo[:5, :6])
    (folder / "damaged.jpg").write_bytes(b"\xff\xd8 no photo")
    mask = np.full(SIZE, 255, np.uint8)
    mask[:, : SIZE[1] // 2] = 0
    (tmp_path / "masks").mkdir()
    cv2.imwrite(str(tmp_path / "masks" / "exif1.jpg.png"), mask)
    cv2.imwrite(str(tmp_path / "camera_mask.png"), mask.T[: SIZE[0]])
    return tmp_path


def extract(colmap, work, command, *options):
    """Returns what the database holds, without ids, which differ from run to run, and the log."""
    path = work / f"{command}.db"
    words = [colmap, command, "--database_path", path, "--image_path", work / "images", *options]
    words += [gpu_option(colmap, command), 0] if command == "feature_extractor" else []
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, timeout=120, cwd=work)
    assert done.returncode == 0, done.stderr
    return contents(path), done.stderr


def contents(path):
    with sqlite3.connect(path) as connection:
        cameras = "SELECT model, width, height, params, prior_focal_length FROM cameras"
        held = {"cameras": sorted(connection.execute(cameras))}
        select = "SELECT name, model, width, height, params FROM images JOIN cameras USING (camera_id)"
        held["images"] = sorted(connection.execute(select))
        for table in ("keypoints", "descriptors"):
            select = f"SELECT name, rows, cols, data FROM {table} JOIN images USING (image_id)"
            held[table] = {name: values for name, *values in connection.execute(select)}
    return held


def assert_same(found, expected):
    """Compares what two databases hold. COLMAP gives keypoints at the lower border the descriptor of another one."""
    assert found["descriptors"].keys() == expected["descriptors"].keys()
    for name, (rows, columns, data) in expected["descriptors"].items():
        theirs = np.frombuffer(data or b"", np.uint8).reshape(rows, columns)
        ours = np.frombuffer(found["descriptors"][name][2] or b"", np.uint8).reshape(rows, columns)
        is_other = (theirs != ours).any(axis=1)
        assert is_other.sum() < 5 and not ours[is_other].any(), name
    assert {**found, "descriptors": None} == {**expected, "descriptors": None}


@pytest.mark.parametrize(
    "options",
    [
        [],
        ["--SiftExtraction.max_image_size", "500", "--SiftExtraction.max_num_features", "300"],
        ["--SiftExtraction.first_octave", "0", "--SiftExtraction.upright", "1"],
        ["--ImageReader.mask_path", "masks", "--ImageReader.camera_mask_path", "camera_mask.png"],
        ["--ImageReader.single_camera", "1", "--ImageReader.camera_model", "OPENCV"],
        ["--ImageReader.camera_params", "400,241,179,-0.03"],
    ],
)
def test_database_is_that_of_feature_extractor(colmap, work, options):
    expected, _ = extract(colmap, work, "feature_extractor", *options)
    found, log = extract(colmap, work, "lazy_feature_extractor", *options)
    assert_same(found, expected)
    assert len(found["keypoints"]) >= 4 and "Failed to read image file format" in log
    assert BY_COLMAP not in log


@pytest.mark.parametrize(
    "options", [AFFINE, ["--SiftExtraction.peak_threshold", "0.01"], ["--descriptor_normalization", "l2"]]
)
def test_colmap_extracts_what_is_not_plain_sift(colmap, work, options):
    for name in ("exif0.jpg", "exif2.jpg", "large.jpg", "tiny.png"):
        (work / "images" / name).unlink()
    expected, _ = extract(colmap, work, "feature_extractor", *options)
    found, log = extract(colmap, work, "lazy_feature_extractor", *options)
    assert found == expected and "SIFT CPU feature extractor" in log


def test_goes_on_where_it_has_stopped(colmap, work):
    (work / "list.txt").write_text("exif0.jpg\nplain/0.png\n")
    begun, _ = extract(colmap, work, "lazy_feature_extractor", "--image_list_path", "list.txt")
    found, log = extract(colmap, work, "lazy_feature_extractor")
    assert log.count("SKIP: Features for image already extracted") == len(begun["keypoints"]) == 2
    assert begun["descriptors"].items() < found["descriptors"].items() and len(found["keypoints"]) == 6


def test_real_photos(colmap, work):
    scene = DATA_PATH / "fountain" / "images"
    if not scene.is_dir():
        pytest.skip("no real scenes")
    shutil.rmtree(work / "images")
    shutil.copytree(scene, work / "images")
    for path in sorted((work / "images").iterdir())[1:]:
        path.unlink()
    expected, _ = extract(colmap, work, "feature_extractor")
    found, _ = extract(colmap, work, "lazy_feature_extractor")
    assert_same(found, expected)


def test_help(colmap):
    done = subprocess.run([colmap, "lazy_feature_extractor", "-h"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    assert "feature_extractor" in done.stdout and "--ImageReader.mask_path" in done.stdout + done.stderr
    assert subprocess.run([colmap, "lazy_feature_extractor"], capture_output=True, timeout=60).returncode == 1
