"""Shards on a local Dask cluster: the bytes of one run, also if a worker is killed; failures are named."""

import os
import pathlib
import re
import signal
import subprocess
import sys
import time

import distributed
import pytest

from colmap_lazyloc.cluster import __main__ as cluster
from colmap_lazyloc.cluster import engine, folders
from colmap_lazyloc.cluster.task import ShardTask
from colmap_lazyloc.testing import synthetic
from conftest import MAX_SECONDS, SCRIPTS_PATH, write_lines, write_scene

NUM_QUERIES = 24
NUM_SHARDS = 5


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    scene = synthetic.make_scene(synthetic.arc(6), synthetic.arc(NUM_QUERIES, radius=5, height=-0.7, phase=4), 0.5)
    return write_scene(tmp_path_factory.mktemp("scene"), scene)


@pytest.fixture(scope="module")
def one_run(scene, localize):
    return localize(*scene.arguments)


def arguments(scene, output_path, *options):
    words = ["--num_shards", NUM_SHARDS, *scene.arguments, "--output_path", output_path, "--retries", 0, *options]
    return list(map(str, words))


@pytest.fixture(scope="module")
def scheduler():
    """Gives the address of a scheduler with two workers."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, protocol="tcp://", processes=False, dashboard_address=":0"
    ) as workers:
        yield workers.scheduler_address


@pytest.fixture
def run(colmap, scene, scheduler, capfd):
    """Runs the command on that scheduler; returns its exit code, output and errors."""

    def run_on_scheduler(output_path, *options, program=colmap):
        words = arguments(scene, output_path, "--program", program, "--scheduler", scheduler, *options)
        code = cluster.main(words)
        return code, *capfd.readouterr()

    return run_on_scheduler


def assert_same(output_path, one_run):
    """Checks that all files but options.ini are those of one run, except for the seconds."""

    def contents(folder):
        files = {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        del files[pathlib.Path("options.ini")]
        return {name: re.sub(rb'"seconds":{[^}]*}', b"", content) for name, content in files.items()}

    assert contents(output_path) == contents(one_run.output_path)


def slow(colmap, folder):
    """Makes a program that is colmap, but takes a second before it localizes, so that a test can kill it."""
    script = folder / "slow_colmap"
    script.write_text(f'#!/bin/sh\n[ "$1" != lazy_localizer ] || sleep 1\nexec {colmap} "$@"\n')
    script.chmod(0o755)
    return script


def read(path):
    """Returns a file of /proc; nothing if its process has ended."""
    try:
        return path.read_bytes()
    except (FileNotFoundError, ProcessLookupError):
        return b""


def children(process_id):
    """Returns the ids of the child processes."""
    lists = (read(path) for path in pathlib.Path(f"/proc/{process_id}/task").glob("*/children"))
    return [int(word) for text in lists for word in text.split()]


def wait_for_program(process):
    """Returns the ids of a worker and of the program that it has started."""
    deadline = time.monotonic() + MAX_SECONDS
    while time.monotonic() < deadline and process.poll() is None:
        for worker in children(process.pid):
            for program in children(worker):
                if b"lazy_localizer" in read(pathlib.Path(f"/proc/{program}/cmdline")):
                    return worker, program
        time.sleep(0.05)
    raise AssertionError("no worker has started")


def test_killed_worker_changes_nothing(colmap, scene, one_run, tmp_path):
    words = arguments(scene, tmp_path / "output", "--num_workers", 2, "--dashboard_address", ":0")
    process = subprocess.Popen(
        [sys.executable, "-m", "colmap_lazyloc.cluster", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "COLMAP": str(slow(colmap, tmp_path)), "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    worker, program = wait_for_program(process)
    os.kill(worker, signal.SIGKILL)
    _, errors = process.communicate(timeout=MAX_SECONDS)
    assert process.returncode == 0, errors
    assert not is_running(program), "the program has outlived its worker"
    assert "dashboard: http" in errors and f"{NUM_SHARDS}/{NUM_SHARDS}" in errors
    assert_same(tmp_path / "output", one_run)


def is_running(process_id):
    status = pathlib.Path(f"/proc/{process_id}/status")
    return status.exists() and "State:\tZ" not in status.read_text()


def test_finished_shards_are_not_localized_again(run, one_run, tmp_path):
    output_path, shards = tmp_path / "output", tmp_path / "output.shards"
    assert run(output_path)[0] == 0
    assert_same(output_path, one_run)
    (shards / "2" / "shard" / "manifest.json").unlink()
    (shards / "3" / "shard").rename(shards / "3" / "unfinished")
    before = {i: (shards / f"{i}.log").stat().st_size for i in range(1, NUM_SHARDS + 1)}
    code, _, errors = run(output_path)
    assert code == 0, errors
    assert f"finished before: {NUM_SHARDS - 2} of {NUM_SHARDS} shards" in errors
    grown = [i for i, size in before.items() if (shards / f"{i}.log").stat().st_size > size]
    assert grown == [1, 2, 3], "1 is the shard that is asked about"
    assert_same(output_path, one_run)


def test_other_options_localize_all_shards_again(run, scene, localize, tmp_path):
    assert run(tmp_path / "output")[0] == 0
    changed = ["--LazyLocalizer.num_retrieved", "4"]
    code, _, errors = run(tmp_path / "output", *changed)
    assert code == 0, errors
    assert f"finished before: 1 of {NUM_SHARDS} shards" in errors
    assert_same(tmp_path / "output", localize(*scene.arguments, *changed))


def test_failed_shard_is_named_and_the_others_finish(colmap, run, tmp_path):
    script = tmp_path / "failing_colmap"
    script.write_text(f'#!/bin/sh\ncase "$*" in *"--shard 4/"*) echo no disk >&2; exit 7;; esac\nexec {colmap} "$@"\n')
    script.chmod(0o755)
    code, _, errors = run(tmp_path / "output", program=script)
    assert code == 1
    assert errors.splitlines()[-1].endswith(f": shard 4 of {NUM_SHARDS}: no disk (exit code 7)")
    finished = [i for i in range(1, NUM_SHARDS + 1) if folders.read_manifest(tmp_path / f"output.shards/{i}")]
    assert finished == [1, 2, 3, 5]
    assert not (tmp_path / "output").exists()


def test_shard_is_tried_again(colmap, run, one_run, tmp_path):
    script = tmp_path / "unlucky_colmap"
    script.write_text(
        "#!/bin/sh\n"
        f'case "$*" in *"--shard 4/"*) mkdir {tmp_path}/tried 2>/dev/null && exit 7;; esac\nexec {colmap} "$@"\n'
    )
    script.chmod(0o755)
    code, _, errors = run(tmp_path / "output", "--retries", 1, program=script)
    assert code == 0, errors
    assert_same(tmp_path / "output", one_run)


def test_workers_need_no_package_of_ours(tmp_path):
    task = ShardTask("/no/such/colmap", (), str(tmp_path / "1"), "1/2", "/")
    pickled = tmp_path / "pickled"
    pickled.write_bytes(distributed.protocol.pickle.dumps(engine.portable_call(task)))
    script = f"import pickle; pickle.load(open({str(pickled)!r}, 'rb'))()"
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=environment, cwd="/")
    assert "ShardError: /no/such/colmap: cannot be run: No such file or directory" in done.stderr


def fake_sbatch(folder):
    """Makes a program that takes the place of sbatch: it runs the tasks of a job at once, and prints its number."""
    program = folder / "bin" / "sbatch"
    program.parent.mkdir()
    program.write_text(
        """#!/bin/bash
