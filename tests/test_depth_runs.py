"""Depth maps in runs of every kind: groups and rigs, shards, runs that go on, Python."""

import contextlib
import json
import shutil
import sqlite3
import warnings

import numpy as np
import pytest

import colmap_lazyloc as ll
from colmap_lazyloc.testing import synthetic
from conftest import write_scene
from test_lazy_localizer_groups import trajectory_lines
from test_python_localizer import assert_same_poses, open_localizer, without_times
from test_resume import output_bytes, start  # noqa: F401
from test_shards import assert_merged_is_whole, make_shards, merge  # noqa: F401

METRIC = "--LazyLocalizer.depth_is_metric", "1"
ONE_IMAGE = "--LazyLocalizer.num_retrieved", "1"
NUM_QUERIES = 60


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    scene = synthetic.make_scene(synthetic.arc(4), synthetic.arc(NUM_QUERIES, radius=5, height=0.8), noise_px=0.5)
    return write_scene(tmp_path_factory.mktemp("many"), scene)


@pytest.fixture
def maps(many, tmp_path):
    return synthetic.write_depth_maps(tmp_path / "maps", many.scene)


@pytest.fixture
def arguments(many, maps):
    return [*many.arguments, *ONE_IMAGE, "--depth_path", str(maps), *METRIC]


def change_one_depth(path):
    """Changes a depth, but not the size of the file."""
    depths = np.load(path)
    row, column = np.argwhere(np.isfinite(depths))[0]
    depths[row, column] *= 1.1
    np.save(path, depths)


# Groups


@pytest.fixture(scope="module")
def one_place(tmp_path_factory):
    """Makes queries that only one database image sees: without depth, their common scale is unobservable."""
    scene = synthetic.make_scene([[0.3, 0.2, -6]], synthetic.arc(3, radius=5, height=-0.7), noise_px=0.3)
    return write_scene(tmp_path_factory.mktemp("one_place"), scene)


@pytest.mark.parametrize("kind", ["group", "rigid", "rigid_without_scale"])
def test_one_image_for_a_group(localize, one_place, tmp_path, kind):
    scene = one_place.scene
    arguments = [*one_place.arguments]
    if kind == "group":
        arguments += ["--LazyLocalizer.group_size", 3]
    else:
        path = tmp_path / "trajectory.txt"
        path.write_text(trajectory_lines(scene, scene.query_names), encoding="utf-8")
        arguments += ["--query_trajectory_path", path]
        arguments += ["--LazyLocalizer.Advanced.trajectory_has_scale", int(kind == "rigid")]
    if kind != "rigid":
        assert "LOCALIZED" not in localize(*arguments).statuses.values()
    folder = synthetic.write_depth_maps(tmp_path / "maps", scene)
    done = localize(*arguments, "--depth_path", folder, *METRIC)
    done.assert_localized(scene, scene.query_names, 0.1, 0.5)
    for name in scene.query_names:
        depth = done.results[name]["depth"]
        assert [(entry["name"], entry["verdict"]) for entry in depth["maps"]] == [(scene.database_names[0], "used")]
        assert depth["num_points"] > 50
        if kind == "group":
            assert depth["fixes"] == "distance"


# Runs in parts


def test_shards_are_the_run(localize, merge, make_shards, arguments, tmp_path):  # noqa: F811
    whole = assert_merged_is_whole(localize, merge, make_shards, tmp_path, arguments, [3])
    assert all(result["depth"]["fixes"] == "distance" for result in whole.results.values())
    assert set(whole.statuses.values()) == {"LOCALIZED"}


def test_merger_refuses_shards_with_other_maps(localize, merge, arguments, maps, tmp_path):  # noqa: F811
    for index in (1, 2):
        done = localize(*arguments, "--shard", f"{index}/2", output_path=tmp_path / "shards" / str(index))
        assert done.exit_code == 0, done.stderr
        change_one_depth(maps / "database/002.jpg.npy")
    done = merge(tmp_path / "shards", tmp_path / "merged")
    assert done.returncode == 1 and "(--depth_path) has changed" in done.stderr


@pytest.fixture
def unfinished(start, many, arguments, tmp_path):  # noqa: F811
    process = start(*arguments[4:], files=many)
    process.kill()
    process.communicate()
    return tmp_path / "output"


def test_run_goes_on(localize, arguments, unfinished):
    done = localize(*arguments, "--resume", 1, output_path=unfinished)
    assert done.exit_code == 0, done.stderr
    assert output_bytes(unfinished) == output_bytes(localize(*arguments).output_path)


