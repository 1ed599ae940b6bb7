"""Tests of photos against a COLMAP 4 database of ALIKED features, which ONNX models extract and match."""

import dataclasses
import os
import pathlib
import sqlite3
import subprocess

import cv2
import numpy as np
import pytest

import colmap_lazyloc as ll
from benchmarks.photos.oriented_photos import stored_camera, stored_pose, write_oriented
from colmap_lazyloc.onnx import LIBRARY_VARIABLE
from conftest import DATA_PATH, assert_refused
from photo_scene import CAMERA

onnxruntime = pytest.importorskip("onnxruntime")
pycolmap = pytest.importorskip("pycolmap", minversion="4")

MODELS_PATH = DATA_PATH.parent / "models"
pytestmark = pytest.mark.skipif(not MODELS_PATH.is_dir(), reason=f"{MODELS_PATH} is missing")
EXTRACTOR, BRUTE_FORCE, LIGHTGLUE = "aliked-n16rot.onnx", "bruteforce-matcher.onnx", "aliked-lightglue.onnx"
MAX_NUM_FEATURES = 600
MIN_SCORE = np.float32(0.2)
SIZE = np.array([[480, 360]], np.float32)  # of all photos


def run_model(name, *values):
    """Runs a model by the Python package."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.enable_cpu_mem_arena = False
    model = onnxruntime.InferenceSession(MODELS_PATH / name, options, providers=["CPUExecutionProvider"])
    return model.run(None, {node.name: value for node, value in zip(model.get_inputs(), values, strict=True)})


def extract(path):
    """Returns keypoints in COLMAP's pixels, and descriptors."""
    image = cv2.imread(str(path))[:, :, ::-1]
    height, width = image.shape[:2]
    padding = ((0, -height % 32), (0, -width % 32), (0, 0))
    tensor = np.pad(image, padding, "edge").transpose(2, 0, 1)[None].astype(np.float32) * np.float32(1 / 255)
    keypoints, descriptors, scores = run_model(EXTRACTOR, tensor, np.array(MAX_NUM_FEATURES), np.array(MIN_SCORE))
    half_size = (np.array(tensor.shape[:1:-1], np.float32) - 1) / 2
    keypoints = (keypoints[0] + 1) * half_size + np.float32(0.5)
    good = (scores[0] >= MIN_SCORE) & np.all((keypoints >= 0) & (keypoints < SIZE), axis=1)
    return keypoints[good].astype(np.float32), descriptors[0][good]


@dataclasses.dataclass
class AlikedScene:
    photos: object  # of photo_scene
    database_path: pathlib.Path
    features: dict  # keypoints and descriptors of database images, by name

    def arguments(self, queries, *more, models=MODELS_PATH):
        common = [word for word in self.photos.arguments(queries)[2:] if "SiftExtraction" not in str(word)]
        common = common[: common.index(queries) + 1]
        options = ["--AlikedExtraction.max_num_features", MAX_NUM_FEATURES, "--onnx_path", models]
        return ["--database_path", self.database_path, *common, *options, *more]


@pytest.fixture(scope="module")
def scene(photos, tmp_path_factory):
    path = tmp_path_factory.mktemp("aliked") / "database.db"
    database = pycolmap.Database.open(str(path))
    model = pycolmap.Reconstruction(photos.model_path)
    features = {}
    for camera in model.cameras.values():
        database.write_camera(camera, use_camera_id=True)
    for image in model.images.values():
        features[image.name] = keypoints, descriptors = extract(photos.image_path / image.name)
        database.write_image(
            pycolmap.Image(name=image.name, camera_id=image.camera_id, image_id=image.image_id), use_image_id=True
        )
        database.write_keypoints(image.image_id, keypoints)
        kind = pycolmap.FeatureExtractorType.ALIKED_N16ROT
        database.write_descriptors(image.image_id, pycolmap.FeatureDescriptors(kind, descriptors.view(np.uint8)))
    database.close()
    return AlikedScene(photos, path, features)


@pytest.fixture(scope="module")
def queries(photos, tmp_path_factory):
    return photos.write_queries(tmp_path_factory.mktemp("queries") / "queries.txt")


@pytest.fixture
def changed_database(scene, tmp_path):
    """Makes a copy of the database, changed by SQL."""

    def change(statement):
        path = tmp_path / "changed.db"
        with sqlite3.connect(f"file:{scene.database_path}?mode=ro", uri=True) as old, sqlite3.connect(path) as new:
            old.backup(new)
            new.execute(statement)
        return path

    return change


def test_photos_are_localized_and_nothing_is_touched(scene, queries, localize, fingerprint):
    before = fingerprint(scene.database_path.parent)
    runs = [localize(*scene.arguments(queries, "--LazyLocalizer.num_threads", count)) for count in (1, 3)]
    scene.photos.assert_localized(runs[0])
    assert runs[0].poses_bytes == runs[1].poses_bytes
    assert f"at most {MAX_NUM_FEATURES} features of ALIKED" in runs[0].stderr
    assert {result["matching_type"] for result in runs[0].results.values()} == {"ALIKED_BRUTEFORCE"}
    assert fingerprint(scene.database_path.parent) == before


