"""Tests of photos whose intrinsics nobody states: from a camera of the database, EXIF or a guess."""

import pathlib
import shutil
import subprocess

import cv2
import numpy as np
import PIL.Image
import pytest
from PIL.TiffImagePlugin import IFDRational

import exif
import photo_scene
from colmap_lazyloc import program
from colmap_lazyloc.database import DatabaseReader
from colmap_lazyloc.demo.renderer import RayGrid
from colmap_lazyloc.model import Camera, Image, read_model, write_model
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.results import read_results
from conftest import DATA_PATH, SCRIPTS_PATH

FOCAL_LENGTH_PX = photo_scene.CAMERA.params[0]
CENTRE, ROLL_DEG = (-0.4, -3.0, 1.6), 4.0


@pytest.fixture(scope="module")
def courtyard():
    return photo_scene.build_courtyard()


@pytest.fixture(scope="module")
def take_photo(courtyard):
    """Returns a function that takes a photo from one place and returns its pixels."""

    def take(factor=1.0, size=(480, 360)):
        focal_length_px, cx, cy, k = photo_scene.CAMERA.params
        scale = size[0] / 480
        camera = Camera("SIMPLE_RADIAL", *size, (factor * scale * focal_length_px, cx * scale, cy * scale, k))
        return photo_scene.take_photo(courtyard, RayGrid(camera), photo_scene.look_at_target(CENTRE, ROLL_DEG), seed=7)

    return take


@pytest.fixture
def run_photos(photos, localize, tmp_path):
    """Returns a function that localizes the files of a folder, by default without any option for their cameras."""

    def run(*options, words="", database=photos.database_path):
        names = sorted(path.name for path in tmp_path.iterdir() if path.suffix in (".png", ".jpg"))
        queries = tmp_path / "queries.txt"
        queries.write_text("".join(f"{name}{words}\n" for name in names))
        done = localize(
            "--database_path",
            database,
            "--input_path",
            photos.model_path,
            "--image_path",
            tmp_path,
            "--query_list_path",
            queries,
            *photo_scene.SIFT,
            *options,
        )
        assert done.exit_code == 0, done.stderr
        return done

    return run


@pytest.fixture
def run_with_exif(photos, take_photo, run_photos, colmap, tmp_path):
    """Returns a function that localizes photos with the given fields in EXIF, and gives a database image other ones.
    `is_stored`: COLMAP's commands store the photos and their matches in the database before."""

    def run(of_database, of_queries, is_stored=False):
        name = photos.database_names[0]  # found below --image_path; its file has another format than its name says
        (tmp_path / name).parent.mkdir()
        for file, fields in {name: of_database, **of_queries}.items():
            exif.write_jpeg(tmp_path / file, take_photo(), **fields)
        if not is_stored:
            return run_photos().results
        database, listed = tmp_path / "stored.db", tmp_path / "stored.txt"
        shutil.copy(photos.database_path, database)
        listed.write_text("".join(f"{file}\n" for file in of_queries))
        extraction = ("--image_path", tmp_path, "--image_list_path", listed)
        for command, *words in (("feature_extractor", *extraction), ("exhaustive_matcher",)):
            words += ["--database_path", database, program.gpu_option(colmap, command), 0]
            program.run_colmap(colmap, command, *words)
        return run_photos(database=database).results

    return run


def assert_localized(run, name, source, focal_length_px, max_position_error=0.08, pose=None):
    """Checks pose, source and focal length, if it was estimated; the bounds suit a courtyard of 20 m."""
    result = run.results[name]
    assert result["status"] == "LOCALIZED", result["reason"]
    assert result["intrinsics_source"] == source
    pose = pose or photo_scene.look_at_target(CENTRE, ROLL_DEG)
    position_error, rotation_error_deg = run.poses[name].errors(pose)
    assert position_error < max_position_error and rotation_error_deg < 0.5, name
    if "camera" in result:
        assert result["camera"]["params"][0] == pytest.approx(focal_length_px, rel=0.02)


def test_camera_of_the_database_is_used_for_a_photo_of_its_size(take_photo, run_photos, tmp_path):
    cv2.imwrite(str(tmp_path / "photo.png"), take_photo())
    assert_localized(run_photos(), "photo.png", "database_camera", FOCAL_LENGTH_PX)


