"""Tests of photos that the SIFT features of a database do not localize, and ALIKED features by LightGlue do."""

import dataclasses
import pathlib
import signal
import subprocess

import cv2
import numpy as np
import pytest

import colmap_lazyloc as ll
from benchmarks.photos.degraded_photos import haze
from conftest import DATA_PATH, assert_refused

pytest.importorskip("onnxruntime")

MODELS_PATH = DATA_PATH.parent / "models"
pytestmark = pytest.mark.skipif(not MODELS_PATH.is_dir(), reason=f"{MODELS_PATH} is missing")
EXTRACTOR, BRUTE_FORCE, LIGHTGLUE = "aliked-n16rot.onnx", "bruteforce-matcher.onnx", "aliked-lightglue.onnx"
HAZE = 40  # SIFT finds nothing in it
NUM_FEATURES = 500
FIRST, SECOND = "SIFT_BRUTEFORCE", "ALIKED_LIGHTGLUE"


@dataclasses.dataclass
class HazyScene:
    photos: object  # of photo_scene
    image_path: pathlib.Path
    query_list_path: pathlib.Path
    clear: str  # names of the queries
    hazy: str

    def arguments(self, *more, image_path=None, num_features=NUM_FEATURES):
        options = ["--AlikedExtraction.max_num_features", num_features]
        words = [*self.photos.arguments(self.query_list_path), *options]
        words[words.index("--image_path") + 1] = image_path or self.image_path
        return [*words, *more]

    def assert_localized(self, run):
        """Checks the poses of both queries, and what matched them."""
        assert run.exit_code == 0, run.stderr
        for name, original, kind in (
            (self.clear, self.clear, FIRST),
            (self.hazy, self.photos.query_names[1], SECOND),
        ):
            result = run.results[name]
            assert (result["status"], result["matching_type"]) == ("LOCALIZED", kind), result["reason"]
            position_error, rotation_error_deg = run.poses[name].errors(self.photos.poses[original])
            assert position_error < 0.15 and rotation_error_deg < 1, name


@pytest.fixture(scope="module")
def scene(photos, tmp_path_factory):
    folder = tmp_path_factory.mktemp("hazy")
    image_path = folder / "images"
    image_path.mkdir()
    (image_path / "database").symlink_to(photos.image_path / "database")
    (image_path / "query").mkdir()
    clear, original = photos.query_names
    (image_path / clear).symlink_to(photos.image_path / clear)
    hazy = "query/hazy.png"
    photo = cv2.imread(str(photos.image_path / original))
    assert cv2.imwrite(str(image_path / hazy), haze(photo, HAZE, np.random.default_rng(0)))
    query_list_path = photos.write_queries(folder / "queries.txt", [clear, hazy])
    return HazyScene(photos, image_path, query_list_path, clear, hazy)


@pytest.fixture(scope="module")
def with_models(scene, localize):
    return localize(*scene.arguments("--onnx_path", MODELS_PATH))


@pytest.fixture
def models(tmp_path):
    """Makes a folder with links to the models."""
    folder = tmp_path / "models"
    folder.mkdir()
    for name in (EXTRACTOR, BRUTE_FORCE, LIGHTGLUE):
        (folder / name).symlink_to(MODELS_PATH / name)
    return folder


def without_seconds(run):
    return {
        name: {key: value for key, value in result.items() if key != "seconds"} for name, result in run.results.items()
    }


def test_aliked_features_localize_what_sift_does_not(scene, localize, with_models, fingerprint):
    before = fingerprint(scene.photos.folder)
    without = localize(*scene.arguments())
    assert without.statuses[scene.clear] == "LOCALIZED" != without.statuses[scene.hazy]
    assert without.results[scene.hazy]["matching_type"] == FIRST
    scene.assert_localized(with_models)
    assert f"{SECOND}" in with_models.stderr and SECOND not in without.stderr
    assert without_seconds(without)[scene.clear] == without_seconds(with_models)[scene.clear]
    assert len(with_models.pair_names(scene.hazy)) <= 5
    assert fingerprint(scene.photos.folder) == before


def test_points_of_the_model_project_to_stored_keypoints(with_models):
    """Also if the features of the fallback are others than those of the database."""
    pycolmap = pytest.importorskip("pycolmap", minversion="4")
    model = pycolmap.Reconstruction(with_models.output_path / "model")
    errors_px = [
        np.linalg.norm(image.project_point(model.points3D[pixel.point3D_id].xyz) - pixel.xy)
        for image in model.images.values()
        for pixel in image.get_observation_points2D()
    ]
    assert len(errors_px) > 100 and np.max(errors_px) < 20


