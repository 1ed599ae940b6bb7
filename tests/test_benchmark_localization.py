"""The localization benchmark: protocol, figures, tables, and that one failing method does not stop the others."""

import math
import os
import pathlib
import sqlite3
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

PROJECT_PATH = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(PROJECT_PATH / "benchmarks" / "localization"))

import evaluation  # noqa: E402
import methods  # noqa: E402
import run  # noqa: E402
import scenes  # noqa: E402
import tables  # noqa: E402
from geometry import Pose, pose_errors  # noqa: E402
from matches import MatchDatabase  # noqa: E402
from methods import Result  # noqa: E402
from methods.structure_based import match_to_map  # noqa: E402

SHARED_DATA_PATH = pathlib.Path(os.environ.get("LAZYLOC_SHARED_DATA", PROJECT_PATH.parent / "shared" / "data"))


def make_scene(path: pathlib.Path, names, query_names=None) -> pathlib.Path:
    """Cameras one metre apart along x, looking along z; each pair (i, j) has 20 + i + j verified matches."""
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
            connection.execute("INSERT INTO two_view_geometries VALUES (?, ?, 2, ?)",
                               (2147483647 * i + j, len(rows), matches.tobytes()))
    connection.commit()
    connection.close()
    return path


def make_row(query, error_cm, method="lazyloc", scene="a", seconds=0.1):
    return evaluation.Row("t", scene, query, method, error_cm, error_cm / 10, seconds,
                          "LOST" if math.isnan(error_cm) else "LOCALIZED")


# Scenes


def test_leave_one_out_without_a_query_list(tmp_path):
    scene = scenes.load_scene(make_scene(tmp_path / "any", ["b.jpg", "a.jpg", "with space.jpg"]))
    assert scene.query_names == ["a.jpg", "b.jpg", "with space.jpg"]
    assert scene.database_names("b.jpg") == ["a.jpg", "with space.jpg"]
    assert scene.camera("a.jpg") == scenes.Camera("PINHOLE", 640, 480, (500.5, 501, 320, 240))
    np.testing.assert_allclose(scene.pose("with space.jpg").cam_in_world(), [3, 0, 0])


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
    with pytest.raises(ValueError, match="z.jpg"):
        scenes.load_scene(make_scene(tmp_path / "any", ["a.jpg"], ["z.jpg"]))


# Matches


def test_best_pairs_come_first_and_matches_start_with_the_query(tmp_path):
    scene = scenes.load_scene(make_scene(tmp_path / "any", ["a.jpg", "b.jpg", "c.jpg", "d.jpg"]))
    with MatchDatabase(scene.database_path) as database:
        matches = database.query_matches(scene, "b.jpg", 2)
    assert [(pair.database_name, len(pair.query_idxs)) for pair in matches.pairs] == [("d.jpg", 26), ("c.jpg", 25)]
    with MatchDatabase(scene.database_path) as database:
        pair = database.query_matches(scene, "b.jpg", 20).pairs[-1]
    # The stored pair is (a, b): here the query's keypoints are the second column.
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


# Figures


def test_pose_errors_of_known_motions():
    rotation = Rotation.from_rotvec([0, 0, math.radians(1e-4)]).as_matrix()
    true_pose = Pose(np.eye(3), np.zeros(3))
    position_error, rotation_error_deg = pose_errors(Pose(rotation, -rotation @ [3.0, 4.0, 0.0]), true_pose)
    assert position_error == pytest.approx(5)
    assert rotation_error_deg == pytest.approx(1e-4, rel=1e-6)


def test_summary_counts_a_lost_query_as_infinite_in_the_median_alone():
    summary = evaluation.summarize([make_row("1", 1.0), make_row("2", 3.0), make_row("3", math.nan)])
    assert (summary.num_queries, summary.num_lost) == (3, 1)
    assert summary.median_position_error_cm == 3
    assert summary.mean_position_error_cm == 2


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
    rows = [make_row("1", 2.0, "structure_based"), make_row("1", 1.0), make_row("1", 4.0, "structure_based", "b"),
            make_row("1", 4.0, "lazyloc", "b"), make_row("1", 3.0, "local_triangulation", "b")]
    text = tables.markdown("t", rows, {("a", "local_triangulation"): "no such package"})
    scene_a, rest = text.split("## b")
    pool = rest.split("## All 2 scenes")[1]
    assert "| lazyloc | 1 | 1.00 / 0.100 | 1.00 | 0 | 0.500 [0.500, 0.500] | 0.1000 |" in scene_a
    assert "| local_triangulation [1] | – |" in scene_a
    assert "[1] no such package" in text
    assert "| lazyloc | 2 | 2.50 / 0.250 | 2.50 | 0 | 0.707 [0.707, 0.707] | 0.1000 |" in pool
    assert "| local_triangulation [2] | 1 |" in pool and "[2] without a" in text


