"""Tests that a run that was ended anywhere goes on with --resume 1, to the bytes of an undisturbed run."""

import contextlib
import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import time

import pytest

from colmap_lazyloc.testing import synthetic

NUM_QUERIES = 80
# How often the run is killed; more by hand (LAZYLOC_NUM_KILLS=50).
NUM_KILLS = int(os.environ.get("LAZYLOC_NUM_KILLS", "5"))


def output_bytes(folder):
    """Returns the bytes of the output files without the times and without the lines that name the output folder."""
    contents = {}
    for path in sorted(folder.rglob("*")):
        if not path.is_file():
            continue
        content = path.read_bytes()
        if path.name == "results.jsonl":
            results = [json.loads(line) for line in content.splitlines()]
            content = [{key: value for key, value in result.items() if key != "seconds"} for result in results]
            content = json.dumps(content)
        elif path.name == "options.ini":
            varying = (b"output_path", b"#", b"num_threads", b"log_path")
            content = [line for line in content.splitlines() if not line.startswith(varying)]
        contents[str(path.relative_to(folder))] = content
    return contents


@pytest.fixture(scope="module")
def many(tmp_path_factory, write_scene_files):
    """Makes enough queries for a run that takes half a second on any machine."""
    scene = synthetic.make_scene(
        synthetic.arc(6), synthetic.arc(NUM_QUERIES, radius=5, height=0.8), noise_px=0.5, outlier_ratio=0.3
    )
    return write_scene_files(tmp_path_factory.mktemp("many"), scene)


@pytest.fixture(scope="module")
def whole(localize, many):
    run = localize(*many.arguments)
    assert run.exit_code == 0
    assert sorted(path.name for path in run.output_path.iterdir()) == [
        "model",
        "options.ini",
        "poses.txt",
        "positions.csv",
        "results.jsonl",
    ]
    return run


@pytest.fixture
def start(colmap, many, tmp_path):
    """Starts a run in the background and waits for some queries."""

    def run(*arguments, num_done=3, output_path=tmp_path / "output", files=many):
        command = [colmap, "lazy_localizer", *files.arguments, "--output_path", output_path, *arguments]
        process = subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0)
        for _ in range(num_done):
            process.stdout.readline()
        return process

    return run


def test_killed_at_random_moments(start, localize, many, whole, tmp_path):
    moments = random.Random(1)
    output = tmp_path / "output"
    start_time = time.monotonic()
    localize(*many.arguments, output_path=tmp_path / "timed")
    seconds = time.monotonic() - start_time
    for _ in range(NUM_KILLS):
        process = start("--resume", 1, num_done=0)
        time.sleep(moments.uniform(0, 0.7 * seconds))
        process.kill()
        process.communicate()
        if (output / "unfinished").exists():
            assert not (output / "poses.txt").exists() or (output / "unfinished" / "manifest.json").exists()
    run = localize(*many.arguments, "--resume", 1, output_path=output)
    assert run.exit_code == 0, run.stderr
    assert output_bytes(output) == output_bytes(whole.output_path)


def test_killed_again_and_again_after_a_few_queries(start, localize, many, whole, tmp_path):
    """Processes that always die come to an end, because each goes on where the last one was."""
    num_done = 0
    while num_done + 20 < NUM_QUERIES:
        process = start("--resume", 1, num_done=19)
        lines = process.stdout.readline()
        process.kill()
        process.communicate()
        num_before, num_done = num_done, json.loads(lines)["done"]
        assert num_done >= num_before + 20
    run = localize(*many.arguments, "--resume", 1, output_path=tmp_path / "output")
    assert run.stdout.count('{"query"') <= NUM_QUERIES - num_done
    assert output_bytes(run.output_path) == output_bytes(whole.output_path)


@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGTERM])
def test_ended_by_a_signal(start, localize, many, whole, tmp_path, signal_number):
    process = start("--LazyLocalizer.num_threads", 2)
    process.send_signal(signal_number)
    stderr = process.communicate(timeout=120)[1].decode()
    assert process.returncode == 128 + signal_number
    assert stderr.splitlines()[-1] == "partial: to continue, run the same command with --resume 1"
    assert "more queries would take" in stderr
    output = tmp_path / "output"
    num_partial = len((output / "results.jsonl").read_text().splitlines())
    assert 3 <= num_partial < NUM_QUERIES
    run = localize(*many.arguments, "--resume", 1, output_path=output)
    assert run.exit_code == 0
    progress = [json.loads(line) for line in run.stdout.splitlines() if line.startswith("{")]
    assert len(progress) == NUM_QUERIES - num_partial, "queries that were done are not localized again"
    assert progress[-1]["done"] == NUM_QUERIES
    assert output_bytes(output) == output_bytes(whole.output_path)