@pytest.mark.parametrize("change", ["depth", "new file", "no file", "no maps"])
def test_run_with_other_maps_does_not_go_on(localize, many, arguments, maps, unfinished, change):
    if change == "depth":
        change_one_depth(maps / "database/001.jpg.npy")
    elif change == "new file":
        shutil.copy(maps / "database/001.jpg.npy", maps / "database/new.npy")
    elif change == "no file":
        (maps / "database/001.jpg.npy").unlink()
    else:
        shutil.rmtree(maps)
        maps.mkdir()
    done = localize(*arguments, "--resume", 1, output_path=unfinished)
    assert done.exit_code == 1 and done.stderr.count("\n") == 1
    assert f"{maps} (--depth_path) has changed" in done.stderr


def test_copied_maps_are_the_same(localize, arguments, maps, unfinished, tmp_path):
    """A copy on another machine has other times and another place."""
    copy = shutil.copytree(maps, tmp_path / "copy", copy_function=shutil.copyfile)
    moved = [str(copy) if argument == str(maps) else argument for argument in arguments]
    done = localize(*moved, "--resume", 1, output_path=unfinished)
    assert done.exit_code == 0, done.stderr


# Python


def test_python_has_the_results_of_the_program(localize, arguments):
    run = localize(*arguments)
    localizer = open_localizer(arguments)
    results = list(localizer.localize_all())
    assert_same_poses(results, run)
    lines = (run.output_path / "results.jsonl").read_text(encoding="utf-8").splitlines()
    for result, line in zip(sorted(results, key=lambda result: result.name), lines, strict=True):
        assert without_times(result.as_dict()) == without_times(json.loads(line))


def matches_of(scene, name, database_name):
    return scene.pairs[database_name, name].matches[:, ::-1]


@pytest.mark.parametrize("gives_keypoints", [False, True])
def test_python_uses_depth_for_matches(many, maps, gives_keypoints):
    """Keypoints of a caller's own are looked up in the map."""
    options = {"depth_path": maps, "depth_is_metric": 1}
    name, database_name = many.scene.query_names[10], many.scene.database_names[1]
    image, other = many.scene.images[name], many.scene.images[database_name]
    camera = many.scene.cameras[image.camera_id]
    matches = matches_of(many.scene, name, database_name)
    keypoints, pair = image.keypoints[:, :2], matches
    if gives_keypoints:
        order = np.random.default_rng(0).permutation(len(other.keypoints))
        pair = (other.keypoints[order, :2], np.stack([matches[:, 0], np.argsort(order)[matches[:, 1]]], axis=1))
    words = " ".join(map(str, [camera.model, camera.width, camera.height, *camera.params]))
    with ll.Localizer(many.database_path, many.model_path, options=options) as localizer:
        result = localizer.localize_matches(words, keypoints, {database_name: pair}, name=name)
    assert result.is_localized, result.reason
    assert result.pose.errors(image.pose)[0] < 0.1
    assert result.as_dict()["depth"]["fixes"] == "distance"


def test_python_rig_with_depth(one_place, tmp_path):
    folder = synthetic.write_depth_maps(tmp_path, one_place.scene)
    options = {"depth_path": folder, "depth_is_metric": 1}
    with ll.Localizer(one_place.database_path, one_place.model_path, options=options) as localizer:
        poses = {name: one_place.scene.images[name].pose for name in one_place.scene.query_names}
        for name, result in localizer.localize_trajectory(poses, has_scale=False).items():
            assert result.is_localized, result.reason
            assert result.pose.errors(poses[name])[0] < 0.1


def test_python_warns_once_of_an_unusable_map(many, maps):
    name = many.scene.database_names[0]
    (maps / f"{name}.npy").write_bytes(b"not an array")
    (maps / f"{many.scene.database_names[1]}.npy").unlink()
    options = {"depth_path": maps}
    with ll.Localizer(many.database_path, many.model_path, options=options) as localizer:
        with pytest.warns(UserWarning, match=f"no depth for image {name}") as caught:
            localizer.localize(many.scene.query_names[0])
        assert len(caught) == 1
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            localizer.localize(many.scene.query_names[1])


def test_python_without_database_has_no_depth(many, maps):
    with pytest.raises(ll.InputError, match="option depth_path needs a database"):
        ll.Localizer(None, many.model_path, options={"depth_path": maps})


def test_damaged_pair_of_database_images_is_left_out(localize, noisy, tmp_path):
    """Points of the other pairs still tell the scale of the maps."""
    database = shutil.copy(noisy.database_path, tmp_path / "database.db")
    with contextlib.closing(sqlite3.connect(database)) as connection, connection:
        smallest = "SELECT MIN(pair_id) FROM two_view_geometries"
        connection.execute(f"UPDATE two_view_geometries SET data = x'00' WHERE pair_id = ({smallest})")
    folder = synthetic.write_depth_maps(tmp_path / "maps", noisy.scene, lambda depths, rng: depths / 2)
    done = localize("--database_path", database, "--input_path", noisy.model_path, *ONE_IMAGE, "--depth_path", folder)
    assert done.exit_code == 0, done.stderr
    done.assert_localized(noisy.scene, noisy.scene.query_names, 0.05, 0.3)
