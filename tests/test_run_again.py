"""`lazyloc run` again in one folder, after a change: the result is that of a fresh folder, byte for byte."""

import contextlib
import hashlib
import itertools
import json
import os
import pathlib
import shutil
import signal
import sqlite3
import subprocess
import sys
import time

import cv2
import numpy as np
import pytest

import photo_scene
from colmap_lazyloc.__main__ import main
from colmap_lazyloc.demo.renderer import RayGrid
from colmap_lazyloc.poses import read_poses
from colmap_lazyloc.program import find_option
from colmap_lazyloc.project import steps
from colmap_lazyloc.project.folder import RECORD
from colmap_lazyloc.report import __main__ as report

CAMERA = photo_scene.CAMERA
FEATURES = ("--SiftExtraction.max_num_features", "800", "--SiftExtraction.first_octave", "0")
OTHER_CENTRES = [(0.2, -2.9, 1.4), (-2.4, -3.3, 1.9)]
WALK = [(-1.6 + 0.5 * step, -2.9 - 0.2 * step, 1.7) for step in range(3)]
POLLING_SECONDS, MAX_SECONDS = 0.005, 120


@pytest.fixture(scope="module")
def slow_colmap(colmap, tmp_path_factory):
    """Makes a colmap that matches and localizes with one thread.

    COLMAP's threads verify the pairs in any order, each with random numbers that go on. Localization can be interrupted
    between two queries.
    """
    path = tmp_path_factory.mktemp("program") / "colmap"
    matching = find_option(colmap, "matches_importer", r"(Sift|Feature)Matching\.num_threads", "for threads")
    path.write_text(f"""#!/bin/sh
case "$1 $2" in
  *--help*) ;;
  lazy_matches_importer*) exec {colmap} "$@" {matching} 1 ;;
  lazy_localizer*) exec {colmap} "$@" --LazyLocalizer.num_threads 1 ;;
esac
exec {colmap} "$@"
""")
    path.chmod(0o755)
    return path


class Work:
    """A folder of photos, queries, masks, videos and poses, in which tests change something."""

    def __init__(self, folder, photos, others):
        self.folder, self.others = folder, others
        for name in ("database", "query"):
            shutil.copytree(photos.image_path / name, folder / name)
        shutil.copytree(photos.model_path, folder / "poses")
        shutil.copy(others / "walk.avi", folder / "walk.avi")
        self.write_masks(0)

    def write_masks(self, third):
        mask = np.full((CAMERA.height, CAMERA.width), 255, np.uint8)
        mask[:, third * CAMERA.width // 3 : (third + 1) * CAMERA.width // 3] = 0
        for photo in [*self.folder.glob("database/*.png"), *self.folder.glob("query/*.png")]:
            path = self.folder / "masks" / photo.parent.name / f"{photo.name}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            assert cv2.imwrite(str(path), mask)

    def replace_queries(self):
        self._replace("query/0.png", "0.png")
        self._replace("query/1.png", "1.png")

    def replace_video(self):
        self._replace("walk.avi", "back.avi")

    def replace_database_photo(self):
        self._replace("database/2.png", "noisy.png")

    def _replace(self, name, other):
        """Replaces a file by one of another content, whose size and time do not show it, if they can be kept."""
        path, new = self.folder / name, self.others / other
        stat = path.stat()
        data = new.read_bytes()
        path.write_bytes(data + bytes(max(0, stat.st_size - len(data))))
        os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))

    def swap_queries(self):
        first, second = self.folder / "query" / "0.png", self.folder / "query" / "1.png"
        first.rename(self.folder / "kept.png")
        second.rename(first)
        (self.folder / "kept.png").rename(second)

    def remove_query(self):
        (self.folder / "query" / "0.png").unlink()

    def change_masks(self):
        self.write_masks(2)

    def enlarge_poses(self):
        path = self.folder / "poses" / "images.txt"
        lines = path.read_text().splitlines()
        for index, line in enumerate(lines):
            words = line.split()
            if len(words) == 10 and not line.startswith("#"):
                words[5:8] = [repr(2 * float(word)) for word in words[5:8]]
                lines[index] = " ".join(words)
        path.write_text("\n".join(lines) + "\n")

    def keep(self):
        """Changes nothing."""

    def key(self):
        files = sorted(path for path in self.folder.rglob("*") if path.is_file())
        return hashlib.sha256(
            b"".join(str(path.relative_to(self.folder)).encode() + path.read_bytes() for path in files)
        ).hexdigest()

    def words(self, output, more):
        words = ["run", "--database_images", self.folder / "database", "--poses", self.folder / "poses"]
        words += ["--output", output, *FEATURES]
        words += [*([] if "--queries" in more else ["--queries", self.folder / "query"]), *more]
        return [str(word).replace("WORK", str(self.folder)) for word in words]


