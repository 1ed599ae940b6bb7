"""Tests of the localization benchmark: protocol, figures, tables. A failing method must not stop the others."""

import dataclasses
import math
import os
import pathlib
import sqlite3
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.localization import database_noise, evaluation, methods, run, scenes, tables
from benchmarks.localization.matches import MatchDatabase
from benchmarks.localization.methods import Result
from benchmarks.localization.methods.relative_pose_ransac import best_pose
from benchmarks.localization.methods.structure_based import match_to_map
from colmap_lazyloc.database import pair_id
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera, read_model
from colmap_lazyloc.poses import Pose
from conftest import DATA_PATH


def make_scene(path: pathlib.Path, names, query_names=None) -> pathlib.Path:
    """Writes cameras one metre apart along x, looking along z; pair (i, j) has 20 + i + j verified matches."""
    (path / "model").mkdir(parents=True)
    (path / "model" / "cameras.txt").write_text("# Camera list\n3 PINHOLE 640 480 500.5 501 320 240\n")
    lines = "".join(f"{i} 1 0 0 0 {-float(i)} 0 0 3 {name}\n\n" for i, name in enumerate(names, 1))
    (path / "model" / "images.txt").write_text("# Image list\n" + lines)
    if query_names is not None:
        (path / "queries.txt").write_text("\n".join(query_names) + "\n")
    connection = sqlite3.connect(path / "database.db")
    connection.execute("CREATE TABLE images (image_id INTEGER, name TEXT)")
    connection.execute("CREATE TABLE keypoints (image_id INTEGER, rows INTEGER, cols INTEGER, data BLOB)")
    connection.execute("CREATE TABLE two_view_geometries (pair_id INTEGER, rows INTEGER, cols INTEGER, data BLOB)")
    for i, name in enumerate(names, 1):
        keypoints = np.arange(60 * 4, dtype=np.float32).reshape(60, 4) + 1000 * i
        connection.execute("INSERT INTO images VALUES (?, ?)", (i, name))
        connection.execute("INSERT INTO keypoints VALUES (?, 60, 4, ?)", (i, keypoints.tobytes()))
        for j in range(i + 1, len(names) + 1):
            rows = np.arange(20 + i + j)
            matches = np.stack([rows, rows + 1], axis=1).astype(np.uint32)
            connection.execute(
                "INSERT INTO two_view_geometries VALUES (?, ?, 2, ?)", (pair_id(i, j), len(rows), matches.tobytes())
            )
    connection.commit()
    connection.close()
    return path


def make_row(query, error_cm, method="lazyloc", scene="a", seconds=0.1):
    return evaluation.Row(
        "t",
        scene,
        query,
        method,
        20,
        0,
        "0,0",
        error_cm,
        error_cm / 10,
        seconds,
        "LOST" if math.isnan(error_cm) else "LOCALIZED",
    )


# Scenes


def test_leave_one_out_without_a_query_list(tmp_path):
    scene = scenes.load_scene(make_scene(tmp_path / "any", ["b.jpg", "a.jpg", "with space.jpg"]))
    assert scene.query_names == ["a.jpg", "b.jpg", "with space.jpg"]
    assert scene.database_names("b.jpg") == ["a.jpg", "with space.jpg"]
    assert scene.camera("a.jpg") == Camera("PINHOLE", 640, 480, (500.5, 501, 320, 240))
    np.testing.assert_allclose(scene.pose("with space.jpg").cam_in_world, [3, 0, 0])


def test_leave_one_out_of_a_query_list(tmp_path):
    scene = scenes.load_scene(make_scene(tmp_path / "any", ["a.jpg", "b.jpg", "c.jpg"], ["b.jpg"]))
    assert scene.query_names == ["b.jpg"]
    assert scene.database_names("b.jpg") == ["a.jpg", "c.jpg"]
    assert scene.database_key("b.jpg") != scene.database_key("a.jpg")


