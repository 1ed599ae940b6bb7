"""Bad input ends `colmap lazy_localizer` with one clear line, exit code 1 and nothing written."""

import pathlib
import shutil
import sqlite3
import struct
import subprocess

import numpy as np
import pytest

from colmap_lazyloc.testing import synthetic
from conftest import split_summary

CASES = {}


def case(*named):
    """Registers a case: a function that spoils the files, and returns additional or other arguments. `named`: what
    the message must name."""

    def register(spoil):
        CASES[spoil.__name__] = spoil, named
        return spoil

    return register


class Files:
    """A good scene's files, for a case to spoil."""

    def __init__(self, folder, source):
        self.folder = folder
        self.scene = source.scene.copy()
        self.database = folder / "database.db"
        self.model = folder / "model"
        shutil.copy(source.database_path, self.database)
        shutil.copytree(source.model_path, self.model)

    def sql(self, statement, *values):
        with sqlite3.connect(self.database) as connection:
            connection.execute(statement, values)
        connection.close()

    def text_model(self, old="", new=""):
        shutil.rmtree(self.model)
        synthetic.write_model(self.model, self.scene, binary=False)
        for path in self.model.iterdir():
            path.write_text(path.read_text().replace(old, new))

    def write(self, name, text):
        (self.folder / name).write_text(text)
        return self.folder / name

    def query_list(self, text):
        return ["--query_list_path", self.write("list.txt", text)]

    def arguments(self, changed):
        """Returns the command line. `changed`: None, a list of further arguments, or a dictionary of other values."""
        options = {"--database_path": self.database, "--input_path": self.model, "--output_path": self.folder / "out"}
        if isinstance(changed, dict):
            options.update(changed)
            changed = []
        words = [word for name, value in options.items() if value is not None for word in (name, value)]
        return [str(word) for word in [*words, *(changed or [])]]


# Database files


@case("database.db")
def missing_database(files):
    files.database.unlink()


@case("database.db")
def empty_database(files):
    files.database.write_bytes(b"")


