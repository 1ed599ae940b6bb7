"""Tests of evaluate: errors equal known ones, the right queries count, and bad input gives one clear line."""

import json
import pathlib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colmap_lazyloc import evaluate

CENTRE = np.array([3.0, -2.0, 1.5])
ORIENTATION = Rotation.from_euler("xyz", [100, 20, -35], degrees=True)


def pose_line(name, centre=CENTRE, orientation=ORIENTATION, sign=1):
    qvec = sign * np.roll(orientation.as_quat(), 1)
    numbers = [*qvec, *-orientation.apply(centre)]
    return f"{name} " + " ".join(f"{number:.17g}" for number in numbers) + "\n"


def turned(angle_deg, axis=(0.6, 0.0, 0.8)):
    return Rotation.from_rotvec(np.radians(angle_deg) * np.array(axis)) * ORIENTATION


@pytest.fixture
def write(tmp_path):
    def write_file(name, text):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return str(path)

    return write_file


@pytest.fixture
def run(tmp_path, capsys):
    """Runs the command; returns the figures and what was printed."""

    def run_main(*arguments):
        assert evaluate.main([*arguments, "--json", str(tmp_path / "out.json")]) == 0
        return json.loads((tmp_path / "out.json").read_text()), capsys.readouterr().out

    return run_main


@pytest.fixture
def fails(capsys):
    """Runs the command, which must fail; returns its one line."""

    def run_main(*arguments):
        assert evaluate.main(list(arguments)) == 1
        captured = capsys.readouterr()
        assert captured.out == "" and captured.err.count("\n") == 1
        return captured.err

    return run_main


def write_model(write, folder, lines):
    write(f"{folder}/cameras.txt", "1 PINHOLE 640 480 500 500 320 240\n")
    write(f"{folder}/points3D.txt", "")
    images = ""
    for image_id, line in enumerate(lines, start=1):
        name, pose = line.strip().split(" ", 1)
        images += f"{image_id} {pose} 1 {name}\n\n"
    return str(pathlib.Path(write(f"{folder}/images.txt", images)).parent)


def test_known_errors_are_found(write, run):
    truth = write("truth.txt", "# a comment\n\n" + pose_line("a") + pose_line("b"))
    estimated = write("estimated.txt", pose_line("a", CENTRE + [0.03, 0, 0.04]) + pose_line("b", CENTRE, turned(1.5)))
    figures, _ = run(estimated, "--ground_truth", truth)
    assert figures["queries"]["a"]["position_error"] == pytest.approx(0.05, abs=1e-12)
    assert figures["queries"]["a"]["rotation_error_deg"] == pytest.approx(0, abs=1e-6)
    assert figures["queries"]["b"]["position_error"] == pytest.approx(0, abs=1e-12)
    assert figures["queries"]["b"]["rotation_error_deg"] == pytest.approx(1.5, abs=1e-10)
    assert figures["mean_position_error"] == pytest.approx(0.025, abs=1e-12)


def test_quaternion_sign_does_not_matter(write, run):
    truth = write("truth.txt", pose_line("a"))
    estimated = write("estimated.txt", pose_line("a", sign=-1))
    figures, _ = run(estimated, "--ground_truth", truth)
    assert figures["max_rotation_error_deg"] == pytest.approx(0, abs=1e-6)
    assert figures["max_position_error"] == pytest.approx(0, abs=1e-12)


def test_large_coordinates_keep_their_precision(write, run):
    origin = np.array([4.5e6, 7.0e5, 4.4e6])
    truth = write("truth.txt", pose_line("a", origin))
    estimated = write("estimated.txt", pose_line("a", origin + [0, 0.002, 0]))
    figures, _ = run(estimated, "--ground_truth", truth)
    assert figures["max_position_error"] == pytest.approx(0.002, abs=1e-8)


