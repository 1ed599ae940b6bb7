"""Tests of the Python package in its process: threads, memory, Ctrl-C, other libraries, forks, console commands."""

import json
import os
import pathlib
import signal
import subprocess
import sys
import textwrap
import threading

import pytest

import colmap_lazyloc as ll
from colmap_lazyloc.extension import core
from conftest import split_summary

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(pathlib.Path(ll.__file__).resolve().parents[1])}


def run_python(code, *arguments, **options):
    """Runs code in a process of its own; it must end well and print nothing to the standard error output."""
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=300,
        env=ENVIRONMENT,
        **options,
    )
    assert done.returncode == 0 and done.stderr == "", (done.returncode, done.stderr)
    return done.stdout


def test_module_exports_only_its_entry_point():
    symbols = subprocess.run(
        ["nm", "-D", "--defined-only", core.__file__], capture_output=True, text=True, check=True
    ).stdout
    assert [line.split()[-1] for line in symbols.splitlines()] == ["PyInit__core"]


def test_pure_modules_do_not_need_the_extension_module():
    run_python("""
        import sys
        import colmap_lazyloc, colmap_lazyloc.errors, colmap_lazyloc.model, colmap_lazyloc.poses, colmap_lazyloc.results
        assert not any(name.endswith("_core") for name in sys.modules if name.startswith("colmap_lazyloc"))
        assert "Localizer" in dir(colmap_lazyloc)
        """)


LOCALIZE = """
import sys
def localize():
    import colmap_lazyloc as ll
    with ll.Localizer(sys.argv[1], sys.argv[2]) as localizer:
        results = list(localizer.localize_all())
    assert all(result.is_localized for result in results) and results
def use_pycolmap():
    import numpy as np
    import pycolmap
    camera = pycolmap.Camera(model="PINHOLE", width=640, height=480, params=[500, 500, 320, 240])
    points = np.random.default_rng(0).uniform(-1, 1, (40, 3)) + [0, 0, 4]
    xy = points[:, :2] / points[:, 2:] * 500 + [320, 240]
    found = pycolmap.estimate_and_refine_absolute_pose(xy, points, camera)
    assert found["num_inliers"] == 40
def use_others():
    import cv2, h5py, numpy as np
    assert len(cv2.SIFT_create().detect(np.random.default_rng(0).integers(0, 255, (99, 99), np.uint8), None)) > 0
"""


@pytest.mark.parametrize(
    "order",
    [
        "use_pycolmap(); localize(); use_pycolmap()",
        "localize(); use_pycolmap(); localize()",
        "import pycolmap; localize(); use_others(); use_pycolmap()",
        "use_others(); use_pycolmap(); localize()",
        "localize(); use_others(); use_pycolmap()",
    ],
)
def test_other_libraries_in_any_order(exact, order):
    assert run_python(f"{LOCALIZE}\n{order}", exact.database_path, exact.model_path) == ""


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_child_processes(photos, tmp_path, method):
    code = """
        import multiprocessing, sys
        import colmap_lazyloc as ll
        options = {"SiftExtraction.max_num_features": 1500, "first_octave": 0}
        def localize(localizer=None):
            localizer = localizer or ll.Localizer(sys.argv[1], sys.argv[2], options=options)
            result = localizer.localize_photo(sys.argv[3], name="query")
            return result.is_localized, result.pose.bits()
        def work(expected):
            # A forked child uses its parent's localizer, too.
            assert localize() == expected and ("opened" not in globals() or localize(opened) == expected)
        if __name__ == "__main__":
            expected = localize(opened := ll.Localizer(sys.argv[1], sys.argv[2], options=options))
            context = multiprocessing.get_context(sys.argv[4])
            children = [context.Process(target=work, args=(expected,)) for _ in range(2)]
            for child in children: child.start()
            for child in children: child.join()
            assert [child.exitcode for child in children] == [0, 0]
            assert localize(opened) == expected
        """
    program = tmp_path / "program.py"
    program.write_text(textwrap.dedent(code))
    photo = photos.image_path / photos.query_names[0]
    done = subprocess.run(
        [sys.executable, program, photos.database_path, photos.model_path, photo, method],
        capture_output=True,
        text=True,
        timeout=300,
        env=ENVIRONMENT,
    )
    assert done.returncode == 0 and done.stderr == "", done.stderr