@pytest.mark.parametrize("factor", [0.7, 1.1, 1.5])
def test_zoomed_photo_of_the_same_size(take_photo, run_photos, tmp_path, factor):
    cv2.imwrite(str(tmp_path / "photo.png"), take_photo(factor))
    run = run_photos()
    assert_localized(run, "photo.png", "database_camera", factor * FOCAL_LENGTH_PX)
    assert "camera" in run.results["photo.png"], "the focal length was not estimated"


def test_photo_of_another_size_is_guessed(take_photo, run_photos, tmp_path):
    cv2.imwrite(str(tmp_path / "photo.png"), take_photo(size=(400, 300)))
    run = run_photos()
    assert_localized(run, "photo.png", "guess", FOCAL_LENGTH_PX * 400 / 480)
    assert "camera" in run.results["photo.png"], "the focal length was not estimated"


@pytest.mark.parametrize("turn", [cv2.ROTATE_90_CLOCKWISE, cv2.ROTATE_90_COUNTERCLOCKWISE])
def test_photo_that_was_turned(take_photo, run_photos, tmp_path, turn):
    cv2.imwrite(str(tmp_path / "photo.png"), cv2.rotate(take_photo(), turn))
    sign = 1 if turn == cv2.ROTATE_90_CLOCKWISE else -1
    turned_from_upright = np.array([[0, -sign, 0], [sign, 0, 0], [0, 0, 1]])
    upright = photo_scene.look_at_target(CENTRE, ROLL_DEG)
    pose = Pose.from_matrix(turned_from_upright @ upright.rotation, turned_from_upright @ upright.tvec)
    assert_localized(run_photos(), "photo.png", "database_camera", FOCAL_LENGTH_PX, pose=pose)


def test_exif_is_used_if_no_camera_has_the_size(take_photo, run_photos, tmp_path):
    # 30 mm of film are 400 x 30 / 35 = 342.9 px; right are 333.3.
    exif.write_jpeg(tmp_path / "photo.jpg", take_photo(size=(400, 300)), focal_length_35mm=30)
    run = run_photos()
    assert run.results["photo.jpg"]["intrinsics_source"] == "exif"


def test_another_focal_length_in_exif_excludes_the_camera_of_the_database(take_photo, run_photos, tmp_path):
    exif.write_jpeg(tmp_path / "near.jpg", take_photo(), focal_length_35mm=27)  # 370 px instead of 400
    exif.write_jpeg(tmp_path / "far.jpg", take_photo(1.5), focal_length_35mm=44)  # 603 px instead of 600
    run = run_photos()
    assert_localized(run, "near.jpg", "database_camera", FOCAL_LENGTH_PX)
    assert run.results["far.jpg"]["intrinsics_source"] == "exif"


def test_another_model_in_exif_excludes_the_camera_of_the_database(run_with_exif):
    results = run_with_exif(
        {"focal_length_35mm": 29, "model": "One"},
        {
            "one.jpg": {"focal_length_35mm": 29, "model": "One"},
            "two.jpg": {"focal_length_35mm": 29, "model": "Two"},
        },
    )
    assert results["one.jpg"]["intrinsics_source"] == "database_camera"
    assert results["two.jpg"]["intrinsics_source"] == "exif"


@pytest.mark.parametrize("is_stored", [False, True])
def test_a_focal_length_that_is_wrong_in_all_exif_does_not_exclude_the_camera_of_the_database(run_with_exif, is_stored):
    """EXIF of some drones is off by a third. Intrinsics that were given for the database images are not from EXIF."""
    results = run_with_exif(
        {"focal_length_35mm": 20, "model": "One"},
        {
            "same.jpg": {"focal_length_35mm": 20, "model": "One"},
            "other.jpg": {"focal_length_35mm": 21, "model": "One"},
        },
        is_stored,
    )
    assert results["same.jpg"]["intrinsics_source"] == "database_camera"
    assert results["same.jpg"]["intrinsics"]["origin"] == "model"
    assert results["other.jpg"]["intrinsics_source"] == ("database" if is_stored else "exif")


