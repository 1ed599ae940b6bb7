"""Tests that the Python package answers bad input with one sentence, and never crashes."""

import os
import pathlib
import random

import numpy as np
import pytest

import colmap_lazyloc as ll
from colmap_lazyloc.model import read_model

CAMERA = "PINHOLE 640 480 500 500 320 240"
KEYPOINTS = np.random.default_rng(0).uniform(0, 480, (40, 2))
MATCHES = np.stack([np.arange(40), np.arange(40)], axis=1)
EYE = np.eye(3)


@pytest.fixture(scope="module")
def without_database(noisy):
    return ll.Localizer(None, noisy.model_path)


@pytest.fixture(scope="module")
def localizer(noisy):
    return ll.Localizer(noisy.database_path, noisy.model_path)


def assert_error(action, message):
    with pytest.raises(ll.InputError) as error:
        action()
    assert message in str(error.value) and "\n" not in str(error.value)
    assert isinstance(error.value, ValueError)


@pytest.mark.parametrize(
    ("keypoints", "message"),
    [
        (np.zeros((4, 3)), "keypoints: must have the shape n x 2, but has 4 x 3"),
        (np.zeros(8), "keypoints: must have the shape n x 2, but has 8"),
        (np.zeros((2, 2), complex), "keypoints: must hold real numbers, but has the type complex128"),
        (np.array([["a", "b"]]), "keypoints: must hold real numbers"),
        ([[1, 2], [3]], "keypoints: is not an array"),
        (None, "keypoints: is not an array of numbers"),
        (np.array([[1, 2], [np.nan, 3]]), "keypoints: row 1 is not finite"),
        (np.array([[np.inf, 2]]), "keypoints: row 0 is not finite"),
    ],
)
def test_bad_keypoints(without_database, keypoints, message):
    assert_error(lambda: without_database.localize_matches(CAMERA, keypoints, {}), message)


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        ({"nowhere.jpg": (KEYPOINTS, MATCHES)}, "pair with nowhere.jpg: the model has no posed image of this name"),
        ({"database/000.jpg": MATCHES}, "pair with database/000.jpg: without a database, its keypoints must be given"),
        ({"database/000.jpg": (KEYPOINTS, MATCHES + 1)}, "names a keypoint that its image does not have"),
        ({"database/000.jpg": (KEYPOINTS, MATCHES - 1)}, "names a keypoint that its image does not have"),
        ({"database/000.jpg": (KEYPOINTS, MATCHES.astype(float))}, "matches must be integers"),
        ({"database/000.jpg": (KEYPOINTS, MATCHES[:, :1])}, "matches must have the shape n x 2, but have 40 x 1"),
        ({"database/000.jpg": (KEYPOINTS * np.nan, MATCHES)}, "pair with database/000.jpg: keypoints: row 0"),
        ({3: (KEYPOINTS, MATCHES)}, "name must be a string"),
        ([("database/000.jpg", MATCHES)], "pairs: must be a dict"),
    ],
)
def test_bad_pairs(without_database, pairs, message):
    assert_error(lambda: without_database.localize_matches(CAMERA, KEYPOINTS, pairs), message)


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ("PINHOLE 640 480 500", "camera: "),
        ("PINHOLD 640 480 500 500 320 240", "unknown camera model 'PINHOLD'"),
        ("PINHOLE 640 480 nan 500 320 240", "camera: "),
        ("PINHOLE 640 480 -5 500 320 240", "camera: "),
        ("PINHOLE 0 480 500 500 320 240", "camera: cannot have 0 x 480 pixels"),
        ("PINHOLE", "camera: must have model, width, height and params"),
        ({"model": "PINHOLE", "width": 640}, "camera: must have model, width, height and params"),
        (None, "camera: must have model, width, height and params"),
        (object(), "camera: must have model, width, height and params"),
    ],
)
def test_bad_camera(without_database, camera, message):
    assert_error(lambda: without_database.localize_matches(camera, KEYPOINTS, {}), message)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        ({}, "model: contains no posed image"),
        ({"a.jpg": (EYE,)}, "model: image 'a.jpg' must be a name with (R, t, camera) or (pose, camera)"),
        ({"a.jpg": (EYE, CAMERA)}, "model: image a.jpg: a pose must be a 3x4 or 4x4 matrix or (R, t), but has 3 x 3"),
        ({"a.jpg": (EYE, np.zeros(3), None)}, "model: image a.jpg has no camera"),
        ({"a.jpg": (2 * EYE, np.zeros(3), CAMERA)}, "model: image a.jpg: the matrix is not a rotation"),
        ({"a.jpg": (-EYE, np.zeros(3), CAMERA)}, "model: image a.jpg: the matrix is not a rotation"),
        ({"a.jpg": (np.zeros(4), np.zeros(3), CAMERA)}, "the quaternion's norm is 0, not 1"),
        ({"a.jpg": (EYE, np.zeros(2), CAMERA)}, "a translation must have 3 numbers, but has 2"),
        ({"a.jpg": (EYE, np.full(3, np.nan), CAMERA)}, "model: image a.jpg: row 0 is not finite"),
        ({"": (EYE, np.zeros(3), CAMERA)}, "has no name"),
        (5, "model: must be a folder, a Reconstruction or a dict of images"),
    ],
)
def test_bad_model(model, message):
    assert_error(lambda: ll.Localizer(None, model), message)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"num_retreived": 3}, "unknown option num_retreived; the nearest is LazyLocalizer.num_retrieved"),
        ({"LazyLocalizer": {"sed": 3}}, "unknown option LazyLocalizer.sed; the nearest is LazyLocalizer.seed"),
        ({"output_path": "here"}, "unknown option output_path"),
        ({"num_retrieved": 0}, "option --LazyLocalizer.num_retrieved must be >= 1, but is 0"),
        ({"num_retrieved": "many"}, "the argument ('many') for option '--LazyLocalizer.num_retrieved' is invalid"),
        ({"intrinsics": "guess"}, "must be one of auto, given, refine"),
        ({"seed": 1, "LazyLocalizer.seed": 2}, "option LazyLocalizer.seed is given twice"),
        ({"input_path": "model"}, "option input_path is given twice"),
        ({"seed": object()}, "option LazyLocalizer.seed: a value of type object cannot be used"),
        ({"query_list_path": "a\0b"}, "the value contains a null character"),
        ({3: 4}, "a name must be a string"),
        ([("seed", 1)], "options must be a dict"),
        ({"query_list_path": "/nowhere"}, "/nowhere"),
    ],
)
def test_bad_options(noisy, options, message):
    assert_error(lambda: ll.Localizer(noisy.database_path, noisy.model_path, options=options), message)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((4, 4)), "photo: an array must have the type uint8, but has float64"),
        (np.zeros((4, 4, 4), np.uint8), "must have the shape height x width (x 3), but has 4 x 4 x 4"),
        (np.zeros(4, np.uint8), "must have the shape height x width (x 3), but has 4"),
        (np.zeros((0, 4), np.uint8), "must have 1 to 32768 rows and columns, but has 0 x 4 x 1"),
        (b"photo.jpg", "photo: "),
        (None, "photo: is not an array of numbers"),
    ],
)
def test_bad_photos(localizer, image, message):
    assert_error(lambda: localizer.localize_photo(image), message)