def test_calls_of_several_threads_share_a_localizer(noisy):
    localizer = ll.Localizer(noisy.database_path, noisy.model_path, options={"leave_one_out": True})
    expected = {name: localizer.localize(name).pose.bits() for name in localizer.queries}
    found = []

    def work():
        found.append({name: localizer.localize(name).pose.bits() for name in localizer.queries})

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [expected] * 4


def test_other_threads_run_during_a_call(noisy):
    """Calls release Python's lock: a second thread counts on while the first localizes."""
    localizer = ll.Localizer(noisy.database_path, noisy.model_path)
    counts, stop = [0], threading.Event()

    def count():
        while not stop.is_set():
            counts[0] += 1

    thread = threading.Thread(target=count, daemon=True)
    thread.start()
    name = localizer.queries[0]
    group = localizer._core.find_group(name)
    before = counts[0]
    for _ in range(50):
        localizer._core.localize_group(group, name, [], [])
    during = counts[0] - before
    stop.set()
    thread.join()
    assert during > 1000


def test_memory_does_not_grow_with_calls(noisy):
    code = """
        import sys
        import colmap_lazyloc as ll
        def resident_kb():
            return next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmRSS"))
        localizer = ll.Localizer(sys.argv[1], sys.argv[2])
        names = localizer.queries
        sizes = []
        for i in range(600):
            localizer.localize(names[i % len(names)])
            sizes.append(resident_kb())
        print(sizes[49], sizes[599])
        """
    after_50, after_600 = map(int, run_python(code, noisy.database_path, noisy.model_path).split())
    assert after_600 - after_50 < 3000  # kilobytes; a query's answer alone takes tens


def test_ctrl_c_ends_localize_all(noisy):
    code = """
        import os, signal, sys, threading, time
        import colmap_lazyloc as ll
        localizer = ll.Localizer(sys.argv[1], sys.argv[2], options={"leave_one_out": True})
        threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
        try:
            while True:
                for result in localizer.localize_all(num_threads=2):
                    pass
        except KeyboardInterrupt:
            end = time.monotonic() + 60  # Ctrl-C may have come while threads were started or waited for
            while any(thread.name.startswith("lazyloc") for thread in threading.enumerate()):
                assert time.monotonic() < end
                time.sleep(0.01)
            print("interrupted")
        assert localizer.localize(localizer.queries[0]).is_localized
        """
    assert run_python(code, noisy.database_path, noisy.model_path) == "interrupted\n"


COMMAND = "import sys; from colmap_lazyloc import commands; sys.exit(getattr(commands, sys.argv.pop(1))())"


def run_command(name, *arguments):
    return subprocess.Popen(
        [sys.executable, "-c", COMMAND, name, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
    )


def test_console_command_is_the_program(localize, noisy, tmp_path):
    run = localize(*noisy.arguments)
    process = run_command("lazy_localizer", *noisy.arguments, "--output_path", tmp_path / "output")
    stdout, stderr = process.communicate(timeout=300)
    assert process.returncode == 0 and split_summary(stderr)[0] == ""
    assert [json.loads(line)["status"] for line in stdout.splitlines()] == ["LOCALIZED"] * len(run.poses)
    assert (tmp_path / "output" / "poses.txt").read_bytes() == run.poses_bytes
    process = run_command("lazy_localizer", "--nonsense")
    assert "nonsense" in process.communicate(timeout=300)[1] and process.returncode == 1
    process = run_command("lazy_indexer", "--help")
    assert "--index_path" in process.communicate(timeout=300)[0] and process.returncode == 0


def test_console_command_ends_in_order_after_ctrl_c(noisy, tmp_path):
    slow = ["--LazyLocalizer.leave_one_out", 1, "--LazyLocalizer.num_threads", 1]
    process = run_command("lazy_localizer", *noisy.arguments, *slow, "--output_path", tmp_path / "output")
    process.stdout.readline()  # the first query is done
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=300)
    assert process.returncode in (0, 130) and split_summary(stderr)[0] == ""
    assert (tmp_path / "output" / "results.jsonl").exists()