# The driver


def test_a_failing_or_crashing_method_does_not_stop_the_others(tmp_path, monkeypatch, capsys):
    def fail(scene, query_names, options):
        raise RuntimeError("no luck")

    def shift_by_one_cm(scene, query_names, options):
        poses = {name: scene.pose(name) for name in query_names}
        return {name: Result(Pose(pose.rotation, pose.translation + [0.01, 0, 0]), 0.5) for name, pose in poses.items()}

    functions = {"lazyloc": fail, "local_triangulation": lambda *_: os._exit(1), "structure_based": shift_by_one_cm}
    monkeypatch.setattr(run, "load_method", functions.__getitem__)
    make_scene(tmp_path / "any", ["a.jpg", "b.jpg"])
    arguments = ["--scenes_path", str(tmp_path), "--output_path", str(tmp_path / "out"), "--methods"]
    assert run.main(arguments + ["lazyloc", "local_triangulation", "structure_based"]) == 0
    text = (tmp_path / "out" / "run.md").read_text()
    assert "failed: RuntimeError: no luck" in text and "crashed" in text
    rows = evaluation.read_csv(tmp_path / "out" / "run.csv")
    assert [(row.query, row.method) for row in rows] == [("a.jpg", "structure_based"), ("b.jpg", "structure_based")]
    assert rows[0].position_error_cm == pytest.approx(1)

    # A second run with the tag adds to the first.
    functions["lazyloc"] = shift_by_one_cm
    assert run.main(arguments + ["lazyloc"]) == 0
    assert len(evaluation.read_csv(tmp_path / "out" / "run.csv")) == 4


@pytest.mark.parametrize("extra, message", [
    (["--methods", "magic"], "magic"), (["--methods", "lazyloc:nothing"], "nothing.ini"),
    (["--methods", "local_triangulation:x"], "local_triangulation:x"), (["--scenes", "mars"], "mars"),
    (["--options", "seed"], "KEY=VALUE")])
def test_wrong_arguments_are_named(tmp_path, capsys, extra, message):
    make_scene(tmp_path / "any", ["a.jpg"])
    with pytest.raises(SystemExit):
        run.main(["--scenes_path", str(tmp_path), "--output_path", str(tmp_path / "out"), *extra])
    assert message in capsys.readouterr().err


def test_package_that_is_missing_is_a_reason(monkeypatch):
    monkeypatch.setitem(sys.modules, "poselib", None)
    monkeypatch.delitem(sys.modules, "methods.poselib_generalized", raising=False)
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
    for _ in range(2):  # the second run must not trip over the first one's folders
        results = methods.load_method("lazyloc")(scene, scene.query_names, options)
    np.testing.assert_allclose(results["left/000001.png"].pose.translation, [1, 2, 3])
    assert results["left/000001.png"].seconds == 0.25
    assert results["left/000004.png"] == Result(None, 0.25, "SCALE_UNOBSERVABLE")


def test_methods_on_a_real_scene(tmp_path):
    """Three queries of the smallest scene: each method finds all of them, and finds them well."""
    if not (SHARED_DATA_PATH / "office" / "database.db").exists():
        pytest.skip(f"no scene below {SHARED_DATA_PATH}; LAZYLOC_SHARED_DATA says where it is")
    before = (SHARED_DATA_PATH / "office" / "database.db").read_bytes()
    assert run.main(["--scenes_path", str(SHARED_DATA_PATH), "--scenes", "office", "--max_num_queries", "3",
                     "--methods", "structure_based", "local_triangulation", "--output_path", str(tmp_path)]) == 0
    rows = evaluation.read_csv(tmp_path / "run.csv")
    assert len(rows) == 6
    assert all(row.position_error_cm < 5 and row.seconds > 0 for row in rows)
    assert (SHARED_DATA_PATH / "office" / "database.db").read_bytes() == before