@case("database.db")
def truncated_database(files):
    content = files.database.read_bytes()
    files.database.write_bytes(content[: len(content) // 2])


@case("database.db")
def database_truncated_in_its_header(files):
    files.database.write_bytes(files.database.read_bytes()[:50])


@case("database.db")
def non_sqlite_database(files):
    files.database.write_bytes(b"not a database\n" * 1000)


@case("database.db")
def database_overwritten_in_its_middle(files):
    content = bytearray(files.database.read_bytes())
    content[2048:-2048] = b"\xff" * (len(content) - 4096)
    files.database.write_bytes(content)


@case("--database_path")
def database_path_is_empty(files):
    return {"--database_path": ""}


@case("database.db")
def database_is_a_folder(files):
    files.database.unlink()
    files.database.mkdir()


@case("database.db")
def sqlite_database_of_another_program(files):
    files.database.unlink()
    files.sql("CREATE TABLE songs (title TEXT)")


@case("database.db", "two_view_geometries")
def database_without_two_view_geometries(files):
    files.sql("DROP TABLE two_view_geometries")


@case("database.db", "keypoints")
def database_without_keypoints(files):
    files.sql("DROP TABLE keypoints")


# Models


@case("model")
def missing_model(files):
    shutil.rmtree(files.model)


@case("model")
def folder_without_a_model(files):
    shutil.rmtree(files.model)
    files.model.mkdir()


@case("images.bin")
def model_without_poses(files):
    (files.model / "images.bin").write_bytes(bytes(8))


@case("images.txt")
def text_model_without_poses(files):
    files.text_model()
    (files.model / "images.txt").write_text("# Image list\n")


@case("images.bin")
def truncated_images_file(files):
    path = files.model / "images.bin"
    path.write_bytes(path.read_bytes()[:-40])


@case("images.bin")
def impossible_count_of_images(files):
    path = files.model / "images.bin"
    path.write_bytes(b"\xff" * 8 + path.read_bytes()[8:])


@case("cameras.bin")
def truncated_cameras_file(files):
    path = files.model / "cameras.bin"
    path.write_bytes(path.read_bytes()[:20])


@case("cameras.bin", "camera model", "99")
def unknown_camera_model_in_the_model(files):
    path = files.model / "cameras.bin"
    content = path.read_bytes()
    path.write_bytes(content[:12] + struct.pack("<i", 99) + content[16:])


@case("cameras.txt", "NO_SUCH_MODEL")
def unknown_camera_model_in_a_text_model(files):
    files.text_model("SIMPLE_RADIAL", "NO_SUCH_MODEL")


@case("cameras.bin", "finite")
def nan_in_a_camera_of_the_model(files):
    files.scene.cameras[1].params[0] = np.nan
    synthetic.write_model(files.model, files.scene)


@case("images.bin", "database/002.jpg")
def nan_in_a_pose(files):
    files.scene.images["database/002.jpg"].pose.tvec[1] = np.nan
    synthetic.write_model(files.model, files.scene)


@case("images.txt", ":")
def nan_in_a_pose_of_a_text_model(files):
    files.scene.images["database/002.jpg"].pose.qvec[1] = np.nan
    files.text_model()


@case("images.bin", "database/002.jpg")
def zero_quaternion(files):
    files.scene.images["database/002.jpg"].pose.qvec[:] = 0
    synthetic.write_model(files.model, files.scene)


@case("images.bin", "database/003.jpg")
def image_twice_in_the_model(files):
    files.scene.images["database/002.jpg"].name = "database/003.jpg"
    synthetic.write_model(files.model, files.scene)


# Queries and pairs


@case("list.txt")
def missing_query_list(files):
    return ["--query_list_path", files.folder / "list.txt"]


@case("pairs.txt")
def missing_pairs_file(files):
    return ["--pairs_path", files.folder / "pairs.txt"]


# Bad query lists: the text of the file, and what the message must name.
QUERY_LISTS = {
    "query_not_in_the_database": ("query/001.jpg\nnowhere.jpg\n", "nowhere.jpg", "database.db"),
    "duplicate_query": ("query/001.jpg\nquery/000.jpg\nquery/001.jpg\n", "list.txt", "query/001.jpg"),
    "empty_query_list": ("# nothing here\n\n", "list.txt"),
    "unknown_camera_model_in_the_query_list": ("query/001.jpg NO_SUCH_MODEL 600 500 480 3 2\n", "NO_SUCH_MODEL"),
    "too_few_parameters_in_the_query_list": ("query/001.jpg PINHOLE 600 500 480 490 300\n", "list.txt", "PINHOLE"),
    "width_is_no_number_in_the_query_list": ("query/001.jpg PINHOLE wide 500 480 490 3 2\n", "list.txt", "wide"),
    "nan_in_the_query_list": ("query/001.jpg PINHOLE 600 500 nan 490 300 250\n", "list.txt"),
}
PAIRS = {
    "pairs_file_without_pairs": ("\n", "pairs.txt"),
    "pairs_file_of_another_database": ("query/1.jpg a.jpg\nb.jpg c.jpg 0.5\n", "pairs.txt", "a.jpg"),
    "line_with_one_name_in_the_pairs_file": ("query/001.jpg\n", "pairs.txt", "query/001.jpg"),
}
for name, (text, *named) in QUERY_LISTS.items():
    CASES[name] = (lambda files, text=text: files.query_list(text)), named
for name, (text, *named) in PAIRS.items():
    CASES[name] = (lambda files, text=text: ["--pairs_path", files.write("pairs.txt", text)]), named


@case("query/001.jpg", "leave_one_out")
def leave_one_out_of_a_query_without_pose(files):
    return [*files.query_list("query/001.jpg\n"), "--LazyLocalizer.leave_one_out", 1]


@case("database.db", "query_list_path")
def every_image_has_a_pose(files):
    synthetic.write_model(files.model, files.scene, names=list(files.scene.images))


# Options


@case("--LazyLocalizer.num_retreived")
def unknown_option(files):
    return ["--LazyLocalizer.num_retreived", 5]


@case("stray")
def word_without_an_option(files):
    return ["stray"]


for name in ("database_path", "input_path", "output_path"):
    CASES[f"missing_option_{name}"] = (lambda files, name=name: {"--" + name: None}), (name,)


@case("LazyLocalizer.seed")
def option_without_a_value(files):
    return ["--LazyLocalizer.seed"]


BAD_VALUES = """
    strict=perhaps LazyLocalizer.leave_one_out=7 LazyLocalizer.num_retrieved=many LazyLocalizer.num_retrieved=0
    LazyLocalizer.num_retrieved=99999999999 LazyLocalizer.num_retrieved=1.5 LazyLocalizer.num_threads=0
    LazyLocalizer.num_threads=-2 LazyLocalizer.seed=x1 LazyLocalizer.group_size=0
    LazyLocalizer.Advanced.rig_noise_px=-1 LazyLocalizer.Advanced.database_pose_stddev_deg=-2
    LazyLocalizer.Advanced.database_pose_stddev_length=nan LazyLocalizer.Advanced.focal_length_stddev_ratio=4px
    LazyLocalizer.method=lazy
"""
for name, value in (word.split("=") for word in BAD_VALUES.split()):
    CASES[f"{name.split('.')[-1]}_of_{value}"] = (lambda files, words=("--" + name, value): words), (name,)


@case("database.db", "nowhere\\x0d\\x1b[31m.jpg")
def control_characters_in_a_name(files):
    return files.query_list("query/001.jpg\nnowhere\r\x1b[31m.jpg\n")


@case("some.ini")
def missing_options_file(files):
    return ["--project_path", files.folder / "some.ini"]


@case("no_such_option")
def unknown_option_in_the_options_file(files):
    return ["--project_path", files.write("some.ini", "[LazyLocalizer.Advanced]\nno_such_option=1\n")]


@case("--LazyLocalizer.intrinsics", "auto, given, refine", "'median'")
def unknown_value_of_an_enum(files):
    return ["--LazyLocalizer.intrinsics", "median"]


@case("LazyLocalizer.method", "extended, paper", "'PAPER'")
def unknown_value_of_an_enum_in_the_options_file(files):
    return ["--project_path", files.write("some.ini", "[LazyLocalizer]\nmethod=PAPER\n")]


# Outputs


@case("file.txt")
def output_path_below_a_regular_file(files):
    return {"--output_path": files.write("file.txt", "mine") / "out"}


@case("file.txt")
def output_path_is_a_regular_file(files):
    return {"--output_path": files.write("file.txt", "mine")}


@case("/proc")
def output_path_not_writable(files):
    return {"--output_path": "/proc/lazy_localizer"}


@case("model")
def output_path_is_the_folder_of_the_input_model(files):
    return {"--output_path": files.folder}


WITHOUT_OUTPUT_FOLDER = [name for name in CASES if "output_path" in name]


def run_case(colmap, files, name):
    spoil, named = CASES[name]
    arguments = files.arguments(spoil(files))
    done = subprocess.run(
        [colmap, "lazy_localizer", *arguments], capture_output=True, text=True, timeout=300, cwd=files.folder
    )
    return done, named


def assert_is_one_clear_error(done, named):
    assert done.returncode == 1, done.stderr or done.stdout
    lines = done.stderr.splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("ERROR"), lines[0]
    assert "bug" not in lines[0], lines[0]
    for words in named:
        assert words in lines[0]


@pytest.fixture
def files(tmp_path, exact):
    folder = tmp_path / "input"
    folder.mkdir()
    return Files(folder, exact)


@pytest.mark.parametrize("name", CASES)
def test_bad_input_leaves_nothing(colmap, files, name):
    done, named = run_case(colmap, files, name)
    assert_is_one_clear_error(done, named)
    assert not (files.folder / "out").exists()
    names = {path.name for path in files.folder.iterdir()}
    assert names <= {"database.db", "model", "list.txt", "pairs.txt", "some.ini", "file.txt"}
    text = files.folder / "file.txt"
    assert not text.exists() or text.read_text() == "mine"


@pytest.mark.parametrize("name", [name for name in CASES if name not in WITHOUT_OUTPUT_FOLDER])
def test_bad_input_leaves_an_earlier_run_as_it_was(colmap, localize, files, exact, fingerprint, name):
    earlier = localize(*exact.arguments, output_path=files.folder / "out")
    assert earlier.exit_code == 0
    before = fingerprint(files.folder / "out")[0]
    done, named = run_case(colmap, files, name)
    assert_is_one_clear_error(done, named)
    assert fingerprint(files.folder / "out")[0] == before


def test_failed_run_takes_away_the_parent_folders_that_it_made(colmap, files):
    CASES["database_without_keypoints"][0](files)
    arguments = files.arguments({"--output_path": files.folder / "a" / "b" / "c"})
    assert subprocess.run([colmap, "lazy_localizer", *arguments], capture_output=True).returncode == 1
    assert not (files.folder / "a").exists()


def test_good_files_are_good(colmap, files):
    """Localizes with the files as they are before a case spoils them."""
    done = subprocess.run([colmap, "lazy_localizer", *files.arguments(None)], capture_output=True, text=True)
    assert done.returncode == 0 and split_summary(done.stderr)[0] == ""
    assert pathlib.Path(files.folder / "out" / "poses.txt").exists()
