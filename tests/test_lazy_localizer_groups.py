"""Tests of queries that are localized together: groups, camera rigs, trajectories."""

import contextlib
import json
import sqlite3

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colmap_lazyloc.poses import Pose, write_poses
from colmap_lazyloc.testing import synthetic
from conftest import DATA_PATH
from test_lazy_localizer_real_scenes import arguments_of, evaluated_names, true_poses

MAX_ERRORS = 1e-6, 1e-5
# The relative poses of a trajectory stay as they are.
RIGID = (
    "--LazyLocalizer.Advanced.rig_noise_px",
    0,
    "--LazyLocalizer.Advanced.database_pose_stddev_deg",
    0,
    "--LazyLocalizer.Advanced.database_pose_stddev_length",
    0,
)


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def in_own_frame(pose):
    """Returns the pose in another world frame than the database's."""
    world_from_own = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    return Pose.from_centre(pose.rotation @ world_from_own, world_from_own.T @ (pose.cam_in_world - 7))


def trajectory_lines(scene, names):
    return "".join(f"{name} {in_own_frame(scene.images[name].pose).text()}\n" for name in names)


def test_group_of_one_is_the_default(localize, noisy):
    run = localize(*noisy.arguments)
    assert localize(*noisy.arguments, "--LazyLocalizer.group_size", 1).poses_bytes == run.poses_bytes
    assert localize(*noisy.arguments, "--LazyLocalizer.Advanced.use_rigs", 0).poses_bytes == run.poses_bytes


def test_joint_group_is_exact(localize, exact):
    run = localize(*exact.arguments, "--LazyLocalizer.group_size", 3)
    run.assert_localized(exact.scene, exact.scene.query_names, *MAX_ERRORS)
    assert all(result["frame"] is None for result in run.results.values())


def test_query_without_keypoints_does_not_end_the_run_of_its_group(localize, tmp_path):
    scene = synthetic.make_scene(synthetic.arc(8), synthetic.arc(3, radius=5, height=-0.7), database_pairs=True)
    synthetic.write_model(tmp_path / "model", scene)
    synthetic.write_database(tmp_path / "database.db", scene)
    broken = scene.query_names[1]
    with contextlib.closing(sqlite3.connect(tmp_path / "database.db")) as connection:
        connection.execute(
            "DELETE FROM keypoints WHERE image_id = (SELECT image_id FROM images WHERE name = ?)", [broken]
        )
        connection.commit()
    arguments = ["--database_path", tmp_path / "database.db", "--input_path", tmp_path / "model"]
    run = localize(*arguments, "--LazyLocalizer.group_size", 3)
    assert run.exit_code == 0, run.stderr
    assert run.results[broken]["status"] == "NO_FEATURES"
    run.assert_localized(scene, [name for name in scene.query_names if name != broken], *MAX_ERRORS)


def test_group_list_is_the_group_size(localize, noisy, tmp_path):
    group_list = write(tmp_path / "groups.txt", " ".join(noisy.scene.query_names) + "\n")
    listed = localize(*noisy.arguments, "--LazyLocalizer.Advanced.group_list_path", group_list)
    assert listed.poses_bytes == localize(*noisy.arguments, "--LazyLocalizer.group_size", 3).poses_bytes


def test_result_of_groups_does_not_depend_on_threads(localize, noisy):
    runs = [
        localize(*noisy.arguments, "--LazyLocalizer.group_size", 2, "--LazyLocalizer.num_threads", number)
        for number in (1, 3)
    ]
    assert runs[0].poses_bytes == runs[1].poses_bytes