while [ $# -gt 0 ]; do
  case "$1" in
    --array) array=$2; shift ;;
    --wrap) text=$2; shift ;;
    --output) log=$2; shift ;;
  esac
  shift
done
for index in $(tr , ' ' <<< "${array:-0}"); do
  [ -z "${array:-}" ] && unset SLURM_ARRAY_TASK_ID || export SLURM_ARRAY_TASK_ID=$index
  bash -c "$text" >> "${log//%a/$index}" 2>&1
done
echo 17
"""
    )
    program.chmod(0o755)
    return program.parent


def test_slurm_script_localizes_what_is_not_finished(colmap, scene, one_run, tmp_path):
    environment = {**os.environ, "COLMAP": str(colmap), "PATH": f"{fake_sbatch(tmp_path)}:{os.environ['PATH']}"}
    output_path, shards = tmp_path / "out put", tmp_path / "out put.shards"

    def submit():
        words = [SCRIPTS_PATH / "localize_slurm.sh", NUM_SHARDS, output_path, *scene.arguments]
        return subprocess.run(list(map(str, words)), capture_output=True, text=True, env=environment, check=True).stdout

    assert f"shards 1,2,3,4,5 of {NUM_SHARDS}" in submit()
    assert_same(output_path, one_run)
    (shards / "2" / "shard").rename(shards / "2" / "unfinished")
    assert f"shards 2 of {NUM_SHARDS}" in submit()
    assert submit().splitlines() == [f"job 17: merger, log in {shards}/merger.log"]
    assert_same(output_path, one_run)


def test_slurm_script_explains_its_arguments():
    done = subprocess.run([SCRIPTS_PATH / "localize_slurm.sh", "x", "y"], capture_output=True, text=True)
    assert done.returncode == 1 and "NUM_SHARDS must be a whole number" in done.stderr


BAD_OPTIONS = {
    "option --shard is not for shards on a cluster": ["--shard", "1/2"],
    f"shards 1-{NUM_SHARDS} of {NUM_SHARDS}: ": ["--LazyLocalizer.sed", "1"],
    "--scheduler no-such-host:1: ": ["--scheduler", "no-such-host:1"],
    "/no/such/colmap: cannot be run": ["--program", "/no/such/colmap"],
}


@pytest.mark.parametrize("problem", BAD_OPTIONS)
def test_bad_options_are_named(run, tmp_path, problem, monkeypatch):
    monkeypatch.setattr(engine, "CONNECT_SECONDS", 1)
    code, _, errors = run(tmp_path / "output", *BAD_OPTIONS[problem])
    assert code == 1 and problem in errors.splitlines()[-1]


def test_damaged_manifest_is_named(tmp_path):
    (tmp_path / "shard").mkdir()
    write_lines(tmp_path / "shard/manifest.json", ["[]"])
    with pytest.raises(folders.InputError, match=r"shard/manifest.json: is not a manifest"):
        folders.read_manifest(tmp_path)


@pytest.mark.parametrize("indices, text", [([1], "1"), ([3, 7, 8, 9, 11, 12], "3,7-9,11-12"), ([], "")])
def test_shards_are_named_as_ranges(indices, text):
    assert folders.as_ranges(indices) == text
