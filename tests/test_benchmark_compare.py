"""Tests of `benchmarks compare`: noise passes, a regression fails, the reduced run meets its expected figures."""

import dataclasses
import json
import math
import pathlib

import numpy as np
import pytest

from benchmarks.localization import compare, evaluation, run
from colmap_lazyloc.demo.__main__ import main as make_demo
from conftest import PROJECT_PATH

EXPECTED_PATH = PROJECT_PATH / "benchmarks" / "localization" / "expected"


def write_run(path, errors_cm, scene="a", seed=0, rotation_factor=1.0):
    """Writes a CSV with one query per error; NaN stands for a lost query."""
    rows = [
        evaluation.Row(
            "t",
            scene,
            f"{i}.jpg",
            "lazyloc",
            20,
            seed,
            "0,0",
            error,
            rotation_factor * error / 10,
            0.1,
            "LOST" if math.isnan(error) else "LOCALIZED",
        )
        for i, error in enumerate(errors_cm)
    ]
    evaluation.write_csv(path, rows)
    return str(path)


def random_errors(count=60, seed=0):
    return np.exp(np.random.default_rng(seed).normal(0, 0.8, count))


def test_a_run_is_no_regression_of_itself(tmp_path, capsys):
    path = write_run(tmp_path / "a.csv", [*random_errors(), math.nan])
    assert compare.main([path, path]) == 0
    assert "a, lazyloc: position 1.000 [1.000, 1.000], rotation 1.000 [1.000, 1.000], lost 1 -> 1" in (
        capsys.readouterr().out
    )


def test_noise_is_no_regression_and_a_shift_within_it_is(tmp_path, capsys):
    errors = random_errors()
    noise = np.exp(np.random.default_rng(1).normal(0, 0.3, len(errors)))
    noise /= np.exp(np.mean(np.log(noise)))
    before = write_run(tmp_path / "before.csv", errors)
    assert compare.main([before, write_run(tmp_path / "same.csv", errors * noise * 1.02)]) == 0
    assert compare.main([before, write_run(tmp_path / "better.csv", errors * noise * 0.7)]) == 0
    assert "REGRESSION" not in capsys.readouterr().out
    assert compare.main([before, write_run(tmp_path / "worse.csv", errors * noise * 1.25)]) == 1
    assert "REGRESSION: worse: a, lazyloc: position 1.2" in capsys.readouterr().out


def test_a_change_that_is_certain_but_tiny_does_not_fail(tmp_path):
    errors = random_errors()
    before, after = write_run(tmp_path / "before.csv", errors), write_run(tmp_path / "after.csv", 1.01 * errors)
    assert compare.main([before, after]) == 0
    assert compare.main([before, after, "--min_effect", "0.005"]) == 1


def test_rotation_counts_too(tmp_path, capsys):
    errors = random_errors()
    after = write_run(tmp_path / "after.csv", errors, rotation_factor=1.3)
    assert compare.main([write_run(tmp_path / "before.csv", errors), after]) == 1
    assert "REGRESSION: after: a, lazyloc: rotation 1.3" in capsys.readouterr().out


@pytest.mark.parametrize("num_lost, num_found, code", [(5, 0, 1), (3, 0, 0), (5, 4, 0), (0, 5, 0)])
def test_lost_queries_beyond_chance_fail(tmp_path, num_lost, num_found, code):
    errors = random_errors()
    before, after = errors.copy(), errors.copy()
    after[:num_lost] = math.nan
    before[10 : 10 + num_found] = math.nan
    assert compare.main([write_run(tmp_path / "before.csv", before), write_run(tmp_path / "after.csv", after)]) == code


def test_three_seeds_give_the_spread(tmp_path, capsys):
    paths = [write_run(tmp_path / f"{seed}.csv", [1.0 + 0.1 * seed], seed=seed) for seed in range(3)]
    compare.main(paths)
    assert "| a | lazyloc | 1.000 / 0.1000 | 1.100 / 0.1100 | 1.200 / 0.1200 | 18.2 % |" in capsys.readouterr().out


def test_runs_without_anything_in_common_are_an_error(tmp_path, capsys):
    paths = [write_run(tmp_path / f"{scene}.csv", [1.0], scene=scene) for scene in "ab"]
    assert compare.main(paths) == 1
    assert "no scene and method in common" in capsys.readouterr().err
    assert compare.main([paths[0], str(tmp_path / "none.csv")]) == 1


