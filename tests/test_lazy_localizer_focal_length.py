"""Tests of `--LazyLocalizer.refine_focal_length`: cameras without a prior focal length whose given one is wrong."""

import numpy as np
import pytest

from colmap_lazyloc.model import read_model

SEEK = ("--LazyLocalizer.refine_focal_length", 1)
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


def test_without_the_option_the_guess_is_taken_as_it_is(localize, guessed):
    run, switched_off = localize(*guessed.arguments), localize(*guessed.arguments, SEEK[0], 0)
    assert run.exit_code == 0
    assert strip_seconds(run) == strip_seconds(switched_off)
    assert not any("camera" in result for result in run.results.values())


def test_prior_focal_length_stays(localize, noisy):
    run, sought = localize(*noisy.arguments), localize(*noisy.arguments, *SEEK)
    assert sought.poses_bytes == run.poses_bytes
    assert strip_seconds(sought) == strip_seconds(run)


def test_camera_of_a_query_list_counts_as_prior(localize, guessed, noisy, tmp_path):
    queries = tmp_path / "queries.txt"
    words = noisy.scene.cameras[2].intrinsics().text()
    queries.write_text("".join(f"{name} {words}\n" for name in noisy.scene.query_names))
    run = localize(*guessed.arguments, "--query_list_path", queries, *SEEK)
    run.assert_localized(noisy.scene, noisy.scene.query_names, 0.03, 0.3)
    assert not any("camera" in result for result in run.results.values())


def test_leave_one_out_takes_the_prior_flag_of_the_database(localize, guessed):
    """The flag comes from the database, because a model does not say whether its focal lengths are prior."""
    run = localize(*guessed.arguments, "--LazyLocalizer.leave_one_out", 1, *SEEK)
    assert set(run.statuses.values()) == {"LOCALIZED"}
    assert not any("camera" in result for result in run.results.values())


def test_result_is_the_same_for_any_number_of_threads(localize, guessed):
    one, three = (localize(*guessed.arguments, *SEEK, "--LazyLocalizer.num_threads", num) for num in (1, 3))
    assert one.poses_bytes == three.poses_bytes
    assert strip_seconds(one) == strip_seconds(three)