def test_model_of_merged_shards_is_the_same(scene, localize, with_models, colmap, tmp_path):
    for shard in ("1", "2"):
        words = scene.arguments("--onnx_path", MODELS_PATH, "--shard", f"{shard}/2")
        localize(*words, output_path=tmp_path / "shards" / shard)
    merged = tmp_path / "merged"
    words = [colmap, "lazy_merger", "--input_path", tmp_path / "shards", "--output_path", merged]
    subprocess.run(list(map(str, words)), check=True, capture_output=True, timeout=300)
    points = [(folder / "model" / "points3D.bin").read_bytes() for folder in (with_models.output_path, merged)]
    assert points[0] == points[1]


def test_group_keeps_the_better_attempt_for_each_photo(scene, localize, with_models):
    run = localize(*scene.arguments("--onnx_path", MODELS_PATH, "--LazyLocalizer.group_size", 2))
    scene.assert_localized(run)
    for name in (scene.clear, scene.hazy):
        alone, grouped = with_models.poses[name], run.poses[name]
        position_error, rotation_error_deg = grouped.errors(alone)
        assert position_error < 0.02 and rotation_error_deg < 0.2, name


@pytest.mark.parametrize("num_threads", [1, 3])
def test_threads_do_not_change_the_result(scene, localize, with_models, num_threads):
    run = localize(*scene.arguments("--onnx_path", MODELS_PATH, "--LazyLocalizer.num_threads", num_threads))
    assert without_seconds(run) == without_seconds(with_models)


def test_killed_run_goes_on(scene, colmap, localize, with_models, tmp_path, models):
    output_path = tmp_path / "output"
    arguments = scene.arguments("--onnx_path", models, "--LazyLocalizer.num_threads", 1, "--output_path", output_path)
    process = subprocess.Popen([str(word) for word in (colmap, "lazy_localizer", *arguments)], stdout=subprocess.PIPE)
    process.stdout.readline()
    process.send_signal(signal.SIGKILL)
    process.wait()
    (models / "more.onnx").write_bytes(b"another model")
    changed = localize(*scene.arguments("--onnx_path", models, "--resume", 1), output_path=output_path)
    assert changed.exit_code == 1 and "onnx_path" in changed.stderr
    (models / "more.onnx").unlink()
    run = localize(*scene.arguments("--onnx_path", models, "--resume", 1), output_path=output_path)
    assert without_seconds(run) == without_seconds(with_models)


def test_features_of_database_images_are_kept_beside_the_index(scene, localize, models, tmp_path):
    index_path = tmp_path / "index"
    kept = tmp_path / "index.aliked"

    def run(**changes):
        done = localize(*scene.arguments("--retrieval_index_path", index_path, "--onnx_path", models, **changes))
        scene.assert_localized(done)
        return without_seconds(done), {path: path.stat().st_mtime_ns for path in kept.iterdir()}

    first, files = run()
    assert len(files) == len(scene.photos.database_names)
    assert run() == (first, files)
    paths = sorted(files)
    paths[0].write_bytes(paths[0].read_bytes()[:-1])  # cut
    paths[1].write_bytes(paths[2].read_bytes())  # of another image
    paths[3].write_bytes(b"")
    paths[4].unlink()
    paths[4].mkdir()
    again, mended = run()
    assert again == first
    assert [path for path in paths if mended[path] == files[path]] == [paths[2], paths[5]]
    assert run() == (first, mended)
    _, of_fewer = run(num_features=400)
    assert not set(of_fewer.values()) & set(mended.values())


def test_folder_that_cannot_be_written_is_no_error(scene, localize, with_models, tmp_path):
    (tmp_path / "index.aliked").write_text("a file")
    run = localize(*scene.arguments("--retrieval_index_path", tmp_path / "index", "--onnx_path", MODELS_PATH))
    scene.assert_localized(run)
    assert (tmp_path / "index.aliked").read_text() == "a file"