@pytest.fixture
def unfinished(start, tmp_path):
    """Makes a run that was killed after a few queries."""
    process = start(num_done=5)
    process.kill()
    process.communicate()
    return tmp_path / "output"


def test_unfinished_run_is_said_to_be_unfinished(localize, many, unfinished):
    before = output_bytes(unfinished)
    run = localize(*many.arguments, output_path=unfinished)
    assert run.exit_code == 1
    assert "unfinished: an unfinished run, " in run.stderr and f" of {NUM_QUERIES} queries done" in run.stderr
    assert "--resume 1" in run.stderr and run.stderr.count("\n") == 1
    assert output_bytes(unfinished) == before


def test_overwrite_starts_anew(localize, many, whole, unfinished):
    run = localize(*many.arguments, "--overwrite", 1, output_path=unfinished)
    assert run.stdout.count('{"query"') == NUM_QUERIES
    assert output_bytes(unfinished) == output_bytes(whole.output_path)


def test_resume_without_an_unfinished_run_begins_one(localize, many, whole):
    run = localize(*many.arguments, "--resume", 1)
    assert output_bytes(run.output_path) == output_bytes(whole.output_path)


def assert_refused(run, *words):
    assert run.exit_code == 1
    assert run.stderr.count("\n") == 1
    for word in ("the run cannot go on, because", *words):
        assert word in run.stderr


def test_changed_options_are_refused(localize, many, unfinished):
    run = localize(*many.arguments, "--resume", 1, "--LazyLocalizer.seed", 1, output_path=unfinished)
    assert_refused(run, "option --LazyLocalizer.seed is '1' and was '0'")
    run = localize(*many.arguments, "--resume", 1, "--shard", "1/2", output_path=unfinished)
    assert_refused(run, "option --shard is '1/2' and was ''")


def test_options_without_effect_may_change(localize, many, whole, unfinished):
    options = ["--LazyLocalizer.num_threads", 1, "--LazyLocalizer.Advanced.cache_gb", 0.5, "--strict", 1]
    run = localize(*many.arguments, "--resume", 1, *options, output_path=unfinished)
    assert run.exit_code == 0
    assert run.poses_bytes == whole.poses_bytes


def test_changed_inputs_are_refused(localize, many, unfinished, tmp_path):
    database = tmp_path / "database.db"
    shutil.copy(many.database_path, database)
    arguments = ["--database_path", database, "--input_path", many.model_path, "--resume", 1]
    # One bit of a keypoint, in the mode in which COLMAP writes: the header of the file stays as it is.
    with contextlib.closing(sqlite3.connect(database)) as connection, connection:
        connection.execute("PRAGMA journal_mode = WAL")
        data = bytearray(connection.execute("SELECT data FROM keypoints WHERE image_id = 1").fetchone()[0])
        data[0] ^= 1
        connection.execute("UPDATE keypoints SET data = ? WHERE image_id = 1", [data])
    assert_refused(localize(*arguments, output_path=unfinished), f"{database} (--database_path) has changed")
    scene = many.scene.copy()
    scene.images[scene.database_names[0]].pose.tvec[0] += 1e-9
    model = synthetic.write_model(tmp_path / "model", scene)
    arguments = ["--database_path", many.database_path, "--input_path", model, "--resume", 1]
    assert_refused(localize(*arguments, output_path=unfinished), f"{model} (--input_path) has changed")


def test_copies_in_other_places_and_formats_are_the_same_input(localize, many, whole, unfinished, tmp_path):
    shutil.copy(many.database_path, tmp_path / "copy.db")
    model = synthetic.write_model(tmp_path / "text", many.scene, binary=False)
    arguments = ["--database_path", tmp_path / "copy.db", "--input_path", model, "--resume", 1]
    run = localize(*arguments, output_path=unfinished)
    assert run.exit_code == 0, run.stderr
    assert run.poses_bytes == whole.poses_bytes