def test_kitti_has_a_fixed_database_and_every_second_left_query(tmp_path):
    names = [f"{side}/{i:06d}.png" for i in range(7) for side in ("left", "right")]
    queries = [name for name in names if int(name[-10:-4]) % 3]
    scene = scenes.load_scene(make_scene(tmp_path / "kitti1", names, queries))
    assert scene.query_names == ["left/000001.png", "left/000004.png"]
    expected = [f"{side}/{i:06d}.png" for side in ("left", "right") for i in (0, 3, 6)]
    assert scene.database_names("left/000004.png") == expected
    assert scene.database_key("left/000001.png") == scene.database_key("left/000004.png")


def test_query_without_a_pose_is_named(tmp_path):
    with pytest.raises(InputError, match="z.jpg"):
        scenes.load_scene(make_scene(tmp_path / "any", ["a.jpg"], ["z.jpg"]))


def test_query_with_intrinsics_needs_no_pose(tmp_path):
    path = make_scene(tmp_path / "any", ["a.jpg", "b.jpg"], ["q.jpg OPENCV 640 480 500 501 320 240 0.1 0 0 0", "b.jpg"])
    (path / "protocol.json").write_text('{"leave_one_out": false}')
    scene = scenes.load_scene(path)
    assert scene.query_names == ["q.jpg", "b.jpg"]
    assert scene.true_pose("q.jpg") is None
    assert scene.camera("q.jpg") == Camera("OPENCV", 640, 480, (500, 501, 320, 240, 0.1, 0, 0, 0))
    assert scene.database_names("q.jpg") == ["a.jpg"]


# Matches


def test_best_pairs_come_first_and_matches_start_with_the_query(tmp_path):
    scene = scenes.load_scene(make_scene(tmp_path / "any", ["a.jpg", "b.jpg", "c.jpg", "d.jpg"]))
    with MatchDatabase(scene.database_path) as database:
        matches = database.query_matches(scene, "b.jpg", 2)
    assert [(pair.database_name, len(pair.query_idxs)) for pair in matches.pairs] == [("d.jpg", 26), ("c.jpg", 25)]
    with MatchDatabase(scene.database_path) as database:
        pair = database.query_matches(scene, "b.jpg", 20).pairs[-1]
    # The stored pair is (a, b), so the query's keypoints are in the second column.
    assert pair.database_name == "a.jpg"
    np.testing.assert_array_equal(pair.query_idxs, pair.database_idxs + 1)
    np.testing.assert_allclose(matches.query_points[1], [2004, 2005])


def test_a_point_seen_in_two_images_is_one_match(tmp_path):
    scene = scenes.load_scene(make_scene(tmp_path / "any", ["a.jpg", "b.jpg", "c.jpg"]))
    with MatchDatabase(scene.database_path) as database:
        matches = database.query_matches(scene, "a.jpg", 20)
    point_ids = np.full(60, -1)
    point_ids[6] = 77  # query keypoint 5 in both images
    points = np.zeros((60, 3))
    points[6] = [1, 2, 3]
    points2d, points3d = match_to_map(matches, {"b.jpg": (point_ids, points), "c.jpg": (point_ids, points)})
    np.testing.assert_allclose(points2d, matches.query_points[[5]])
    np.testing.assert_allclose(points3d, [[1, 2, 3]])


def test_relative_poses_outvote_a_third_of_wrong_ones():
    rng = np.random.default_rng(0)
    pose = Pose.from_matrix(Rotation.random(random_state=1).as_matrix(), np.array([1.0, 2.0, 3.0]))
    centres = rng.normal(0, 5, (12, 3))
    directions = pose.cam_in_world - centres
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rotations = np.repeat(pose.rotation[None], 12, axis=0)
    for i in range(4):
        turn = Rotation.random(random_state=10 + i).as_matrix()
        # A wrong relative pose keeps its direction in the query's frame, and so turns both.
        rotations[i], directions[i] = turn @ rotations[i], rng.permutation(directions[i]) * [1, -1, 1]
    assert best_pose(rotations, centres, directions).errors(pose) == pytest.approx((0, 0), abs=1e-9)
    collinear = np.outer(np.arange(3), [1.0, 0, 0])
    assert best_pose(rotations[4:7], collinear, np.tile([1.0, 0, 0], (3, 1))) is None


# Figures