def test_bad_files(noisy, tmp_path):
    assert_error(lambda: ll.Localizer(tmp_path / "no.db", noisy.model_path), "no.db")
    assert_error(lambda: ll.Localizer(noisy.database_path, tmp_path), "holds no COLMAP model")
    (tmp_path / "text.db").write_text("text")
    assert_error(lambda: ll.Localizer(tmp_path / "text.db", noisy.model_path), "text.db")


def test_bad_queries(localizer, without_database, noisy):
    assert_error(lambda: localizer.localize("nowhere.jpg"), "query nowhere.jpg is not in the database")
    assert_error(lambda: localizer.localize("database/000.jpg"), "has a pose in the model")
    assert_error(
        lambda: localizer.localize(3), "a query's name must be a string of at least one character, but is of type int"
    )
    assert_error(lambda: localizer.localize_photo(np.zeros((9, 9), np.uint8)), "no posed image has descriptors")
    assert_error(lambda: without_database.localize("query/000.jpg"), "needs a database")
    assert_error(lambda: without_database.localize_photo("a.jpg"), "can do without a database")
    assert_error(lambda: localizer.localize_all("query/000.jpg"), "must be a list of queries")
    assert_error(lambda: localizer.localize_all([3]), "a query must be a name, a Photo or a Matches")
    assert_error(lambda: localizer.localize_all(num_threads=0), "num_threads must be >= 1, or -1")
    assert_error(lambda: localizer.localize_rig({}), "images: must be a dict of at least one query")
    assert_error(lambda: localizer.localize_rig({"query/000.jpg": EYE}), "a pose must be a 3x4 or 4x4 matrix or (R, t)")
    name = noisy.scene.query_names[0]
    twice = {name: np.eye(4), ll.Matches(CAMERA, KEYPOINTS, {}, name): np.eye(4)}
    assert_error(lambda: localizer.localize_rig(twice), f"query {name} is given twice")


def test_error_in_a_thread_is_raised_to_the_caller(localizer):
    photo = ll.Photo(np.zeros((9, 9), np.uint8))
    assert_error(lambda: list(localizer.localize_all([photo] * 5, num_threads=3)), "no posed image has descriptors")


def test_closed_localizer(noisy):
    with ll.Localizer(noisy.database_path, noisy.model_path) as localizer:
        localizer.localize(localizer.queries[0])
    assert_error(lambda: localizer.localize("query/000.jpg"), "the Localizer is closed")
    assert_error(lambda: localizer.queries, "the Localizer is closed")
    localizer.close()