def test_a_torn_record_is_localized_again(localize, many, whole, unfinished):
    records = unfinished / "unfinished" / "records.bin"
    content = records.read_bytes()
    records.write_bytes(content[: len(content) * 2 // 3])
    run = localize(*many.arguments, "--resume", 1, output_path=unfinished)
    assert run.exit_code == 0
    assert output_bytes(unfinished) == output_bytes(whole.output_path)


def test_two_processes_do_not_share_a_folder(start, localize, many, whole, tmp_path):
    process = start("--LazyLocalizer.num_threads", 1)
    process.send_signal(signal.SIGSTOP)
    try:
        run = localize(*many.arguments, "--resume", 1, output_path=tmp_path / "output")
        assert run.exit_code == 1 and "another process is writing it" in run.stderr
        run = localize(*many.arguments, "--overwrite", 1, output_path=tmp_path / "output")
        assert run.exit_code == 1 and "another process is writing it" in run.stderr
    finally:
        process.send_signal(signal.SIGCONT)
    process.communicate(timeout=120)
    assert output_bytes(tmp_path / "output") == output_bytes(whole.output_path)


def test_log_is_appended(start, localize, many, tmp_path):
    log = tmp_path / "log.jsonl"
    process = start("--log_path", log, num_done=10)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=120)
    localize(*many.arguments, "--log_path", log, "--resume", 1, output_path=tmp_path / "output")
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    assert [line["done"] for line in lines] == list(range(1, NUM_QUERIES + 1))
    assert {line["query"] for line in lines} == set(many.scene.query_names)
    localize(*many.arguments, "--log_path", log)
    assert len(log.read_text().splitlines()) == NUM_QUERIES, "a new run has a new log"


@pytest.fixture
def small_disk(tmp_path):
    """Mounts a file system of a few megabytes; needs the rights to."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("mounting is not permitted")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


def remount(folder, options):
    subprocess.run(["mount", "-o", f"remount,{options}", str(folder)], check=True)


def test_full_disk(localize, many, whole, small_disk):
    output = small_disk / "output"
    run = localize(*many.arguments, output_path=output)
    assert run.exit_code == 1
    assert run.stderr.count("\n") == 1 and "No space left on device" in run.stderr
    assert 0 < len([line for line in run.stdout.splitlines() if line.startswith("{")]) < NUM_QUERIES
    assert not (output / "poses.txt").exists()
    remount(small_disk, "size=100m")
    run = localize(*many.arguments, "--resume", 1, output_path=output)
    assert run.exit_code == 0, run.stderr
    assert run.stdout.count('{"query"') < NUM_QUERIES
    assert output_bytes(output) == output_bytes(whole.output_path)


def test_disk_that_is_full_when_the_results_are_written(localize, many, whole, small_disk):
    """All queries are done; the results do not fit."""
    output = small_disk / "output"
    remount(small_disk, "size=100m")
    localize(*many.arguments, "--shard", "1/1", output_path=output)
    sizes = {path.name: path.stat().st_size for path in output.rglob("*") if path.is_file()}
    shutil.rmtree(output)
    records_size = sizes.pop("records.bin")
    remount(small_disk, f"size={records_size + sum(sizes.values()) // 2 + 16384}")
    run = localize(*many.arguments, output_path=output)
    assert run.stdout.count('{"query"') == NUM_QUERIES
    assert run.exit_code == 1
    assert "cannot be written" in run.stderr and run.stderr.count("\n") == 1
    assert [path.name for path in output.iterdir()] == ["unfinished"], "nothing half-written is taken for finished"
    remount(small_disk, "size=100m")
    run = localize(*many.arguments, "--resume", 1, output_path=output)
    assert run.exit_code == 0 and '{"query"' not in run.stdout
    assert output_bytes(output) == output_bytes(whole.output_path)


def test_output_that_becomes_read_only(start, localize, many, whole, tmp_path):
    process = start("--LazyLocalizer.num_threads", 1)
    process.send_signal(signal.SIGSTOP)
    output = tmp_path / "output"
    # Holds for root and for open files too, unlike permissions and a read-only mount.
    records = str(output / "unfinished" / "records.bin")
    if shutil.which("chattr") is None or subprocess.run(["chattr", "+i", records], capture_output=True).returncode != 0:
        process.kill()
        pytest.skip("the file system has no immutable files")
    process.send_signal(signal.SIGCONT)
    stderr = process.communicate(timeout=120)[1].decode()
    subprocess.run(["chattr", "-i", records], check=True)
    assert process.returncode == 1 and stderr.count("\n") == 1 and "records.bin: cannot be written" in stderr
    run = localize(*many.arguments, "--resume", 1, output_path=output)
    assert run.exit_code == 0, run.stderr
    assert output_bytes(output) == output_bytes(whole.output_path)