def test_photos_of_one_camera_share_its_estimate(photos, run_photos, tmp_path):
    """The photos are cut, so that no camera of the database has their size. Their matches are kept once."""
    for name in photos.query_names:
        photo = cv2.imread(str(photos.image_path / name))
        assert cv2.imwrite(str(tmp_path / pathlib.Path(name).name), photo[:-2, :-2])
    kept = tmp_path / "kept.db"
    run = run_photos("--ImageReader.single_camera", 1, "--LazyLocalizer.Advanced.matches_output_path", kept)
    for name in photos.query_names:
        assert_localized(run, pathlib.Path(name).name, "joint", FOCAL_LENGTH_PX, 0.05, photos.poses[name])
    cameras = [result["camera"] for result in run.results.values()]
    assert cameras[0] == cameras[1] and cameras[0]["model"] == "OPENCV"
    with DatabaseReader(kept) as database:
        assert len([name for name in database.image_ids if "/" not in name]) == len(photos.query_names)


def test_given_intrinsics_of_another_size_contradict_the_photo(take_photo, run_photos, tmp_path):
    cv2.imwrite(str(tmp_path / "photo.png"), take_photo(size=(400, 300)))
    result = run_photos(words=f" {photo_scene.CAMERA.text()}").results["photo.png"]
    assert result["status"] == "INCONSISTENT_INTRINSICS"
    assert "480 x 360" in result["reason"] and "400 x 300" in result["reason"]
    assert result["intrinsics_source"] == "query_list"


def test_source_of_given_intrinsics(photos, localize, tmp_path, take_photo, run_photos):
    cv2.imwrite(str(tmp_path / "photo.png"), take_photo())
    params = ",".join(map(repr, photo_scene.CAMERA.params))
    assert_localized(run_photos(words=f" {photo_scene.CAMERA.text()}"), "photo.png", "query_list", FOCAL_LENGTH_PX)
    run = run_photos("--ImageReader.camera_params", params)
    assert_localized(run, "photo.png", "camera_params", FOCAL_LENGTH_PX)
    assert "camera" not in run.results["photo.png"], "given intrinsics stay"


def run_script(database_path, model_path, folder, output_path, *options, scripts_path=SCRIPTS_PATH, colmap=None):
    environment = {"PATH": "/usr/bin:/bin", **({"COLMAP": str(colmap)} if colmap else {})}
    words = [database_path, model_path, folder, output_path, *options]
    return subprocess.run(
        [scripts_path / "localize_images.sh", *map(str, words)],
        capture_output=True,
        text=True,
        timeout=300,
        env=environment,
    )


def make_database(colmap, image_path, database_path, *options):
    """Makes a database of one camera by COLMAP's command, with a guess of its intrinsics. Photos need no matches."""
    program.run_colmap(
        colmap,
        "feature_extractor",
        "--database_path",
        database_path,
        "--image_path",
        image_path,
        "--ImageReader.single_camera",
        1,
        program.gpu_option(colmap, "feature_extractor"),
        0,
        *options,
    )


def test_script_localizes_ten_photos_and_finds_the_program(colmap, courtyard, photos, tmp_path):
    poses, folder = {}, tmp_path / "photos"
    folder.mkdir()
    rays = RayGrid(photo_scene.CAMERA)
    for index in range(10):
        centre = (-2.7 + 0.6 * index, -3.4 + 0.25 * (index % 4), 1.4 + 0.1 * (index % 3))
        poses[f"{index}.png"] = photo_scene.look_at_target(centre, roll_deg=3.0 * (index % 3) - 3)
        photo = photo_scene.take_photo(courtyard, rays, poses[f"{index}.png"], seed=100 + index)
        cv2.imwrite(str(folder / f"{index}.png"), photo)
    (tmp_path / "posed").mkdir()
    shutil.copytree(photos.image_path / "database", tmp_path / "posed" / "database")
    make_database(colmap, tmp_path / "posed", tmp_path / "database.db", *photo_scene.SIFT)
    checkout = tmp_path / "checkout"
    shutil.copytree(SCRIPTS_PATH, checkout / "scripts")
    (checkout / "build" / "bin").mkdir(parents=True)
    (checkout / "build" / "bin" / "colmap").symlink_to(colmap)
    done = run_script(
        tmp_path / "database.db",
        photos.model_path,
        folder,
        tmp_path / "out",
        *photo_scene.SIFT,
        scripts_path=checkout / "scripts",
    )
    assert done.returncode == 0, done.stderr
    results = read_results(tmp_path / "out" / "results.jsonl")
    estimated = read_model(tmp_path / "out" / "model").images
    for name, pose in poses.items():
        assert results[name]["status"] == "LOCALIZED", results[name]["reason"]
        assert results[name]["intrinsics_source"] == "database_camera"
        position_error, rotation_error_deg = estimated[name].cam_from_world.errors(pose)
        assert position_error < 0.08 and rotation_error_deg < 0.5, name