def test_thresholds_need_both_errors_small(write, run):
    names = "abcd"
    truth = write("truth.txt", "".join(pose_line(name) for name in names))
    estimates = [
        pose_line("a"),
        pose_line("b", CENTRE + [0.3, 0, 0]),
        pose_line("c", CENTRE, turned(3)),
        pose_line("d", CENTRE + [9, 0, 0], turned(20)),
    ]
    figures, out = run(write("estimated.txt", "".join(estimates)), "--ground_truth", truth)
    assert [recall["ratio"] for recall in figures["recall"]] == [0.25, 0.75, 0.75]
    figures, out = run(write("estimated.txt", "".join(estimates)), "--ground_truth", truth, "--thresholds", "10,30")
    assert [recall["ratio"] for recall in figures["recall"]] == [1.0]
    assert "within 10, 30 deg        100.0 %" in out
    assert "Lengths are in the unit of the database." in out and " m " not in out
    _, out = run(write("estimated.txt", "".join(estimates)), "--ground_truth", truth, "--unit", "m")
    assert "within 0.25 m, 2 deg" in out and "unit of the database" not in out


def test_missing_queries_are_failures_in_recall_and_absent_from_the_median(write, run):
    truth = write("truth.txt", "".join(pose_line(name) for name in "abcd"))
    estimated = write("estimated.txt", pose_line("b", CENTRE + [0.1, 0, 0]) + pose_line("not in the truth"))
    figures, out = run(estimated, "--ground_truth", truth, "--per_query")
    assert (figures["num_localized"], figures["num_queries"]) == (1, 4)
    assert figures["median_position_error"] == pytest.approx(0.1)
    assert figures["recall"][0]["ratio"] == 0.25
    assert figures["queries"]["a"] is None
    assert "localized       1 of 4" in out and "a  not localized" in out


def test_no_localized_query_is_a_result(write, run):
    truth = write("truth.txt", pose_line("a"))
    figures, out = run(write("estimated.txt", "# nothing\n"), "--ground_truth", truth)
    assert figures["median_position_error"] is None and figures["recall"][2]["ratio"] == 0
    assert "localized       0 of 1" in out


def test_query_list_says_which_queries_count(write, run):
    truth = write("truth.txt", "".join(pose_line(name) for name in ("a", "b", "with blank", "d")))
    queries = write("queries.txt", "# list\na PINHOLE 640 480 500 500 320 240\nwith blank\n")
    figures, _ = run(write("estimated.txt", pose_line("a")), "--ground_truth", truth, "--query_list_path", queries)
    assert sorted(figures["queries"]) == ["a", "with blank"]


def test_names_may_hold_blanks(write, run):
    path = write("poses.txt", pose_line("my photos/a 1.jpg"))
    figures, _ = run(path, "--ground_truth", path)
    assert figures["num_localized"] == 1


@pytest.mark.parametrize("binary", [False, True])
def test_model_is_ground_truth_for_the_estimated_queries(write, run, tmp_path, binary):
    folder = write_model(write, "model", [pose_line(name) for name in ("database.jpg", "a", "b")])
    if binary:
        import pycolmap

        (tmp_path / "binary").mkdir()
        pycolmap.Reconstruction(folder).write_binary(str(tmp_path / "binary"))
        folder = str(tmp_path / "binary")
    estimated = write("estimated.txt", pose_line("a", CENTRE + [0.2, 0, 0]))
    figures, _ = run(estimated, "--ground_truth", folder)
    assert list(figures["queries"]) == ["a"]
    assert figures["median_position_error"] == pytest.approx(0.2, abs=1e-9)
    figures, _ = run(estimated, "--ground_truth", folder, "--query_list_path", write("queries.txt", "a\nb\n"))
    assert figures["num_queries"] == 2


def write_results(write, path, statuses):
    fields = '"cam_from_world": null'
    write(path, "".join(f'{{"name": "{name}", "status": "{s}", {fields}}}\n' for name, s in statuses.items()))


