"""Tests of `--LazyLocalizer.intrinsics` with queries whose focal length is wrong."""

import dataclasses

import numpy as np
import pytest

from colmap_lazyloc.model import read_model
from colmap_lazyloc.testing import synthetic

SEEK = ("--LazyLocalizer.intrinsics", "refine")
FACTOR = 1.3


def strip_seconds(run):
    return {name: {**result, "seconds": None} for name, result in run.results.items()}


@pytest.fixture(scope="module", params=["pose", None])
def guessed(request, tmp_path_factory, noisy, write_scene_files):
    """Changes the noisy scene: the queries' shared camera has a focal length without prior, 1.3 times too long.

    The stored geometries are wrong, but their inliers are right; or the database has raw matches only.
    """
    scene = noisy.scene.copy()
    camera = scene.cameras[2]
    camera.has_prior_focal_length = False
    camera.params[:2] = [FACTOR * focal for focal in camera.params[:2]]
    for (_, name2), pair in scene.pairs.items():
        if name2 in scene.query_names:
            pair.config = 3  # uncalibrated
            pair.direction = np.array([0.6, 0, 0.8])
    return write_scene_files(tmp_path_factory.mktemp("guessed"), scene, geometry=request.param)


def test_focal_length_and_poses_are_found(localize, guessed, noisy):
    run = localize(*guessed.arguments, *SEEK)
    run.assert_localized(noisy.scene, noisy.scene.query_names, 0.03, 0.3)
    truth = noisy.scene.cameras[2]
    cameras = read_model(run.output_path / "model").cameras
    own_ids = {run.model_images[name].camera_id for name in noisy.scene.query_names}
    assert len(own_ids) == len(noisy.scene.query_names), "each query has a focal length of its own"
    for name in noisy.scene.query_names:
        camera = run.results[name]["camera"]
        assert (camera["model"], camera["width"], camera["height"]) == ("PINHOLE", truth.width, truth.height)
        assert camera["params"] == pytest.approx(truth.params, rel=0.01)
        assert cameras[run.model_images[name].camera_id].params == tuple(camera["params"])
    assert cameras[1].params == tuple(noisy.scene.cameras[1].params)


def test_given_focal_length_is_refused_or_only_warned_of(localize, guessed, noisy):
    """The camera counts as given, because its principal point or focal length is not COLMAP's default."""
    refused = localize(*guessed.arguments)
    warned = localize(*guessed.arguments, SEEK[0], "given", "--LazyLocalizer.min_confidence", 0)
    assert set(refused.statuses.values()) == {"INCONSISTENT_INTRINSICS"}
    for name in noisy.scene.query_names:
        result = refused.results[name]
        assert "focal length of" in result["reason"]
        assert result["intrinsics"]["origin"] == "given"
        assert result["intrinsics"]["verdict"] == "contradicted"
        assert result["intrinsics"]["focal_factor"] == pytest.approx(1 / FACTOR, rel=0.01)
    for name, result in warned.results.items():
        if result["status"] == "LOCALIZED" and result["intrinsics"]["contradiction"]:
            assert f"query {name}: the images " in warned.stderr
    assert "LOCALIZED" in warned.statuses.values()
    assert not any("camera" in result for result in warned.results.values())


def test_right_focal_length_is_confirmed(localize, noisy):
    run = localize(*noisy.arguments)
    assert {result["intrinsics"]["verdict"] for result in run.results.values()} == {"confirmed"}
    for result in run.results.values():
        assert result["intrinsics"]["focal_factor"] == pytest.approx(1, abs=0.02)


def test_bad_value_of_the_option(localize, noisy):
    run = localize(*noisy.arguments, SEEK[0], "exif")
    assert run.exit_code == 1
    assert "must be one of auto, given, refine" in run.stderr


def test_result_is_the_same_for_any_number_of_threads(localize, guessed):
    one, three = (localize(*guessed.arguments, *SEEK, "--LazyLocalizer.num_threads", num) for num in (1, 3))
    assert one.poses_bytes == three.poses_bytes
    assert strip_seconds(one) == strip_seconds(three)


@pytest.mark.parametrize(
    ("true_factor", "exif_factor", "verdict", "source", "tolerance"),
    [
        (1, 1.1, "confirmed", "database_camera", 1e-9),  # EXIF is wrong as it often is
        (1, 1.5, "refined", "database", 0.01),  # so wrong that it speaks against the camera of the database
        (1.15, 1.15, "refined", "database_camera", 0.01),  # zoomed: the focal length of the database's camera is wrong
    ],
)
def test_camera_of_the_database_comes_before_exif(
    localize, noisy, write_scene_files, tmp_path, true_factor, exif_factor, verdict, source, tolerance
):
    scene = noisy.scene.copy()
    shared = scene.cameras[1]
    scene.query_names = ["database/003.jpg", "database/005.jpg"]
    params = [exif_factor * shared.params[0], shared.width / 2, shared.height / 2, 0.0]
    scene.cameras[3] = synthetic.Camera(3, "SIMPLE_RADIAL", shared.width, shared.height, params, True)
    true_camera = dataclasses.replace(shared, params=[true_factor * shared.params[0], *shared.params[1:]])
    rng = np.random.default_rng(5)
    for name in scene.query_names:
        image = scene.images[name]
        image.camera_id = 3
        seen = image.point_of_keypoint >= 0
        points_in_cam = image.pose(scene.points[image.point_of_keypoint[seen]])
        image.keypoints[seen] = true_camera.image_from_cam(points_in_cam) + rng.normal(0, 0.5, (np.sum(seen), 2))
    files = write_scene_files(tmp_path, scene, geometry=None)
    run = localize(*files.arguments, "--ImageReader.single_camera_per_image", 1)
    run.assert_localized(scene, scene.query_names, 0.05, 0.5)
    cameras = read_model(run.output_path / "model").cameras
    for name in scene.query_names:
        result = run.results[name]
        assert result["intrinsics_source"] == source
        assert result["intrinsics"]["origin"] == ("shared" if source == "database_camera" else "exif")
        assert result["intrinsics"]["verdict"] == verdict
        focal_length = cameras[run.model_images[name].camera_id].params[0]
        assert focal_length == pytest.approx(true_factor * shared.params[0], rel=tolerance)