def test_lightglue_localizes_a_photo(scene, localize, tmp_path):
    name = scene.photos.query_names[0]
    query = scene.photos.write_queries(tmp_path / "query.txt", [name])
    run = localize(*scene.arguments(query, "--FeatureMatching.type", "ALIKED_LIGHTGLUE"))
    scene.photos.assert_localized(run, [name])


@pytest.mark.parametrize("matcher", ["ALIKED_BRUTEFORCE", "ALIKED_LIGHTGLUE"])
def test_keypoints_and_matches_are_those_of_the_package_onnxruntime(scene, matcher):
    name = scene.photos.query_names[0]
    options = {
        "onnx_path": MODELS_PATH,
        "AlikedExtraction.max_num_features": MAX_NUM_FEATURES,
        "FeatureMatching.type": matcher,
    }
    camera = scene.photos.camera_words
    with ll.Localizer(scene.database_path, scene.photos.model_path, options=options) as localizer:
        result = localizer.localize_photo(scene.photos.image_path / name, camera, name=name)
        keypoints, descriptors = extract(scene.photos.image_path / name)
        np.testing.assert_allclose(result.keypoints, keypoints, rtol=0, atol=0.001)
        pairs = {}
        for other, (other_keypoints, other_descriptors) in scene.features.items():
            if matcher == "ALIKED_BRUTEFORCE":
                limits = np.array(0.85, np.float32), np.array(1, np.float32), np.array(1)
                first, second, _ = run_model(BRUTE_FORCE, descriptors, other_descriptors, *limits)
            else:
                points = [(xy - np.float32(0.5))[None] for xy in (keypoints, other_keypoints)]
                second, scores = run_model(LIGHTGLUE, *points, descriptors[None], other_descriptors[None], SIZE, SIZE)
                first = np.flatnonzero((second >= 0) & (scores >= 0.1))
                second = second[first]
            pairs[other] = np.column_stack((first, second))
        assert result.is_localized and sum(map(len, pairs.values())) > 100
        by_matches = localizer.localize_matches(camera, result.keypoints, pairs, name=name)
    inliers = [[pair["num_inliers"] for pair in each.as_dict()["pairs"]] for each in (result, by_matches)]
    assert inliers[0] == inliers[1]
    assert by_matches.pose.bits() == result.pose.bits()