@pytest.mark.parametrize("estimated", ["run/poses.txt", "run"])
def test_lost_queries_of_a_run_count_against_a_model(write, run, tmp_path, estimated):
    truth = write_model(write, "model", [pose_line(name) for name in ("database.jpg", "a", "b")])
    write("run/poses.txt", pose_line("a", CENTRE + [0.2, 0, 0]))
    write_results(write, "run/results.jsonl", {"a": "LOCALIZED", "b": "NO_PAIRS", "unknown": "NO_PAIRS"})
    figures, out = run(str(tmp_path / estimated), "--ground_truth", truth)
    assert list(figures["queries"]) == ["a", "b"] and "localized       1 of 2" in out
    (tmp_path / "run" / "results.jsonl").unlink()
    _, out = run(str(tmp_path / "run" / "poses.txt"), "--ground_truth", truth)
    assert "compared        1\n" in out and "localized" not in out, "it is unknown how many queries there were"


@pytest.mark.parametrize("truth_of", ["file", "model"])
def test_true_poses_may_have_the_names_of_the_photos(write, run, fails, tmp_path, truth_of):
    """`lazyloc run` puts query/ in front of the names of photos."""
    lines = [pose_line(name) for name in ("a", "b")]
    truth = write("truth.txt", "".join(lines)) if truth_of == "file" else write_model(write, "model", lines)
    write("run/poses.txt", pose_line("query/a", CENTRE + [0.2, 0, 0]))
    write_results(write, "run/results.jsonl", {"query/a": "LOCALIZED", "query/b": "NO_PAIRS"})
    figures, out = run(str(tmp_path / "run"), "--ground_truth", truth)
    assert list(figures["queries"]) == ["query/a", "query/b"] and "localized       1 of 2" in out
    assert figures["median_position_error"] == pytest.approx(0.2, abs=1e-9)
    queries = write("queries.txt", "a\n")
    figures, _ = run(str(tmp_path / "run"), "--ground_truth", truth, "--query_list_path", queries)
    assert list(figures["queries"]) == ["query/a"]
    write("run/poses.txt", pose_line("other/a"))
    write_results(write, "run/results.jsonl", {"other/a": "LOCALIZED"})
    assert "run: " in fails(str(tmp_path / "run"), "--ground_truth", truth)


def test_a_trajectory_of_tum_has_true_poses(write, run, fails, tmp_path):
    """The first photo is at the time of a pose, the second between two, and the third after the last."""
    lines = []
    for step, time in enumerate(("1305031102.1", "1305031102.2", "1305031102.3")):
        x, y, z, w = turned(-2 * step).inv().as_quat()
        centre = " ".join(f"{value:.17g}" for value in CENTRE + [0.1 * step, 0, 0])
        lines.append(f"{time} {centre} {x:.17g} {y:.17g} {z:.17g} {w:.17g}\n")
    truth = write("groundtruth.txt", "# timestamp tx ty tz qx qy qz qw\n" + "".join(lines))
    names = [f"query/13050311{second}.png" for second in ("02.100000", "02.250000", "04.000000")]
    poses = [pose_line(names[0], CENTRE + [0.01, 0, 0]), pose_line(names[1], CENTRE + [0.15, 0, 0], turned(-2))]
    write("run/poses.txt", "".join(poses))
    write_results(write, "run/results.jsonl", dict.fromkeys(names, "LOCALIZED"))
    figures, _ = run(str(tmp_path / "run"), "--ground_truth", truth)
    errors = [(query["position_error"], query["rotation_error_deg"]) for query in figures["queries"].values()]
    assert list(figures["queries"]) == names[:2]
    np.testing.assert_allclose(errors, [(0.01, 0), (0, 1)], atol=1e-6)
    write_results(write, "run/results.jsonl", {"a.png": "LOCALIZED"})
    write("run/poses.txt", pose_line("a.png"))
    assert "groundtruth.txt: no photo is at a time of the trajectory" in fails(
        str(tmp_path / "run"), "--ground_truth", truth
    )


