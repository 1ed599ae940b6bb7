"""What holds for every format: known poses come back, its files are found, and damage is one line."""

import random
import re
import runpy
import warnings

import numpy as np
import pytest

import pose_files
import pose_writers
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import Camera
from colmap_lazyloc.pose_formats.posed_images import Photos, Source
from colmap_lazyloc.pose_formats.registry import FORMATS, find_format, read_posed_images
from conftest import PROJECT_PATH
from pose_writers import WRITERS

NUM_MUTATIONS = 40
NAMED = [f"set/IMG {index:04}.jpg" for index in range(5)]
NUMBERED = [f"set/{index:06}.jpg" for index in range(5)]
FOLDERS = (  # with a file for each pose, or a split that is a file of its own
    *("7_scenes", "7_scenes_folder", "12_scenes", "arkit_scenes", "cambridge_folder", "polycam_keyframes"),
    *("scannet", "xmp"),
)
KINDS = pytest.mark.parametrize("kind", WRITERS)


@pytest.fixture(scope="session")
def folders(tmp_path_factory):
    """Folders of photos by their names."""
    every = {tuple(names_of(kind)) for kind in WRITERS}
    return {names: pose_files.write_named(tmp_path_factory.mktemp("photos"), names) for names in sorted(every)}


def names_of(kind):
    if WRITERS[kind].photos is not None:
        return list(WRITERS[kind].photos)
    # A tab stands for blanks in lists whose columns are separated by blanks.
    return NAMED if WRITERS[kind].names and kind not in ("pix4d", "bundler") else NUMBERED


def read(kind, path, folders, form=None):
    writer = WRITERS[kind]
    camera = Camera.parse("", pose_writers.CAMERA) if writer.camera is None else None
    folder = folders[tuple(names_of(kind))]
    return read_posed_images(Source(path, Photos(folder), camera, **writer.options), form)


def test_every_format_is_tested():
    on_earth = {"geopose", "geoposeypr", "odmgeo"}  # test_export.py writes them
    assert {writer.form for writer in WRITERS.values()} | on_earth == set(FORMATS)


def test_table_in_the_documentation_is_that_of_the_registry():
    script = runpy.run_path(str(PROJECT_PATH / "scripts" / "make_format_table.py"))
    assert script["make_page"]() == script["PAGE_PATH"].read_text(encoding="utf-8"), "run make_format_table.py"


@KINDS
@pytest.mark.parametrize("shift", [(0, 0, 0), (500000, 5200000, 400)])
def test_known_poses_come_back(kind, shift, folders, tmp_path, caplog):
    truth = pose_writers.make_poses(names_of(kind), shift=shift)
    path = WRITERS[kind].write(tmp_path, truth)
    assert find_format(path) == WRITERS[kind].form
    posed = read(kind, path, folders)
    assert posed.origin is None and "not used" not in caplog.text
    assert {image.name for image in posed.images} == set(truth)
    camera = WRITERS[kind].camera or pose_writers.CAMERA
    tolerance = 1e-9 if not any(shift) else 1e-8
    for image in posed.images:
        rotation, centre = truth[image.name]
        assert np.abs(image.cam_from_world.rotation.T - rotation).max() < 1e-9
        assert np.linalg.norm(image.cam_from_world.cam_in_world - centre) < tolerance
        expected = Camera.parse("", camera)
        assert (image.camera.model, *image.camera.params) == (expected.model, *map(pytest.approx, expected.params))


@KINDS
def test_options_replace_the_convention(kind, folders, tmp_path):
    """The rotation of the file, read otherwise, is the same as that of a file that is written otherwise."""
    truth = pose_writers.make_poses(names_of(kind))
    path = WRITERS[kind].write(tmp_path, truth)
    camera = Camera.parse("", pose_writers.CAMERA)
    folder = folders[tuple(names_of(kind))]
    options = {**WRITERS[kind].options, "camera_axes": "frd"}
    posed = read_posed_images(Source(path, Photos(folder), camera, **options))
    assert posed.convention.camera_axes == "frd"
    before = read(kind, path, folders).images
    turn = before[0].cam_from_world.rotation @ posed.images[0].cam_from_world.rotation.T
    assert np.abs(turn - np.eye(3)).max() > 0.5
    for first, second in zip(before, posed.images, strict=True):
        assert np.allclose(first.cam_from_world.rotation, turn @ second.cam_from_world.rotation)
        assert np.allclose(first.cam_from_world.cam_in_world, second.cam_from_world.cam_in_world)


