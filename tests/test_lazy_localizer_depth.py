"""Depth maps of database images: one image is enough, wrong maps do no harm, unusable files cost a warning."""

import json
import shutil

import numpy as np
import pytest

from colmap_lazyloc.testing import synthetic
from conftest import write_scene

METRIC = "--LazyLocalizer.depth_is_metric", "1"
ONE_IMAGE = "--LazyLocalizer.num_retrieved", "1"
WRONG = {
    "random": lambda depths, rng: rng.uniform(1, 9, len(depths)),
    "inverse": lambda depths, rng: 30 / depths,
    "shuffled": lambda depths, rng: rng.permutation(depths),
}


@pytest.fixture(scope="module")
def apart(tmp_path_factory):
    """Makes a noisy scene whose database images have no common matches."""
    scene = synthetic.make_scene(synthetic.arc(9), synthetic.arc(3, radius=5, height=-0.7, phase=4), noise_px=0.5)
    return write_scene(tmp_path_factory.mktemp("apart"), scene)


@pytest.fixture(scope="module")
def maps(noisy, tmp_path_factory):
    """Writes maps of the noisy scene with errors of 1 %."""
    folder = tmp_path_factory.mktemp("maps")
    return synthetic.write_depth_maps(
        folder, noisy.scene, lambda depths, rng: depths * rng.normal(1, 0.01, len(depths))
    )


def errors(done, scene):
    return np.array([done.poses[name].errors(scene.images[name].pose) for name in scene.query_names])


def depth_maps_of(done, name):
    return {entry["name"]: entry for entry in done.results[name]["depth"]["maps"]}


def test_one_image_with_a_metric_map(localize, apart, tmp_path):
    """Without matches between database images, the map's scale is what the option states."""
    folder = synthetic.write_depth_maps(tmp_path, apart.scene)
    lost = localize(*apart.arguments, *ONE_IMAGE)
    assert set(lost.statuses.values()) == {"SCALE_UNOBSERVABLE"}
    unstated = localize(*apart.arguments, *ONE_IMAGE, "--depth_path", str(folder))
    assert set(unstated.statuses.values()) == {"SCALE_UNOBSERVABLE"}
    done = localize(*apart.arguments, *ONE_IMAGE, "--depth_path", str(folder), *METRIC)
    done.assert_localized(apart.scene, apart.scene.query_names, 0.05, 0.3)
    for name in apart.scene.query_names:
        result = done.results[name]
        assert result["depth"]["fixes"] == "distance"
        (entry,) = depth_maps_of(done, name).values()
        assert entry["verdict"] == "used" and entry["scale"] == 1
        # The error of the map's scale is common to all its points: it is that of the baseline.
        database_centre = apart.scene.images[entry["name"]].pose.cam_in_world
        baseline = np.linalg.norm(apart.scene.images[name].pose.cam_in_world - database_centre)
        assert result["position_stddevs"][0] >= 0.9 * entry["scale_stddev_ratio"] * baseline
    for name in apart.scene.query_names:
        assert depth_maps_of(unstated, name).popitem()[1]["verdict"] == "no_scale"


@pytest.mark.parametrize("factor", [1 / 3, 3])
def test_points_of_database_images_tell_the_scale(localize, noisy, tmp_path, factor):
    folder = synthetic.write_depth_maps(tmp_path, noisy.scene, lambda depths, rng: factor * depths)
    for arguments in ((), METRIC):
        done = localize(*noisy.arguments, *ONE_IMAGE, "--depth_path", str(folder), *arguments)
        done.assert_localized(noisy.scene, noisy.scene.query_names, 0.05, 0.3)
        for name in noisy.scene.query_names:
            (entry,) = depth_maps_of(done, name).values()
            assert entry["scale"] == pytest.approx(1 / factor, rel=0.02)


def test_depth_with_several_images_does_no_harm(localize, noisy, maps, tmp_path):
    few = "--LazyLocalizer.num_retrieved", "3"
    for options in ((), few, (*few, "--LazyLocalizer.intrinsics", "refine")):
        without = errors(localize(*noisy.arguments, *options), noisy.scene)
        right = localize(*noisy.arguments, *options, "--depth_path", str(maps))
        assert np.all(errors(right, noisy.scene) <= 1.1 * without + (2e-3, 0.01)), options
        for name in noisy.scene.query_names:
            assert right.results[name]["depth"]["fixes"] == "nothing"
            assert {entry["verdict"] for entry in depth_maps_of(right, name).values()} == {"used"}
    without = errors(localize(*noisy.arguments, *few), noisy.scene)
    for kind, disturb in WRONG.items():
        folder = synthetic.write_depth_maps(tmp_path / kind, noisy.scene, disturb)
        wrong = localize(*noisy.arguments, *few, "--depth_path", str(folder), *METRIC)
        assert np.all(errors(wrong, noisy.scene) <= 1.01 * without + (1e-4, 1e-3)), kind
        for name in noisy.scene.query_names:
            assert {entry["verdict"] for entry in depth_maps_of(wrong, name).values()} == {"contradicted"}


def test_wrong_map_of_the_only_image_is_left_out(localize, noisy, tmp_path):
    folder = synthetic.write_depth_maps(tmp_path, noisy.scene, WRONG["random"])
    done = localize(*noisy.arguments, *ONE_IMAGE, "--depth_path", str(folder), *METRIC)
    assert set(done.statuses.values()) == {"SCALE_UNOBSERVABLE"}
    assert "depth maps left out" in done.stderr


def test_unusable_maps_cost_a_warning(localize, noisy, maps, tmp_path):
    folder = shutil.copytree(maps, tmp_path / "maps")
    names = noisy.scene.database_names
    path = {name: folder / f"{name}.npy" for name in names}
    path[names[0]].unlink()
    path[names[1]].write_bytes(b"not an array")
    np.save(path[names[2]], np.zeros((480, 640), np.float32))
    np.save(path[names[3]], np.full((480, 640), np.nan))
    np.save(path[names[4]], np.ones((640, 480), np.float32))
    path[names[5]].write_bytes(path[names[5]].read_bytes()[:1000])
    done = localize(*noisy.arguments, "--depth_path", str(folder))
    assert set(done.statuses.values()) == {"LOCALIZED"}
    for name in names[1:6]:
        assert done.stderr.count(f"no depth for image {name}: {path[name]}: ") == 1
    assert done.stderr.count(f"no depth map for 1 database images (for example {names[0]})") == 1
    used = {entry["name"] for entry in done.results[noisy.scene.query_names[0]]["depth"]["maps"]}
    assert used == set(names[6:])


def test_missing_folder_is_an_error(localize, noisy, tmp_path):
    done = localize(*noisy.arguments, "--depth_path", str(tmp_path / "missing"))
    assert done.exit_code == 1 and "is not a folder" in done.stderr


def test_results_without_maps_are_those_without_the_option(localize, noisy, tmp_path):
    """An empty folder changes nothing but the warning."""
    without, empty = localize(*noisy.arguments), localize(*noisy.arguments, "--depth_path", str(tmp_path))
    assert without.poses_bytes == empty.poses_bytes
    for name, result in empty.results.items():
        assert "depth" not in result
        assert json.dumps(result["covariance"]) == json.dumps(without.results[name]["covariance"])