def test_a_model_with_geographic_coordinates_is_in_metres(write, run):
    truth = write_model(write, "model", [pose_line("a")])
    estimated = write("estimated.txt", pose_line("a", CENTRE + [0.2, 0, 0]))
    figures, out = run(estimated, "--ground_truth", truth)
    assert figures["unit"] == "database" and "median 0.2 " in out
    write("model/geo.json", "{}")
    figures, out = run(estimated, "--ground_truth", truth)
    assert figures["unit"] == "m" and "median 20.00 cm" in out


def test_metres_are_printed_in_sensible_units():
    lengths = [evaluate.format_length(length, "m") for length in (0.0004, 0.0312, 2.5)]
    assert lengths == ["0.40 mm", "3.12 cm", "2.500 m"]


@pytest.mark.parametrize(
    "text, message",
    [
        ("a 1 0 0 0 1 2\n", "estimated.txt:1: expected `name qw qx qy qz tx ty tz`, found 'a 1 0 0 0 1 2'"),
        ("# fine\n\na 1 0 0 zero 1 2 3\n", "estimated.txt:3: expected"),
        ("a 1 0 0 0 nan 2 3\n", "estimated.txt:1: expected"),
        (
            "a 0 0 0 0 1 2 3\n",
            "estimated.txt:1: the quaternion's norm is 0, not 1: expected `name qw qx qy qz tx ty tz`",
        ),
        ("1305031102.1 3 1 0.6 0.6 0.6 -0.3 -0.4\n", "norm is 3.27414, not 1: expected `name qw qx qy qz"),  # of TUM
        ("a 1 0 0 0 1 2 3\nb 1 0 0 0 1 2 3\na 1 0 0 0 1 2 3\n", "estimated.txt:3: image 'a' has a pose already"),
        ("z 1 0 0 0 1 2 3\n", "has no name in common with"),
    ],
)
def test_bad_poses_file_is_one_line(write, fails, text, message):
    assert message in fails(write("estimated.txt", text), "--ground_truth", write("truth.txt", pose_line("a")))


def test_missing_file_is_one_line(write, fails, tmp_path):
    truth = write("truth.txt", pose_line("a"))
    assert "nowhere.txt: cannot be read" in fails(str(tmp_path / "nowhere.txt"), "--ground_truth", truth)
    assert "nowhere.txt: cannot be read" in fails(truth, "--ground_truth", str(tmp_path / "nowhere.txt"))
    assert "--json" in fails(truth, "--ground_truth", truth, "--json", str(tmp_path / "nowhere" / "out.json"))


def test_empty_ground_truth_is_one_line(write, fails):
    assert "holds no pose" in fails(write("estimated.txt", pose_line("a")), "--ground_truth", write("truth.txt", "#\n"))


@pytest.mark.parametrize(
    "text, message",
    [
        ("a\nb\na\n", "queries.txt:3: query 'a' is listed twice"),
        ("a\nz\n", "the first is 'z'"),
        ("#\n", "lists no query"),
    ],
)
def test_bad_query_list_is_one_line(write, fails, text, message):
    truth = write("truth.txt", pose_line("a") + pose_line("b"))
    assert message in fails(truth, "--ground_truth", truth, "--query_list_path", write("queries.txt", text))


def test_folder_without_a_readable_model_is_one_line(write, fails, tmp_path):
    estimated = write("estimated.txt", pose_line("a"))
    (tmp_path / "empty").mkdir()
    assert "holds no COLMAP model" in fails(estimated, "--ground_truth", str(tmp_path / "empty"))
    write("half/images.txt", "1 1 0 0 0 0 0 0 1 a\n\n")
    assert "holds no COLMAP model" in fails(estimated, "--ground_truth", str(tmp_path / "half"))


@pytest.mark.parametrize("threshold", ["0.25", "a,b", "1,2,3", "-1,2", "nan,2"])
def test_bad_threshold_is_one_line(write, fails, threshold):
    truth = write("truth.txt", pose_line("a"))
    assert "--thresholds: expected" in fails(truth, "--ground_truth", truth, f"--thresholds={threshold}")