@pytest.mark.parametrize("form", ["poses", "tum", "model"])
def test_trajectory_in_a_frame_of_its_own(localize, exact, noisy, tmp_path, form):
    scene = noisy.scene
    names = scene.query_names
    if form == "poses":
        path = write(tmp_path / "trajectory.txt", trajectory_lines(scene, names))
    elif form == "tum":  # 000.jpg, 001.jpg, ...: the timestamp is the name
        lines = []
        for number, name in enumerate(names):
            pose = in_own_frame(scene.images[name].pose)
            assert name == f"query/{number:03}.jpg"
            world_from_cam = Rotation.from_matrix(pose.rotation.T).as_quat()
            lines.append(" ".join(map(str, [float(number), *pose.cam_in_world, *world_from_cam])))
        path = write(tmp_path / "trajectory.txt", "\n".join(lines) + "\n")
    else:
        moved = scene.copy()
        for name in names:
            moved.images[name].pose = in_own_frame(scene.images[name].pose)
        path = synthetic.write_model(tmp_path / "trajectory", moved, names=names)
    run = localize(*noisy.arguments, "--query_trajectory_path", path)
    run.assert_localized(scene, names, 0.02, 0.1)
    assert run.stderr == ""
    run = localize(*noisy.arguments, "--query_trajectory_path", path, *RIGID)
    run.assert_localized(scene, names, 0.02, 0.1)
    for name in names:  # the relative poses are those of the trajectory
        relative = run.poses[name].rotation @ run.poses[names[0]].rotation.T
        true_relative = scene.images[name].pose.rotation @ scene.images[names[0]].pose.rotation.T
        assert Rotation.from_matrix(relative @ true_relative.T).magnitude() <= 1e-9
        assert run.results[name]["rig_from_world"] == pytest.approx(
            run.results[names[0]]["rig_from_world"], abs=1e-9
        ) or np.allclose(run.results[name]["rig_from_world"]["tvec"], run.results[names[0]]["rig_from_world"]["tvec"])


def test_trajectory_without_scale(localize, exact, tmp_path):
    scene, names = exact.scene, exact.scene.query_names
    lines = [line.split() for line in trajectory_lines(scene, names).splitlines()]
    path = write(
        tmp_path / "trajectory.txt",
        "".join(" ".join([*words[:5], *(repr(4 * float(word)) for word in words[5:])]) + "\n" for words in lines),
    )
    run = localize(
        *exact.arguments, "--query_trajectory_path", path, "--LazyLocalizer.Advanced.trajectory_has_scale", 0
    )
    run.assert_localized(scene, names, *MAX_ERRORS)
    for name in names:
        assert run.results[name]["rig_scale"] == pytest.approx(0.25, rel=1e-4)


def test_gap_of_a_trajectory_is_localized_with_a_warning(localize, exact, tmp_path):
    names = exact.scene.query_names
    path = write(tmp_path / "trajectory.txt", trajectory_lines(exact.scene, names[:2]))
    run = localize(*exact.arguments, "--query_trajectory_path", path)
    run.assert_localized(exact.scene, names, *MAX_ERRORS)
    assert (
        run.stderr.count("\n") == 1 and "no pose for 1 query (query/002.jpg): localizing it individually" in run.stderr
    )
    assert [run.results[name]["frame"] is None for name in names] == [False, False, True]


def test_leave_one_out_leaves_the_whole_group_out(localize, noisy):
    scene = noisy.scene
    run = localize(*noisy.arguments, "--LazyLocalizer.leave_one_out", 1, "--LazyLocalizer.group_size", 3)
    names = scene.database_names
    assert sorted(run.results) == sorted(names)
    for i, name in enumerate(names):
        group = names[i - i % 3 : i - i % 3 + 3]
        assert not set(group) & set(run.pair_names(name))


def test_photos_of_a_trajectory_one_of_which_is_missing(localize, photos, tmp_path):
    names = [*photos.query_names, "query/missing.png"]
    poses = {name: in_own_frame(photos.poses[name]) for name in photos.query_names}
    poses[names[-1]] = poses[names[0]]
    path = tmp_path / "trajectory.txt"
    write_poses(path, poses)
    queries = photos.write_queries(tmp_path / "queries.txt", names)
    run = localize(*photos.arguments(queries), "--query_trajectory_path", path, *RIGID)
    photos.assert_localized(run)
    assert run.statuses[names[-1]] == "UNREADABLE_IMAGE"
    relative, true_relative = (
        all_poses[names[1]].cam_in_world - all_poses[names[0]].cam_in_world for all_poses in (run.poses, photos.poses)
    )
    assert np.linalg.norm(relative) == pytest.approx(np.linalg.norm(true_relative), rel=1e-9)