def test_index_of_aliked_features_chooses_images(scene, queries, colmap, localize, tmp_path):
    path = tmp_path / "index"
    arguments = scene.arguments(queries, "--retrieval_index_path", path, "--LazyLocalizer.num_retrieved", 4)
    run = localize(*arguments)
    scene.photos.assert_localized(run)
    assert len(run.pair_names(scene.photos.query_names[0])) == 4
    done = subprocess.run(
        [colmap, "lazy_indexer", "--database_path", scene.database_path, "--index_path", path],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert "up to date, 6 images (0 added, 0 removed)" in done.stderr
    sift = localize(*scene.photos.arguments(queries, "--retrieval_index_path", path))
    assert_refused(sift, path, "of another type of features")


def test_kept_matches_are_a_database_of_colmap_4(scene, queries, localize, tmp_path):
    kept = tmp_path / "kept.db"
    run = localize(*scene.arguments(queries, "--LazyLocalizer.Advanced.matches_output_path", kept))
    if run.exit_code == 0:
        with sqlite3.connect(kept) as connection:
            assert connection.execute("SELECT DISTINCT type, cols FROM descriptors").fetchall() == [(1, 512)]
    else:
        assert_refused(run, scene.database_path, "matches_output_path", "COLMAP 3")
        assert not kept.exists()


@pytest.mark.parametrize(
    "statement, words",
    [
        ("UPDATE descriptors SET type = 0, cols = 128, rows = rows * 4 WHERE image_id = 2", ["ALIKED_N16ROT and SIFT"]),
        ("UPDATE descriptors SET type = 3", ["LOMA_B", "only SIFT and ALIKED"]),
        ("UPDATE descriptors SET type = 2", ["n32.onnx", "--onnx_path"]),
        ("UPDATE descriptors SET cols = 256", ["not ALIKED_N16ROT's", "256"]),
    ],
)
def test_unusable_types_are_refused(scene, queries, localize, changed_database, tmp_path, statement, words):
    models = tmp_path / "models"
    models.mkdir()
    (models / EXTRACTOR).symlink_to(MODELS_PATH / EXTRACTOR)
    path = changed_database(statement)
    run = localize("--database_path", path, *scene.arguments(queries, models=models)[2:])
    assert_refused(run, *words)


def test_missing_models_and_library_are_one_line(scene, queries, localize, tmp_path):
    without = scene.arguments(queries)
    without = without[: without.index("--onnx_path")]
    assert_refused(localize(*without), EXTRACTOR, "--onnx_path")
    assert_refused(localize(*scene.arguments(queries, models=tmp_path)), "--onnx_path", tmp_path, EXTRACTOR)
    for library in (tmp_path / "libonnxruntime.so", sqlite3.__file__):
        environment = {**os.environ, LIBRARY_VARIABLE: str(library)}
        assert_refused(localize(*scene.arguments(queries), env=environment), library, "ONNX Runtime")


@pytest.fixture
def models_with(tmp_path):
    """Makes a folder of the models in which one has other bytes."""

    def make(changed, content):
        folder = tmp_path / "models"
        folder.mkdir()
        for name in (EXTRACTOR, BRUTE_FORCE, LIGHTGLUE):
            (folder / name).write_bytes(content) if name == changed else (folder / name).symlink_to(MODELS_PATH / name)
        return folder

    return make


def bad_models():
    """Returns the bytes of files that are not the models they should be, by a description."""
    good = (MODELS_PATH / EXTRACTOR).read_bytes() if MODELS_PATH.is_dir() else b""
    return {
        "empty": b"",
        "text": b"version https://git-lfs.github.com/spec/v1\n",
        "cut in the middle": good[: len(good) // 2],
        "cut at the end": good[:-100],
        "name": good.replace(b"min_score", b"max_score"),
        "length": good.replace(b"descriptors", b"descriptorz"),
    }


@pytest.mark.parametrize("name", list(bad_models()))
def test_damaged_model_is_one_line(scene, queries, localize, models_with, name):
    models = models_with(EXTRACTOR, bad_models()[name])
    assert_refused(localize(*scene.arguments(queries, models=models)), models / EXTRACTOR)


@pytest.mark.parametrize(
    "changed, other, matcher",
    [
        (EXTRACTOR, LIGHTGLUE, "AUTO"),
        (BRUTE_FORCE, LIGHTGLUE, "ALIKED_BRUTEFORCE"),
        (LIGHTGLUE, BRUTE_FORCE, "ALIKED_LIGHTGLUE"),
    ],
)
def test_another_model_is_one_line(scene, queries, localize, models_with, changed, other, matcher):
    models = models_with(changed, (MODELS_PATH / other).read_bytes())
    run = localize(*scene.arguments(queries, "--FeatureMatching.type", matcher, models=models))
    assert_refused(run, models / changed, "instead of")


def test_sift_does_not_match_aliked_features(scene, queries, localize):
    run = localize(*scene.arguments(queries, "--FeatureMatching.type", "SIFT_BRUTEFORCE"))
    assert_refused(run, scene.database_path, "ALIKED_N16ROT", "--FeatureMatching.type")


@pytest.mark.parametrize("seed", range(8))
def test_mutated_model_is_one_line_or_a_result(scene, localize, tmp_path, models_with, seed):
    random = np.random.default_rng(seed)
    content = bytearray((MODELS_PATH / EXTRACTOR).read_bytes())
    for place in random.integers(0, len(content), 200):
        content[place] = random.integers(0, 256)
    models = models_with(EXTRACTOR, content)
    query = scene.photos.write_queries(tmp_path / "query.txt", scene.photos.query_names[:1])
    run = localize(*scene.arguments(query, models=models))
    if run.exit_code == 0:
        assert set(run.results) == set(scene.photos.query_names[:1])
    else:
        assert_refused(run, models / EXTRACTOR)


def test_impossible_option_is_named(scene, queries, localize):
    run = localize(*scene.arguments(queries)[:-4], "--onnx_path", MODELS_PATH, "--AlikedExtraction.max_num_features", 0)
    assert_refused(run, "option --AlikedExtraction.max_num_features must be >= 1, but is 0")


@pytest.mark.parametrize("matcher, orientation", [("ALIKED_BRUTEFORCE", 3), ("ALIKED_LIGHTGLUE", 6)])
def test_photo_that_exif_turns_matches_as_upright(scene, localize, tmp_path, matcher, orientation):
    """It has as many inliers as the upright photo, and the pose of its stored pixels."""
    name = scene.photos.query_names[0]
    inliers = {}
    for each in (1, orientation):
        write_oriented(tmp_path / f"{each}.jpg", scene.photos.image_path / name, each)
        line = f"{each}.jpg {stored_camera(CAMERA, each).text()}\n"
        (tmp_path / "queries.txt").write_text(line)
        arguments = scene.arguments(tmp_path / "queries.txt", "--FeatureMatching.type", matcher)
        arguments[arguments.index("--image_path") + 1] = tmp_path
        run = localize(*arguments)
        (result,) = run.results.values()
        assert result["status"] == "LOCALIZED", result["reason"]
        position_error, rotation_error_deg = run.poses[f"{each}.jpg"].errors(
            stored_pose(scene.photos.poses[name], each)
        )
        assert position_error < 0.05 and rotation_error_deg < 0.3
        inliers[each] = [pair["num_inliers"] for pair in result["pairs"]]
    assert sum(inliers[orientation]) == pytest.approx(sum(inliers[1]), rel=0.1)