def test_database_that_vanishes_or_is_damaged_while_it_is_open(noisy, tmp_path):
    database = tmp_path / "database.db"
    database.write_bytes(noisy.database_path.read_bytes())
    localizer = ll.Localizer(database, noisy.model_path)
    database.write_bytes(bytes(1000))
    with pytest.raises(ll.InputError, match=r"database\.db"):
        localizer.localize(localizer.queries[0])
    database.unlink()
    with pytest.raises(ll.InputError, match=r"database\.db"):
        list(localizer.localize_all())


def test_layout_and_type_of_arrays_do_not_matter(without_database):
    expected = localize_fixed(without_database, KEYPOINTS, MATCHES).line
    fortran, strided = np.asfortranarray(KEYPOINTS), np.repeat(KEYPOINTS, 2, axis=0)[::2]
    read_only = KEYPOINTS.copy()
    read_only.flags.writeable = False
    big_endian = KEYPOINTS.astype(">f8")
    for keypoints in (fortran, strided, read_only, big_endian, KEYPOINTS.tolist(), KEYPOINTS[::-1][::-1]):
        assert without_seconds(localize_fixed(without_database, keypoints, MATCHES).line) == without_seconds(expected)
    for matches in (MATCHES.astype(np.uint8), MATCHES.astype(">i4"), np.asfortranarray(MATCHES), MATCHES.tolist()):
        assert without_seconds(localize_fixed(without_database, KEYPOINTS, matches).line) == without_seconds(expected)


def localize_fixed(localizer, keypoints, matches):
    return localizer.localize_matches(CAMERA, keypoints, {"database/000.jpg": (keypoints, matches)})


def without_seconds(line):
    return line.partition('"seconds"')[0]


# A fuzzer: random values, most of them wrong, for every argument.


def random_value(rng, depth=0):
    numbers = np.random.default_rng(rng.randrange(1 << 30))
    shape = rng.choice(
        [(0, 2), (1, 2), (30, 2), (30, 3), (4,), (3, 4), (3, 3), (4, 4), (20, 30), (20, 30, 3), (), (2, 2, 2)]
    )
    array = numbers.uniform(-10, 600, shape)
    simple = [
        None, True, 0, -1, 1 << 70, 0.5, float("nan"), "", "a", "\0", "\udc80", b"x", object(), {}, [], (),
        "query/000.jpg", "database/000.jpg", CAMERA, CAMERA.replace("500", "1e308"), pathlib.Path("a"),
        EYE, np.eye(4), KEYPOINTS, MATCHES, array, array.T, array.astype(np.float32), array.astype(np.uint8),
        array.astype(int), array.astype(str), array.astype(object), array.astype(int).astype("datetime64[s]"),
        np.full(shape, np.nan), np.broadcast_to(np.float64(3), shape),
    ]  # fmt: skip
    if depth < 2 and rng.random() < 0.5:
        value, other = random_value(rng, depth + 1), random_value(rng, depth + 1)
        key = rng.choice(["database/000.jpg", "database/001.jpg", "query/000.jpg", "LazyLocalizer", "seed", 3, None])
        return rng.choice([{key: value}, (value, other), [value], {key: (value, other)}, (KEYPOINTS, value)])
    return rng.choice(simple)


def random_call(rng, localizers, model):
    localizer = rng.choice(localizers)
    value = [random_value(rng) for _ in range(3)]
    camera = rng.choice([CAMERA, value[2]])
    calls = [
        lambda: localizer.localize(value[0]),
        lambda: localizer.localize_matches(camera, value[0], value[1]),
        lambda: localizer.localize_matches(camera, KEYPOINTS, {"database/000.jpg": value[0]}),
        lambda: localizer.localize_matches(camera, value[0], {"database/000.jpg": (value[0], value[1])}),
        lambda: localizer.localize_photo(value[0], value[1], name=value[2]),
        lambda: localizer.localize_rig({"query/000.jpg": value[0], "query/001.jpg": value[1]}),
        lambda: localizer.localize_rig(value[0]),
        lambda: localizer.localize_trajectory({"query/000.jpg": value[0]}, has_scale=False),
        lambda: list(localizer.localize_all(value[0], num_threads=rng.choice([1, 2, value[1]]))),
        lambda: ll.Localizer(None, {"a": (value[0], value[1], camera)}),
        lambda: ll.Localizer(None, value[0]),
        lambda: ll.Localizer(None, model, options=value[0]),
        lambda: ll.Localizer(None, model, options={"seed": value[0], "LazyLocalizer": value[1]}),
    ]
    return rng.choice(calls)


def test_random_calls_raise_input_errors_or_give_results(localizer, without_database, noisy):
    """Raise NUM_RANDOM_CALLS in the environment for a longer run."""
    rng, errors = random.Random(0), 0
    model = read_model(noisy.model_path)
    num_calls = int(os.environ.get("NUM_RANDOM_CALLS", 1000))
    for _ in range(num_calls):
        try:
            random_call(rng, [localizer, without_database], model)()
        except ll.InputError as error:
            errors += 1
            assert str(error) and "\n" not in str(error)
    assert 0.3 * num_calls < errors < num_calls  # some calls are good, else the values are too wild