BAD_FILES = {
    "--rig_config_path": ('[{"cameras": [{"image_prefix": "front/", "ref_sensor": true}]}]', "no query matches"),
    "--LazyLocalizer.Advanced.group_list_path": ("query/000.jpg query/007.jpg\n", "'query/007.jpg' is not a query"),
    "--query_trajectory_path": ("query/007.jpg 1 0 0 0 0 0 0\n", "no pose for any query"),
}


@pytest.mark.parametrize("option", BAD_FILES)
def test_bad_file_is_one_clear_error(localize, exact, tmp_path, option):
    content, message = BAD_FILES[option]
    for path in (write(tmp_path / "bad.txt", content), tmp_path / "missing.txt"):
        run = localize(*exact.arguments, option, path)
        assert run.exit_code == 1
        assert run.stderr.startswith("ERROR") and run.stderr.count("\n") == 1
        assert str(path) in run.stderr and (message in run.stderr or "missing" in str(path))
        assert not run.output_path.exists()


needs_kitti1 = pytest.mark.skipif(
    not (DATA_PATH / "kitti1" / "database.db").exists(),
    reason=f"{DATA_PATH / 'kitti1'} is missing; LAZYLOC_SHARED_DATA names the folder of the real scenes",
)


@needs_kitti1
def test_stereo_rig_tells_its_distance_from_one_database_image(localize, tmp_path):
    """Pairs both images of a frame with the left database image before it: most points are seen at less than 1.5°."""
    truth = true_poses("kitti1")
    names = (DATA_PATH / "kitti1" / "queries.txt").read_text().split()
    pairs = "".join(f"{name} left/{int(name[-10:-4]) // 3 * 3:06d}.png\n" for name in names)
    run = localize(*arguments_of("kitti1"), "--pairs_path", write(tmp_path / "pairs.txt", pairs))
    assert set(run.statuses.values()) == {"LOCALIZED"}
    position_errors, rotation_errors_deg = np.transpose([run.poses[name].errors(truth[name]) for name in names])
    assert np.median(position_errors) <= 0.05 and max(position_errors) <= 0.2
    assert max(rotation_errors_deg) <= 0.4


@needs_kitti1
def test_stereo_rig_is_well_below_single_images(localize, tmp_path):
    """Localizes kitti1 with the database's rig, with the same rig from a configuration file, and with a wrong rig."""
    truth = true_poses("kitti1")
    names = evaluated_names("kitti1", truth)
    config_path = DATA_PATH / "kitti1" / "rig_config.json"
    rig = localize(*arguments_of("kitti1"))
    single = localize(*arguments_of("kitti1"), "--LazyLocalizer.Advanced.use_rigs", 0)
    configured = localize(*arguments_of("kitti1"), "--rig_config_path", config_path)
    for name, pose in rig.poses.items():  # the configuration has the same rig with fewer digits
        position_error, rotation_error_deg = configured.poses[name].errors(pose)
        assert position_error < 1e-9 and rotation_error_deg < 1e-7
    rig_error, single_error = (
        np.median([run.poses[name].errors(truth[name])[0] for name in names]) for run in (rig, single)
    )
    assert rig_error <= 0.8 * single_error

    config = json.loads(config_path.read_text())
    config[0]["cameras"][1]["cam_from_rig_rotation"] = [0.9962, 0, 0.0872, 0]  # 10 deg
    wrong = localize(*arguments_of("kitti1"), "--rig_config_path", write(tmp_path / "wrong.json", json.dumps(config)))
    assert set(wrong.statuses.values()) == {"INCONSISTENT_RIG"}