def test_pose_errors_of_known_motions():
    rotation = Rotation.from_rotvec([0, 0, math.radians(1e-4)]).as_matrix()
    true_pose = Pose.from_matrix(np.eye(3), np.zeros(3))
    position_error, rotation_error_deg = Pose.from_centre(rotation, [3.0, 4.0, 0.0]).errors(true_pose)
    assert position_error == pytest.approx(5)
    assert rotation_error_deg == pytest.approx(1e-4, rel=1e-6)


def test_summary_counts_a_lost_query_as_infinite_in_the_median_alone():
    summary = evaluation.summarize([make_row("1", 1.0), make_row("2", 3.0), make_row("3", math.nan)])
    assert (summary.num_queries, summary.num_lost) == (3, 1)
    assert summary.median_position_error_cm == 3
    assert summary.mean_position_error_cm == 2


def test_recall_counts_all_queries_and_both_errors():
    rows = [make_row("1", 20.0), make_row("2", 24.0), make_row("3", 60.0), make_row("4", math.nan)]
    # The rotation errors are 2 and 2.4 degrees at 20 and 24 cm, and 6 degrees at 60 cm.
    assert evaluation.summarize(rows).recall == (0.25, 0.5, 0.75)


def test_localized_without_a_true_pose_is_neither_lost_nor_measured():
    row = dataclasses.replace(make_row("1", math.nan), status="LOCALIZED")
    summary = evaluation.summarize([row, make_row("2", math.nan)])
    assert summary.num_lost == 1
    assert math.isnan(summary.median_position_error_cm) and math.isnan(summary.recall[0])


def test_ratio_is_the_geometric_mean_of_paired_queries():
    baseline = [make_row(query, 2.0, "structure_based") for query in "123"]
    ratio = evaluation.paired_ratio([make_row("1", 1.0), make_row("2", 4.0), make_row("3", math.nan)], baseline)
    assert ratio.mean == pytest.approx(1)
    assert ratio.num_queries == 2
    assert (ratio.low, ratio.high) == pytest.approx((0.5, 2))
    assert evaluation.paired_ratio([make_row("9", 1.0)], baseline) is None


def test_bootstrap_interval_agrees_with_the_normal_one_and_repeats():
    log_ratios = np.random.default_rng(1).normal(-0.1, 0.5, 400)
    rows = [make_row(str(i), math.exp(value)) for i, value in enumerate(log_ratios)]
    baseline = [make_row(str(i), 1.0, "structure_based") for i in range(len(log_ratios))]
    ratio = evaluation.paired_ratio(rows, baseline)
    half_width = 1.96 * log_ratios.std() / math.sqrt(len(log_ratios))
    assert math.log(ratio.high) - math.log(ratio.low) == pytest.approx(2 * half_width, rel=0.05)
    assert ratio == evaluation.paired_ratio(rows, baseline)


def test_csv_keeps_rows(tmp_path):
    rows = [make_row("with, comma", 1 / 3), make_row("2", math.nan)]
    evaluation.write_csv(tmp_path / "t.csv", rows)
    again = evaluation.read_csv(tmp_path / "t.csv")
    assert again[0] == rows[0]
    assert again[1].is_lost and again[1].status == "LOST"


# Tables


def test_table_has_scenes_the_pool_and_reasons():
    rows = [
        make_row("1", 2.0, "structure_based"),
        make_row("1", 1.0),
        make_row("1", 4.0, "structure_based", "b"),
        make_row("1", 4.0, "lazyloc", "b"),
        make_row("1", 3.0, "local_triangulation", "b"),
    ]
    missing = evaluation.Series("local_triangulation")
    text = tables.markdown("t", rows, {("a", missing): "no such package"}, ["some note"])
    medians, rest = text.split("## All 2 scenes")
    pool, scene_a, _ = rest.split("\n## ")
    assert medians.startswith("# t\n\nsome note\n")
    assert "| lazyloc | 1.00 / 0.100 | 4.00 / 0.400 | 2.50 / 0.250 |" in medians
    assert "| local_triangulation | – | 3.00 / 0.300 | – |" in medians
    shares = "100.0 | 100.0 | 100.0"
    assert f"| lazyloc | 1 | 1.00 / 0.100 | 1.00 | 0 | 0.500 [0.500, 0.500] | {shares} | 0.1000 |" in scene_a
    assert "| local_triangulation [2] | – |" in scene_a and "[2] no such package" in text
    assert f"| lazyloc | 2 | 2.50 / 0.250 | 2.50 | 0 | 0.707 [0.707, 0.707] | {shares} | 0.1000 |" in pool
    assert "| local_triangulation [1] | 1 |" in pool and "[1] without a" in text