def test_script_localizes_photos_of_a_real_facade(colmap, tmp_path):
    scene = DATA_PATH / "herzjesu"
    if not (scene / "images").exists():
        pytest.skip(f"{scene} is missing; LAZYLOC_SHARED_DATA names the folder of the real scenes")
    truth = read_model(scene / "model")
    queries = [f"{index:04d}.jpg" for index in range(1, 25, 5)]
    for folder in ("posed", "photos"):
        (tmp_path / folder).mkdir()
    for name in truth.images:
        shutil.copy(scene / "images" / name, tmp_path / ("photos" if name in queries else "posed") / name)
    posed = [image for name, image in sorted(truth.images.items()) if name not in queries]
    images = [Image(image.name, 1, image.cam_from_world, image_id) for image_id, image in enumerate(posed, start=1)]
    write_model(tmp_path / "model", {1: next(iter(truth.cameras.values()))}, images)
    sift = ["--SiftExtraction.max_num_features", "2000", "--SiftExtraction.first_octave", "0"]
    make_database(colmap, tmp_path / "posed", tmp_path / "database.db", *sift)
    arguments = [tmp_path / "database.db", tmp_path / "model", tmp_path / "photos", tmp_path / "out", *sift]
    done = run_script(*arguments, colmap=colmap)
    assert done.returncode == 0, done.stderr
    results = read_results(tmp_path / "out" / "results.jsonl")
    estimated = read_model(tmp_path / "out" / "model").images
    assert {name: result["status"] for name, result in results.items()} == dict.fromkeys(queries, "LOCALIZED")
    errors = [estimated[name].cam_from_world.errors(truth.images[name].cam_from_world)[0] for name in queries]
    print("herzjesu: metres", np.round(errors, 4))
    assert np.median(errors) < 0.03 and max(errors) < 0.15


ZOOM, WIDTH, HEIGHT, FOCAL_LENGTH, FOCAL_LENGTH_35MM = 0xA404, 0xA002, 0xA003, 0x920A, 0xA405
RESOLUTION, RESOLUTION_UNIT, CENTIMETRES = 0xA20E, 0xA210, 3
# Of a sensor that is 6.4 mm wide, in pixels of 480 x 360 and of 4000 x 3000.
SENSOR = {FOCAL_LENGTH: 7.3, RESOLUTION: 750.0, RESOLUTION_UNIT: CENTIMETRES}
LARGE_SENSOR = {**SENSOR, RESOLUTION: 6250.0, WIDTH: 4000, HEIGHT: 3000}


@pytest.mark.parametrize(
    "values, is_consistent",
    [
        ({}, True),
        ({ZOOM: 0.0}, True),  # not used
        ({ZOOM: 1.0}, True),
        ({ZOOM: 2.0}, False),
        ({WIDTH: 4000, HEIGHT: 3000}, True),  # scaled down
        ({WIDTH: 3000, HEIGHT: 4000}, True),  # and turned
        ({WIDTH: 4000, HEIGHT: 2250}, False),  # a part
        (SENSOR, True),
        (LARGE_SENSOR, True),
        ({**LARGE_SENSOR, FOCAL_LENGTH: 2.2}, False),  # of another lens
    ],
)
def test_focal_length_that_exif_contradicts_is_not_used(take_photo, run_photos, tmp_path, values, is_consistent):
    """EXIF contradicts the camera of the database, which is taken only if EXIF tells nothing."""
    block = PIL.Image.Exif()
    entries = {tag: IFDRational(value) if isinstance(value, float) else value for tag, value in values.items()}
    block.get_ifd(0x8769).update({FOCAL_LENGTH_35MM: 40, **entries})
    PIL.Image.fromarray(take_photo()[:, :, ::-1]).save(tmp_path / "photo.jpg", quality=97, exif=block)
    (result,) = run_photos().results.values()
    assert result["intrinsics_source"] == ("exif" if is_consistent else "database_camera")