def test_expected_figures(tmp_path, capsys):
    expected = tmp_path / "expected.json"
    assert compare.main([write_run(tmp_path / "before.csv", [1.0, 2.0, 4.0]), "--write_expected", str(expected)]) == 0
    figures = json.loads(expected.read_text())["figures"]
    assert figures == [
        {
            "scene": "a",
            "method": "lazyloc",
            "num_retrieved": 20,
            "num_queries": 3,
            "num_lost": 0,
            "geometric_mean_position_error_cm": 2.0,
            "geometric_mean_rotation_error_deg": 0.2,
        }
    ]
    assert compare.main([str(expected), write_run(tmp_path / "same.csv", [1.1, 2.15, 4.0])]) == 0
    for errors, message in (
        ([1.5, 2.3, 4.0], "ratio 1.199"),
        ([2.0, 2.0, math.nan], "1 lost instead of 0"),
        ([2.0, 2.0], "2 queries instead of 3"),
        ([math.nan] * 3, "ratio inf"),
    ):
        assert compare.main([str(expected), write_run(tmp_path / "worse.csv", errors)]) == 1
        assert message in capsys.readouterr().out
    assert compare.main([str(expected), write_run(tmp_path / "other.csv", [1.0], scene="b")]) == 1
    assert "not in the run" in capsys.readouterr().out


def test_methods_can_be_chosen(tmp_path, capsys):
    path = pathlib.Path(write_run(tmp_path / "a.csv", [1.0]))
    other = dataclasses.replace(evaluation.read_csv(path)[0], method="local_triangulation")
    evaluation.write_csv(path, [*evaluation.read_csv(path), other])
    expected = tmp_path / "expected.json"
    assert compare.main([str(path), "--write_expected", str(expected), "--methods", "lazyloc"]) == 0
    assert [figure["method"] for figure in json.loads(expected.read_text())["figures"]] == ["lazyloc"]
    assert compare.main([str(path), str(path), "--methods", "local_triangulation"]) == 0
    assert "lazyloc" not in capsys.readouterr().out


def test_tolerances_are_kept_when_figures_are_written_again(tmp_path):
    expected, path = tmp_path / "expected.json", write_run(tmp_path / "before.csv", [1.0])
    compare.main([path, "--write_expected", str(expected)])
    tolerance = {"position_ratio": 3.0, "rotation_ratio": 4.0, "num_lost": 1}
    expected.write_text(json.dumps({**json.loads(expected.read_text()), "tolerance": tolerance}))
    compare.main([path, "--write_expected", str(expected)])
    assert json.loads(expected.read_text())["tolerance"] == tolerance


@pytest.mark.parametrize("path", sorted(EXPECTED_PATH.glob("*.json")), ids=lambda path: path.stem)
def test_expected_files_can_fail(path):
    expected = json.loads(path.read_text())
    assert expected["figures"] and all(figure["geometric_mean_position_error_cm"] > 0 for figure in expected["figures"])
    assert 1 < expected["tolerance"]["position_ratio"] < 2 and 1 < expected["tolerance"]["rotation_ratio"] < 2
    assert expected["tolerance"]["num_lost"] == 0


# The reduced run: from photos to the table


@pytest.fixture(scope="module")
def reduced_run(colmap, tmp_path_factory):
    path = tmp_path_factory.mktemp("reduced")
    assert (
        make_demo(["--output_path", str(path / "data"), "--num_database_images", "16", "--num_query_images", "6"]) == 0
    )
    arguments = [
        "--dataset",
        "demo",
        "--data_path",
        str(path / "data"),
        "--max_num_features",
        "2000",
        "--methods",
        "structure_based",
        "lazyloc",
        "local_triangulation",
        "--colmap",
        str(colmap),
        "--work_path",
        str(path / "work"),
        "--output_path",
        str(path),
    ]
    assert run.main([*arguments, "--tag", "first"]) == 0
    assert run.main([*arguments, "--tag", "second"]) == 0
    return path


def test_the_reduced_run_has_the_expected_figures(reduced_run):
    assert compare.main([str(EXPECTED_PATH / "demo_reduced.json"), str(reduced_run / "first.csv")]) == 0


def test_the_reduced_run_repeats(reduced_run):
    first, second = (
        [dataclasses.replace(row, tag="", seconds=0) for row in evaluation.read_csv(reduced_run / name)]
        for name in ("first.csv", "second.csv")
    )
    assert first == second
    assert len(first) == 18


def test_the_reduced_run_writes_the_poses(reduced_run):
    lines = (reduced_run / "work" / "poses" / "first" / "demo_lazyloc_K20_seed0.txt").read_text().splitlines()
    assert [line.split()[0] for line in lines] == [f"query/{i:02}.jpg" for i in range(6)]