def test_most_lost_is_an_infinite_median():
    rows = [make_row("1", 2.0), make_row("2", math.nan), make_row("3", math.nan)]
    assert "| lazyloc | 3 | ∞ / ∞ | 2.00 | 2 | – | 33.3 | 33.3 | 33.3 |" in tables.markdown("t", rows, {})


def test_series_differ_by_what_the_run_varies():
    rows = [
        dataclasses.replace(make_row("1", error, method), num_retrieved=k)
        for k, error in ((5, 3.0), (20, 2.0))
        for method in ("structure_based", "lazyloc")
    ]
    text = tables.markdown("t", rows, {})
    assert "| lazyloc K=5 | 1 | 3.00" in text and "| lazyloc K=20 | 1 | 2.00" in text
    # Each series is compared with the map that was given as many pairs.
    assert text.count("| 1.000 [1.000, 1.000] |") == 4
    assert "seed" not in text and "noise" not in text
    noises = ["0,0", "5,0", "10,0"]
    text = tables.markdown("t", [dataclasses.replace(rows[0], database_noise=noise) for noise in noises], {})
    assert [text.index(f"structure_based noise {noise}") for noise in ("0°, 0 cm", "5°, 0 cm", "10°, 0 cm")] == sorted(
        text.index(f"structure_based noise {noise}") for noise in ("0°, 0 cm", "5°, 0 cm", "10°, 0 cm")
    )


def test_plots_are_made_and_repeat(tmp_path):
    pytest.importorskip("matplotlib")
    from benchmarks.localization import plots

    rows = [
        dataclasses.replace(make_row(str(i), error, method, scene), num_retrieved=k)
        for k in (5, 20)
        for i, error in enumerate((1.0, 2.0, math.nan))
        for method in ("structure_based", "lazyloc")
        for scene in "ab"
    ]
    rows += [make_row("1", math.nan, scene="all_lost")]
    files = plots.write_plots(tmp_path, "t", rows)
    names = ["t_cumulative_error.svg", "t_time_against_error.svg", "t_error_against_k.svg"]
    assert [path.name for path in files] == names
    first = [path.read_bytes() for path in files]
    assert all(b"structure_based" in content and b"all_lost" in content for content in first)
    assert [path.read_bytes() for path in plots.write_plots(tmp_path, "t", rows)] == first


def test_database_noise_moves_and_turns_by_what_is_asked(tmp_path):
    scene = scenes.load_scene(make_scene(tmp_path / "any", ["a.jpg", "b.jpg", "c.jpg"]))
    noisy = database_noise.add_database_noise(scene, 2.0, 5.0, 0, tmp_path / "noise")
    for name in scene.images:
        assert noisy.pose(name).errors(scene.pose(name)) == pytest.approx((0.05, 2.0))
        assert noisy.true_pose(name) is scene.pose(name)
    directions = [noisy.pose(name).cam_in_world - scene.pose(name).cam_in_world for name in scene.images]
    assert np.linalg.norm(directions[0] - directions[1]) > 1e-3
    read_again = read_model(noisy.model_path).images
    np.testing.assert_allclose(read_again["b.jpg"].cam_from_world.tvec, noisy.pose("b.jpg").tvec)
    again = database_noise.add_database_noise(scene, 2.0, 5.0, 0, tmp_path / "noise")
    np.testing.assert_array_equal(again.pose("b.jpg").rotation, noisy.pose("b.jpg").rotation)


def test_submission_has_names_without_folders(tmp_path):
    pose = Pose.from_matrix(np.eye(3), [1.0, 2.0, 3.0])
    poses = {"query/day/nexus4/IMG_1.jpg": pose, "query/night/x/IMG_2.jpg": pose}
    run.write_submission(tmp_path / "s.txt", poses)
    assert (tmp_path / "s.txt").read_text() == "IMG_1.jpg 1 0 0 0 1 2 3\nIMG_2.jpg 1 0 0 0 1 2 3\n"
    with pytest.raises(ValueError, match="same name"):
        run.write_submission(tmp_path / "s.txt", {"a/1.jpg": pose, "b/1.jpg": pose})


