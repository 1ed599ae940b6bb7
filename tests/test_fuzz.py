"""A damaged record of the database ends no run, and does not touch the queries that do not need it."""

import subprocess

import pytest

import fuzz_database

NUM_SEEDS = 300


def test_damaged_records_touch_nothing_else(colmap, tmp_path):
    problems = fuzz_database.run_seeds(colmap, tmp_path, range(NUM_SEEDS), num_jobs=2)
    assert not problems, "\n".join(problems)


@pytest.mark.parametrize(
    "returncode, stderr, expected",
    [
        (-11, "", "exit code -11"),
        (1, "ERROR: database.db: damaged\n", "exit code 1"),
        (0, "ERROR: database.db: damaged\n", "not one line of error"),
        (0, "WARNING: a\x1b[31m\n", "not one line of error"),
        (0, "Segmentation fault\n", "other output"),
    ],
)
def test_fuzzer_notices_a_bad_run(tmp_path, returncode, stderr, expected):
    done = subprocess.CompletedProcess([], returncode, "", stderr)
    damage = fuzz_database.Damage("nothing", set())
    assert expected in fuzz_database.problem_of(done, damage, tmp_path, good={})


def test_fuzzer_notices_a_changed_query(tmp_path):
    (tmp_path / "results.jsonl").write_text('{"name": "a", "status": "NO_PAIRS", "reason": "", "seconds": {}}\n')
    done = subprocess.CompletedProcess([], 0, "", "")
    good = {"a": {"name": "a", "status": "LOCALIZED", "reason": ""}}
    for queries, expected in [({"a"}, ""), (set(), "a differs")]:
        damage = fuzz_database.Damage("nothing", queries)
        assert fuzz_database.problem_of(done, damage, tmp_path, good).startswith(expected)
        assert bool(expected) == bool(fuzz_database.problem_of(done, damage, tmp_path, good))