def test_changed_image_file_is_extracted_again(scene, localize, tmp_path):
    image_path = tmp_path / "images"
    (image_path / "database").mkdir(parents=True)
    (image_path / "query").symlink_to(scene.image_path / "query")
    for name in scene.photos.database_names:
        (image_path / name).write_bytes((scene.image_path / name).read_bytes())
    arguments = ["--retrieval_index_path", tmp_path / "index", "--onnx_path", MODELS_PATH]
    scene.assert_localized(localize(*scene.arguments(*arguments, image_path=image_path)))
    for name in scene.photos.database_names[:3]:
        blank = np.full((10, 20, 3), 128, np.uint8)  # not of the size of its camera
        cv2.imwrite(str(image_path / name), blank)
    (image_path / scene.photos.database_names[3]).write_bytes(b"no image")
    run = localize(*scene.arguments(*arguments, image_path=image_path))
    assert set(run.pair_names(scene.hazy)) <= set(scene.photos.database_names[4:])


def test_without_database_images_there_is_a_warning(scene, localize, tmp_path):
    (tmp_path / "query").symlink_to(scene.image_path / "query")
    run = localize(*scene.arguments("--onnx_path", MODELS_PATH, image_path=tmp_path))
    assert run.exit_code == 0
    assert f"WARNING: none of the database images is below --image_path {tmp_path}" in run.stderr
    assert run.statuses[scene.hazy] != "LOCALIZED" == run.statuses[scene.clear]


@pytest.mark.parametrize("damaged", [EXTRACTOR, LIGHTGLUE])
def test_unusable_models_are_one_line_where_they_are_needed(scene, localize, models, damaged):
    content = (models / damaged).read_bytes()
    (models / damaged).unlink()
    (models / damaged).write_bytes(content[: len(content) // 2])
    run = localize(*scene.arguments("--onnx_path", models))
    assert run.exit_code == 1
    (error,) = (line for line in run.stderr.splitlines() if line.startswith("ERROR: "))
    assert f"{models / damaged}: is not the ONNX model that is needed here" in error
    clear = scene.photos.write_queries(scene.query_list_path.with_name("clear.txt"), [scene.clear])
    run = localize(*dataclasses.replace(scene, query_list_path=clear).arguments("--onnx_path", models))
    assert run.statuses == {scene.clear: "LOCALIZED"}


def test_missing_models_are_one_line(scene, localize, models, tmp_path):
    assert_refused(localize(*scene.arguments("--onnx_path", tmp_path / "none")), "--onnx_path", "none", EXTRACTOR)
    assert_refused(localize(*scene.arguments("--FeatureMatching.type", SECOND)), "--onnx_path", EXTRACTOR)
    for name in (LIGHTGLUE, BRUTE_FORCE):
        (models / name).unlink()
    assert_refused(localize(*scene.arguments("--onnx_path", models)), "--onnx_path", models, LIGHTGLUE)


def test_brute_force_does_without_lightglue(scene, localize, models):
    (models / LIGHTGLUE).unlink()
    (models / BRUTE_FORCE).rename(models / f"0123abcd-{BRUTE_FORCE}")  # as COLMAP names what it downloads
    run = localize(*scene.arguments("--onnx_path", models))
    assert run.exit_code == 0 and "matched by ALIKED_BRUTEFORCE" in run.stderr
    run = localize(*scene.arguments("--onnx_path", models, "--FeatureMatching.type", "ALIKED_BRUTEFORCE"))
    result = run.results[scene.clear]
    assert (result["status"], result["matching_type"]) == ("LOCALIZED", "ALIKED_BRUTEFORCE")


def test_lightglue_may_match_all_photos(scene, localize):
    run = localize(*scene.arguments("--onnx_path", MODELS_PATH, "--FeatureMatching.type", SECOND))
    assert {result["matching_type"] for result in run.results.values()} == {SECOND}
    assert set(run.statuses.values()) == {"LOCALIZED"}


def test_photos_in_python(scene, with_models):
    options = {
        "image_path": scene.image_path,
        "onnx_path": MODELS_PATH,
        "AlikedExtraction.max_num_features": NUM_FEATURES,
    }
    with ll.Localizer(scene.photos.database_path, scene.photos.model_path, options=options) as localizer:
        hazy, clear = (localizer.localize_photo(name, scene.photos.camera_words) for name in (scene.hazy, scene.clear))
    assert hazy.is_localized and hazy.pose.bits() == with_models.poses[scene.hazy].bits()
    assert hazy.as_dict()["matching_type"] == SECOND and clear.as_dict()["matching_type"] == FIRST
    assert 0 < len(hazy.keypoints) <= NUM_FEATURES