# The driver


def test_a_failing_or_crashing_method_does_not_stop_the_others(tmp_path, monkeypatch, capsys):
    def fail(scene, query_names, options):
        raise RuntimeError("no luck")

    def shift_by_one_cm(scene, query_names, options):
        poses = {name: scene.pose(name) for name in query_names}
        return {name: Result(Pose(pose.qvec, pose.tvec + [0.01, 0, 0]), 0.5) for name, pose in poses.items()}

    functions = {"lazyloc": fail, "local_triangulation": lambda *_: os._exit(1), "structure_based": shift_by_one_cm}
    monkeypatch.setattr(run, "load_method", functions.__getitem__)
    make_scene(tmp_path / "any", ["a.jpg", "b.jpg"])
    arguments = ["--data_path", str(tmp_path), "--output_path", str(tmp_path / "out"), "--methods"]
    assert run.main([*arguments, "lazyloc", "local_triangulation", "structure_based"]) == 0
    text = (tmp_path / "out" / "run.md").read_text()
    assert "failed: RuntimeError: no luck" in text and "crashed" in text
    rows = evaluation.read_csv(tmp_path / "out" / "run.csv")
    assert [(row.query, row.method) for row in rows] == [("a.jpg", "structure_based"), ("b.jpg", "structure_based")]
    assert rows[0].position_error_cm == pytest.approx(1)

    # A second run with the same tag adds its rows to those of the first.
    functions["lazyloc"] = shift_by_one_cm
    assert run.main([*arguments, "lazyloc"]) == 0
    assert len(evaluation.read_csv(tmp_path / "out" / "run.csv")) == 4


@pytest.mark.parametrize(
    "extra, message",
    [
        (["--methods", "magic"], "magic"),
        (["--methods", "lazyloc:nothing"], "nothing.ini"),
        (["--methods", "local_triangulation:x"], "local_triangulation:x"),
        (["--methods", "ablation:magic"], "magic is not one of none, l1"),
        (["--scenes", "mars"], "mars"),
        (["--options", "seed"], "KEY=VALUE"),
        (["--queries", "none.txt"], "none.txt"),
        (["--image_step", "0"], "--image_step"),
        (["--dataset", "7scenes"], "no scene of 7scenes"),
        (["--dataset", "kitti", "--download"], "by e-mail"),
    ],
)
def test_wrong_arguments_are_named(tmp_path, capsys, extra, message):
    make_scene(tmp_path / "any", ["a.jpg"])
    assert run.main(["--data_path", str(tmp_path), "--output_path", str(tmp_path / "out"), *extra]) == 1
    assert message in capsys.readouterr().err


def test_queries_are_the_first_ones_or_those_of_a_list(tmp_path):
    scene = scenes.load_scene(make_scene(tmp_path / "any", ["a.jpg", "b.jpg", "c.jpg"]))
    assert run._choose_queries(scene, None) == ["a.jpg", "b.jpg", "c.jpg"]
    assert run._choose_queries(scene, "2") == ["a.jpg", "b.jpg"]
    (tmp_path / "list.txt").write_text("c.jpg\nb.jpg PINHOLE 640 480 1 1 1 1\nelsewhere.jpg\n")
    assert run._choose_queries(scene, str(tmp_path / "list.txt")) == ["b.jpg", "c.jpg"]


def test_package_that_is_missing_is_a_reason(monkeypatch):
    monkeypatch.setitem(sys.modules, "poselib", None)
    monkeypatch.delitem(sys.modules, "benchmarks.localization.methods.poselib_generalized", raising=False)
    with pytest.raises(methods.NotApplicable, match="poselib"):
        methods.load_method("poselib_generalized")


