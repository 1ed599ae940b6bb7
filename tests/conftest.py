"""Fixtures shared by the tests of the program `colmap lazy_localizer`: the program, how to run it, and scenes."""

import dataclasses
import functools
import os
import pathlib
import re
import shutil
import signal
import subprocess

import pytest

from colmap_lazyloc.model import read_model
from colmap_lazyloc.poses import read_poses
from colmap_lazyloc.program import find_colmap
from colmap_lazyloc.results import read_results
from colmap_lazyloc.testing import synthetic

PROJECT_PATH = pathlib.Path(__file__).resolve().parent.parent
SCRIPTS_PATH = PROJECT_PATH / "scripts"
# Folder of the real scenes; tests on them are skipped if it is missing.
DATA_PATH = pathlib.Path(os.environ.get("LAZYLOC_SHARED_DATA", PROJECT_PATH.parent / "shared" / "data"))
MAX_SECONDS = 300  # a run that takes longer hangs

# OpenCV reads this once, when the first video is opened or written: tests write one before the program sets it.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

# Accepts Ctrl-C again, because background jobs of a shell ignore it, and so would the programs that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


def assert_refused(run, *words):
    """Checks that a run ended with one line of error that has these words, and wrote nothing."""
    assert run.exit_code == 1, run.stderr
    assert run.stderr.startswith("ERROR: ") and run.stderr.count("\n") == 1, run.stderr
    for word in words:
        assert str(word) in run.stderr, run.stderr
    assert not run.output_path.exists()


def split_summary(stderr):
    """Splits the standard error output of a run before the summary that ends it."""
    match = re.search(r"^\n\d+ of \d+ queries done$", stderr, re.MULTILINE)
    begin = len(stderr) if match is None else match.start()
    return stderr[:begin], stderr[begin:]


@dataclasses.dataclass
class Run:
    """A run of `colmap lazy_localizer` that has ended."""

    output_path: pathlib.Path
    exit_code: int
    stdout: str
    standard_error: str

    @property
    def stderr(self):
        """Returns the errors and warnings: the standard error output without the summary."""
        return split_summary(self.standard_error)[0]

    @property
    def summary(self):
        """Returns the end of the standard error output: the table of statuses and what follows it."""
        return split_summary(self.standard_error)[1]

    @property
    def poses_bytes(self):
        return (self.output_path / "poses.txt").read_bytes()

    @functools.cached_property
    def poses(self):
        """Returns the poses of poses.txt by name."""
        return read_poses(self.output_path / "poses.txt")

    @functools.cached_property
    def results(self):
        """Returns the results of results.jsonl by name."""
        return read_results(self.output_path / "results.jsonl")

    @property
    def statuses(self):
        return {name: result["status"] for name, result in self.results.items()}

    @functools.cached_property
    def model_images(self):
        """Returns the images of the written model by name, bit for bit as in the file."""
        return read_model(self.output_path / "model").images

    def pair_names(self, query_name):
        """Returns the database images that the query was compared with."""
        return [pair["name"] for pair in self.results[query_name]["pairs"]]

    def assert_localized(self, scene, names, max_position_error, max_rotation_error_deg):
        assert self.exit_code == 0, self.stderr
        assert sorted(self.poses) == sorted(names), {name: self.results[name]["reason"] for name in self.results}
        for name in names:
            position_error, rotation_error_deg = self.poses[name].errors(scene.images[name].pose)
            assert position_error <= max_position_error, name
            assert rotation_error_deg <= max_rotation_error_deg, name


@pytest.fixture(scope="session")
def colmap():
    path = shutil.which(find_colmap())
    assert path, f"{find_colmap()} is missing: build the program, or name it in the environment variable COLMAP"
    return pathlib.Path(path).resolve()


@pytest.fixture(scope="session")
def localize(colmap, tmp_path_factory):
    """Runs `colmap lazy_localizer` into a new output folder, or into the given one."""

    def run(*arguments, output_path=None, launcher=(), **popen_options):
        if output_path is None:
            output_path = tmp_path_factory.mktemp("run") / "output"
        command = [*launcher, colmap, "lazy_localizer", "--output_path", output_path, *arguments]
        done = subprocess.run(
            list(map(str, command)),
            capture_output=True,
            text=True,
            encoding="utf-8",
            timeout=MAX_SECONDS,
            **popen_options,
        )
        return Run(pathlib.Path(output_path), done.returncode, done.stdout, done.stderr)

    return run


@dataclasses.dataclass
class SceneFiles:
    """A scene and its files for the program; tests must not change them."""

    scene: synthetic.Scene
    database_path: pathlib.Path
    model_path: pathlib.Path

    @property
    def arguments(self):
        return ["--database_path", str(self.database_path), "--input_path", str(self.model_path)]


def write_lines(path, lines):
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def write_scene(folder, scene, **database_options):
    return SceneFiles(
        scene,
        synthetic.write_database(folder / "database.db", scene, **database_options),
        synthetic.write_model(folder / "model", scene),
    )


@pytest.fixture(scope="session")
def write_scene_files():
    return write_scene


@pytest.fixture(scope="session")
def exact(tmp_path_factory):
    """Makes a scene without noise, except that keypoints are rounded to single precision."""
    scene = synthetic.make_scene(synthetic.arc(9), synthetic.arc(3, radius=5, height=-0.7, phase=4))
    return write_scene(tmp_path_factory.mktemp("exact"), scene)


@pytest.fixture(scope="session")
def noisy(tmp_path_factory):
    """Makes a scene with half a pixel of noise, outliers among the raw matches, and matches between all images."""
    scene = synthetic.make_scene(
        synthetic.arc(9),
        synthetic.arc(3, radius=5, height=-0.7, phase=4),
        noise_px=0.5,
        outlier_ratio=0.3,
        database_pairs=True,
    )
    return write_scene(tmp_path_factory.mktemp("noisy"), scene)


@pytest.fixture(scope="session")
def photos(colmap, tmp_path_factory):
    """Makes rendered photos and a database with features of the posed ones; tests must not change them."""
    import photo_scene  # its packages take seconds to load

    return photo_scene.make_photo_scene(tmp_path_factory.mktemp("photos"), colmap)


@pytest.fixture(scope="session")
def jpeg(photos):
    """Returns the bytes of the first query of `photos` as JPEG."""
    import cv2

    pixels = cv2.imread(str(photos.image_path / photos.query_names[0]))
    return cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()


@pytest.fixture(scope="session")
def fingerprint():
    """Returns a function that lists what a folder holds: names, bytes, permissions and times of change."""

    def look(folder):
        entries = {}
        for path in sorted(pathlib.Path(folder).rglob("*")):
            stat = path.lstat()
            content = path.read_bytes() if path.is_file() else None
            entries[str(path.relative_to(folder))] = (content, stat.st_mode, stat.st_mtime_ns, stat.st_ino)
        return entries, pathlib.Path(folder).stat().st_mtime_ns

    return look