def files_of(folder):
    return sorted(path for path in folder.rglob("*") if path.is_file())


def damaged(kind, folders, tmp_path, change):
    """Returns how many images are read from a damaged file, or None and its one line."""
    path = WRITERS[kind].write(tmp_path, pose_writers.make_poses(names_of(kind)))
    file = files_of(path)[kind == "colmap"] if path.is_dir() else path  # a model's second file is images.txt
    file.write_bytes(change(file.read_text()).encode("utf-8", "replace"))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return len(read(kind, path, folders).images), ""
    except InputError as error:
        assert path.name in str(error) or str(error).startswith("--"), error
        return None, str(error)


@KINDS
def test_pose_that_is_not_finite_is_left_out(kind, folders, tmp_path, caplog):
    truth = pose_writers.make_poses(names_of(kind))
    truth[names_of(kind)[1]] = (truth[names_of(kind)[1]][0], np.array([np.nan, np.nan, np.nan]))
    path = WRITERS[kind].write(tmp_path, truth)
    if kind == "colmap":  # a model is refused as a whole, as by the program
        with pytest.raises(InputError, match=f"{names_of(kind)[1]}.*: the pose is not finite"):
            read(kind, path, folders)
        return
    posed = read(kind, path, folders)
    assert {image.name for image in posed.images} == set(truth) - {names_of(kind)[1]}
    assert len([line for line in caplog.messages if "1 of 5 poses is left out" in line]) == 1


@KINDS
@pytest.mark.parametrize("part", [0, 0.02, 0.6])
def test_cut_off_file_is_read_or_one_line(kind, part, folders, tmp_path):
    count, line = damaged(kind, folders, tmp_path, lambda text: text[: int(part * len(text))])
    assert (count is None and "\n" not in line) or (part == 0.6 and count < 5) or kind in FOLDERS


@pytest.mark.parametrize("kind", [kind for kind, writer in WRITERS.items() if writer.names and kind not in FOLDERS])
def test_two_poses_of_a_name_are_left_out(kind, folders, tmp_path):
    """The reader of a format cannot know which one is right."""
    first, second = (name.rpartition("/")[2].removesuffix(".jpg") for name in names_of(kind)[:2])
    count, line = damaged(kind, folders, tmp_path, lambda text: text.replace(second, first))
    # JSON keeps the last of two equal keys.
    assert count == (4 if kind == "opensfm" else 3) or "appears twice" in line or (kind == "bundler" and count == 5)


def mutate(text, rng):
    """Damages a file: a token replaced by another value, a part removed, doubled or exchanged, or bytes changed."""
    values = [
        "nan",
        "1e999",
        "-1",
        "0",
        '""',
        "null",
        "[]",
        "{}",
        "[1]",
        "x",
        "",
        "é\0",
        "9" * 400,
        "true",
        "<a>",
        "1,2",
    ]
    kind = rng.randrange(6)
    tokens = list(re.finditer(r'"[^"]*"|[-+.\w]+|<[^>]*>', text))
    if kind <= 2 and tokens:
        for match in sorted(rng.sample(tokens, min(len(tokens), rng.choice((1, 1, 3)))), key=lambda m: -m.start()):
            text = text[: match.start()] + rng.choice(values) + text[match.end() :]
        return text
    begin, end = sorted(rng.randrange(len(text) + 1) for _ in range(2))
    if kind == 3:
        return text[:begin] + text[end:]
    if kind == 4:
        return text[:end] + text[begin:]
    characters = list(text)
    for _ in range(rng.choice((1, 5, 50))):
        characters[rng.randrange(len(characters))] = chr(rng.randrange(256))
    return "".join(characters)


@KINDS
def test_mutated_files_are_read_or_refused_in_one_line(kind, folders, tmp_path):
    path = WRITERS[kind].write(tmp_path, pose_writers.make_poses(names_of(kind)))
    files = files_of(path) if path.is_dir() else [path, *tmp_path.glob("list.txt")]
    texts, rng = {file: file.read_text() for file in files}, random.Random(kind)
    for index in range(NUM_MUTATIONS):
        file = rng.choice(files)
        file.write_bytes(mutate(texts[file] or " ", rng).encode("utf-8" if index % 2 else "latin-1", "replace"))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                read(kind, path, folders, WRITERS[kind].form if index % 3 else None)
        except InputError as error:
            assert any(name in str(error) for name in (path.name, file.name)) or str(error).startswith("--"), error
            assert len(str(error)) < 1000
        file.write_text(texts[file])