def test_lazyloc_gives_the_program_the_protocol_and_reads_its_answers(tmp_path):
    program = tmp_path / "program"
    program.write_text(f"""#!{sys.executable}
import json, pathlib, sys
options = dict(zip(sys.argv[2::2], sys.argv[3::2]))
pathlib.Path(options["--output_path"]).mkdir()
model = pathlib.Path(options["--input_path"], "images.txt").read_text()
assert "left/000000.png" in model and "left/000001.png" not in model and "right/000004.png" not in model
assert "--LazyLocalizer.leave_one_out" not in options and options["--LazyLocalizer.seed"] == "7"
first, second = pathlib.Path(options["--query_list_path"]).read_text().splitlines()
assert first == "left/000001.png PINHOLE 640 480 500.5 501.0 320.0 240.0"
found = {{"name": "left/000001.png", "status": "LOCALIZED", "seconds": {{"total": 0.25}},
          "cam_from_world": {{"qvec": [1, 0, 0, 0], "tvec": [1, 2, 3]}}}}
bearing = dict(found, name="left/000004.png", status="SCALE_UNOBSERVABLE")
pathlib.Path(options["--output_path"], "results.jsonl").write_text(json.dumps(found) + "\\n" + json.dumps(bearing))
""")
    program.chmod(0o755)
    names = [f"{side}/{i:06d}.png" for i in range(7) for side in ("left", "right")]
    queries = [name for name in names if int(name[-10:-4]) % 3]
    scene = scenes.load_scene(make_scene(tmp_path / "kitti1", names, queries))
    options = methods.MethodOptions(tmp_path / "work", program, program_options=(("LazyLocalizer.seed", "7"),))
    for _ in range(2):  # the second run must not fail because of the folders of the first
        results = methods.load_method("lazyloc")(scene, scene.query_names, options)
    np.testing.assert_allclose(results["left/000001.png"].pose.tvec, [1, 2, 3])
    assert results["left/000001.png"].seconds == 0.25
    assert results["left/000004.png"] == Result(None, 0.25, "SCALE_UNOBSERVABLE")


def test_ablations_are_a_program_beside_ours(tmp_path):
    scene = scenes.load_scene(make_scene(tmp_path / "any", ["a.jpg", "b.jpg", "c.jpg"]))
    options = methods.MethodOptions(tmp_path / "work", tmp_path / "colmap", preset="lud", seed=7)
    localize = methods.load_method("ablation")
    with pytest.raises(methods.NotApplicable, match="lazyloc_ablation_benchmark"):
        localize(scene, scene.query_names, options)
    program = tmp_path / "lazyloc_ablation_benchmark"
    program.write_text(f"""#!{sys.executable}
import sys
assert sys.argv[1] == "lud" and sys.argv[5:] == ["20", "7", "1"]
assert open(sys.argv[4]).read() == "a.jpg\\nb.jpg\\nc.jpg\\n"
print("a.jpg", "LOCALIZED", 0.25, 1, 0, 0, 0, 1, 2, 3, sep="\\t")
print("b.jpg", "SCALE_UNOBSERVABLE", 0.5, sep="\\t")
""")
    program.chmod(0o755)
    results = localize(scene, scene.query_names, options)
    np.testing.assert_allclose(results["a.jpg"].pose.tvec, [1, 2, 3])
    assert results["a.jpg"].seconds == 0.25
    assert results["b.jpg"] == Result(None, 0.5, "SCALE_UNOBSERVABLE")
    assert results["c.jpg"].pose is None and results["c.jpg"].status == "NOT_LOADED"


def test_methods_on_a_real_scene(tmp_path):
    """Each method localizes three queries of the smallest scene accurately."""
    if not (DATA_PATH / "office" / "database.db").exists():
        pytest.skip(f"no scene below {DATA_PATH}; LAZYLOC_SHARED_DATA says where it is")
    before = (DATA_PATH / "office" / "database.db").read_bytes()
    assert (
        run.main(
            [
                "--data_path",
                str(DATA_PATH),
                "--scenes",
                "office",
                "--queries",
                "3",
                "--methods",
                "structure_based",
                "local_triangulation",
                "--output_path",
                str(tmp_path),
            ]
        )
        == 0
    )
    rows = evaluation.read_csv(tmp_path / "run.csv")
    assert len(rows) == 6
    assert all(row.position_error_cm < 5 and row.seconds > 0 for row in rows)
    assert (DATA_PATH / "office" / "database.db").read_bytes() == before