@pytest.fixture(scope="module")
def others(tmp_path_factory):
    """Renders photos and videos for another run."""
    folder = tmp_path_factory.mktemp("others")
    rectangles, rays = photo_scene.build_courtyard(), RayGrid(CAMERA)

    def photo(centre, seed):
        return photo_scene.take_photo(rectangles, rays, photo_scene.look_at_target(centre, roll_deg=1.0), seed)

    for index, centre in enumerate(OTHER_CENTRES):
        cv2.imwrite(str(folder / f"{index}.png"), photo(centre, 50 + index))
    cv2.imwrite(str(folder / "noisy.png"), photo(photo_scene.DATABASE_CENTRES[2], 60))
    frames = [photo(centre, 70 + index) for index, centre in enumerate(WALK)]
    for name, sequence in (("walk", frames), ("back", frames[::-1])):
        code = cv2.VideoWriter_fourcc(*"MJPG")
        writer = cv2.VideoWriter(str(folder / f"{name}.avi"), code, 2, (CAMERA.width, CAMERA.height))
        for frame in sequence:
            writer.write(frame)
        writer.release()
    return folder


@pytest.fixture
def work(photos, others, tmp_path):
    (tmp_path / "work").mkdir()
    return Work(tmp_path / "work", photos, others)


@pytest.fixture
def run(slow_colmap, monkeypatch):
    """Returns a function that runs `lazyloc run`, without the page of the report."""

    def write_report(words):
        pathlib.Path(words[words.index("--output") + 1]).write_text("report")
        return 0

    monkeypatch.setenv("COLMAP", str(slow_colmap))
    monkeypatch.setattr(report, "main", write_report)

    def start(work, output, more=()):
        assert main(work.words(output, more)) == 0
        return output

    return start


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Keeps the output of runs in fresh folders, by their input."""
    return tmp_path_factory.mktemp("finished"), {}


@pytest.fixture
def fresh(run, finished):
    """Returns a function that runs in a fresh folder, unless there was a run of the same input."""
    folder, outputs = finished

    def start(work, more=()):
        key = (work.key(), *more)
        if key not in outputs:
            outputs[key] = run(work, folder / str(len(outputs)), more)
        return outputs[key]

    return start


def result(output):
    """Returns all that a run has found, and what its databases hold, without the seconds that it took."""
    files = [output / "localized" / name for name in ("poses.txt", "positions.csv")]
    files += sorted((output / "model").iterdir()) + sorted((output / "localized" / "model").iterdir())
    found = {str(path.relative_to(output)): path.read_bytes() for path in files}
    for line in (output / "localized" / "results.jsonl").read_text().splitlines():
        record = json.loads(line)
        assert record.pop("seconds")
        found[f"result of {record['name']}"] = record
    for path in sorted(output.glob("*.db")):
        with contextlib.closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as database:
            for table in ("cameras", "images", "keypoints", "descriptors", "matches", "two_view_geometries"):
                found[f"{table} of {path.name}"] = database.execute(f"SELECT * FROM {table} ORDER BY 1").fetchall()
    return found


def assert_same(output, expected):
    found = result(output)
    assert list(found) == list(expected)
    for name, content in expected.items():
        assert found[name] == content, name


MASKS, SEQUENCE = ("--masks", "WORK/masks"), ("--sequence", "2")
VIDEO = ("--queries", "WORK/walk.avi")
OTHER_CAMERA = "SIMPLE_RADIAL 480 360 420 241 179 -0.03"
CASES = {
    "other queries": ((), Work.replace_queries, ()),
    "other queries with masks": (MASKS, Work.replace_queries, MASKS),
    "other queries in a sequence": (SEQUENCE, Work.replace_queries, SEQUENCE),
    "another video": (VIDEO, Work.replace_video, VIDEO),
    "another video in a sequence": ((*VIDEO, *SEQUENCE), Work.replace_video, (*VIDEO, *SEQUENCE)),
    "fewer queries": (MASKS, Work.remove_query, MASKS),
    "other masks": (MASKS, Work.change_masks, MASKS),
    "no masks any more": (MASKS, Work.keep, ()),
    "another query camera": (MASKS, Work.keep, (*MASKS, "--query_camera", OTHER_CAMERA)),
    "other features": ((), Work.keep, ("--SiftExtraction.upright", "1")),
    "swapped names": (SEQUENCE, Work.swap_queries, SEQUENCE),
    "other poses": ((), Work.enlarge_poses, ()),
    "another database photo": ((), Work.replace_database_photo, ()),
    "fewer neighbours": (SEQUENCE, Work.keep, (*SEQUENCE, "--num_neighbors", "1")),
}


@pytest.mark.parametrize("case", CASES)
def test_changed_input_gives_what_a_fresh_folder_gives(case, work, run, fresh, tmp_path):
    words, change, words_after = CASES[case]
    output = tmp_path / "output"
    before = fresh(work, words)
    shutil.copytree(before, output, symlinks=True)
    change(work)
    expected = result(fresh(work, words_after))
    assert len(read_poses(before / "localized" / "poses.txt")) > 0
    assert result(before) != expected, "the change has an effect"
    assert_same(run(work, output, words_after), expected)


def test_index_is_that_of_the_photos(work, run, tmp_path, monkeypatch):
    """The index finds images by name: photos are as good as the index is new."""
    monkeypatch.setattr(steps, "MAX_NUM_EXHAUSTIVE", 3)  # of 6 database images
    run(work, tmp_path / "output")
    work.replace_database_photo()
    work.replace_queries()
    run(work, tmp_path / "fresh")
    assert_same(run(work, tmp_path / "output"), result(tmp_path / "fresh"))
    assert (tmp_path / "output" / "database.index").exists()


def test_unchanged_input_costs_nothing_and_other_queries_no_features(work, run, fresh, tmp_path, capsys):
    output = tmp_path / "output"
    shutil.copytree(fresh(work), output, symlinks=True)
    capsys.readouterr()
    run(work, output)
    assert "features" not in (printed := capsys.readouterr().err) and "localizing" not in printed
    work.replace_queries()
    run(work, output)
    assert "features" not in (printed := capsys.readouterr().err) and "matching" not in printed
    assert "localizing" in printed


def count_rows(path, table):
    with (
        contextlib.suppress(sqlite3.Error),
        contextlib.closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as db,
    ):
        return db.execute(f"SELECT COUNT(*) FROM {table}").fetchone()[0]
    return 0


def is_extracting(output):
    return count_rows(output / "database.db", "keypoints") >= 2


def is_matching(output):
    return count_rows(output / "database.db", "two_view_geometries") >= 3


def is_matching_queries(output):
    """True if there are matches of more than the 15 pairs of database images."""
    return max(count_rows(output / name, "two_view_geometries") for name in ("queries.db", "database.db")) >= 17


def is_localizing(output):
    records = output / "localized" / "unfinished" / "records.bin"
    return records.exists() and records.stat().st_size > 0


@pytest.fixture
def kill(slow_colmap):
    """Returns a function that runs `lazyloc run`, ends it when it has reached something, and returns the lines of its
    standard error output and its exit code."""

    def start(work, output, words, is_reached, how=signal.SIGKILL):
        command = [sys.executable, "-m", "colmap_lazyloc", *work.words(output, words)]
        environment = {**os.environ, "COLMAP": str(slow_colmap), "PYTHONPATH": os.pathsep.join(sys.path)}
        pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
        end = time.monotonic() + MAX_SECONDS
        process = subprocess.Popen(command, env=environment, **pipes)
        while not is_reached(output):
            assert time.monotonic() < end, "it was not reached"
            if process.poll() is None or is_reached(output):
                time.sleep(POLLING_SECONDS)
                continue
            # Localization may begin and end between two looks. Then it is done again.
            assert process.returncode == 0, process.stderr.read()
            shutil.rmtree(output / "localized")
            process = subprocess.Popen(command, env=environment, **pipes)
        process.send_signal(how)
        return process.communicate()[1].splitlines(), process.returncode

    return start


@pytest.mark.parametrize(
    ("is_reached", "words"),
    [(is_extracting, SEQUENCE), (is_matching, SEQUENCE), (is_matching_queries, SEQUENCE), (is_localizing, ())],
)
def test_killed_run_given_again(is_reached, words, work, run, fresh, kill, tmp_path):
    kill(work, tmp_path / "output", words, is_reached)
    assert_same(run(work, tmp_path / "output", words), result(fresh(work, words)))


def count_done(output):
    """Returns how far a run is: two for each finished step, and one for each that has begun."""
    record = output / RECORD
    keys = json.loads(record.read_text()) if record.exists() else {}
    return sum(1 if key.endswith("begun") else 2 for key in keys.values())


def test_run_interrupted_at_ten_points(work, run, fresh, kill, tmp_path):
    output, how = tmp_path / "output", itertools.cycle((signal.SIGKILL, signal.SIGINT))
    points = [lambda output, count=count: count_done(output) >= count for count in range(1, 9)]
    points += [is_localizing, lambda output: (output / "localized" / "results.jsonl").exists()]
    for is_reached in points:
        kill(work, output, (), is_reached, next(how))
    assert count_done(output) == 8
    assert_same(run(work, output), result(fresh(work)))


def test_killed_run_leaves_nothing_to_another(work, run, fresh, kill, tmp_path):
    kill(work, tmp_path / "output", SEQUENCE, is_matching_queries)
    work.replace_queries()
    assert_same(run(work, tmp_path / "output", SEQUENCE), result(fresh(work, SEQUENCE)))


def test_interrupted_run_says_how_to_go_on(work, run, fresh, kill, tmp_path):
    lines, code = kill(work, tmp_path / "output", (), is_extracting, how=signal.SIGINT)
    assert lines[-1] == "lazyloc run: interrupted; to continue, run the same command again" and code == 130
    assert_same(run(work, tmp_path / "output"), result(fresh(work)))
