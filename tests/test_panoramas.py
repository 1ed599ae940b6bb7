"""Tests of equirectangular panoramas: faces that are where the rig says, and panoramas that are localized by them."""

import json

import cv2
import numpy as np
import pycolmap
import pytest

import photo_scene
from colmap_lazyloc import panoramas
from colmap_lazyloc.__main__ import main
from colmap_lazyloc.demo.panoramas import render_panorama
from colmap_lazyloc.model import Camera, Image, read_model, write_model
from colmap_lazyloc.poses import Pose, read_poses
from colmap_lazyloc.pycolmap_types import image_from_cam, to_pycolmap_camera

WIDTH = 800
RENDERED = Camera("PINHOLE", 300, 300, (145.0, 145.0, 150.0, 150.0))
DATABASE_PLACES = [(-3.5, -3.0, 1.6), (-1.8, -3.4, 1.4), (0.2, -3.0, 1.8), (2.2, -3.4, 1.5), (3.6, -2.2, 1.7)]
QUERY_PLACES = [(-0.8, -2.8, 1.6), (2.8, -2.9, 1.7)]
MAX_POSITION_ERROR = 0.05  # in a courtyard of 20 m


def directions_of(width):
    """Returns the ray of each pixel of a panorama by COLMAP's own model."""
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(width // 2) + 0.5)
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    camera = to_pycolmap_camera(Camera("EQUIRECTANGULAR", width, width // 2, (width, width / 2)))
    return np.asarray(camera.cam_ray_from_img(pixels)).reshape(width // 2, width, 3)


def test_faces_show_what_the_rig_says(tmp_path):
    """The colours of the panorama are its rays; those of a face must be the rays of its pixels, turned into the rig."""
    panorama = (directions_of(600) * 100 + 128).astype(np.float32)
    panoramas.write_rig(tmp_path / "rig.json")
    ((rig,),) = [part.values() for part in json.loads((tmp_path / "rig.json").read_text())]
    rotations = {
        camera["image_prefix"]: Pose(np.array(camera.get("cam_from_rig_rotation", [1, 0, 0, 0])), np.zeros(3)).rotation
        for camera in rig
    }
    camera = panoramas.face_camera(600)
    faces = dict(panoramas.cut(panorama))
    assert sorted(rotations) == sorted(f"{face}/" for face in faces)
    for face, pixels in faces.items():
        assert pixels.shape == (camera.height, camera.width, 3)
        rays = (pixels - 128) / 100
        projected = image_from_cam(camera, (rays @ rotations[f"{face}/"].T).reshape(-1, 3)).reshape(
            *pixels.shape[:2], 2
        )
        columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
        errors_px = np.abs(projected - np.stack([columns, rows], axis=-1))
        assert np.median(errors_px) < 0.02 and errors_px.max() < 0.5, face


def test_faces_cover_the_whole_horizon():
    covered = np.zeros(3600, bool)
    camera = panoramas.face_camera(WIDTH)
    angles = np.radians(np.arange(3600) / 10)
    rays = np.stack([np.sin(angles), np.zeros(3600), np.cos(angles)], axis=1)
    for yaw, pitch in panoramas.FACES.values():
        turned = rays @ panoramas.rotation_of_angles(yaw, pitch).T
        pixels = image_from_cam(camera, turned)
        with np.errstate(invalid="ignore"):
            covered |= (turned[:, 2] > 0) & np.all((pixels >= 0) & (pixels <= camera.width), axis=1)
    assert covered.all()


@pytest.fixture(scope="session")
def tour(tmp_path_factory):
    """Renders panoramas with poses in a table, and panoramas to localize; returns the folder and all poses."""
    folder = tmp_path_factory.mktemp("tour")
    rectangles, rng = photo_scene.build_courtyard(), np.random.default_rng(5)
    poses = {}
    for role, places in (("database", DATABASE_PLACES), ("query", QUERY_PLACES)):
        (folder / role).mkdir()
        for index, place in enumerate(places):
            level = photo_scene.look_at_target(place, roll_deg=3.0)
            pose = Pose.from_centre(panoramas.rotation_of_angles(rng.uniform(0, 360), 2.0) @ level.rotation, place)
            poses[f"{role}/{role[0]}{index}.png"] = pose
            picture = render_panorama(rectangles, RENDERED, pose, WIDTH)
            photo = photo_scene.demo.photograph(picture, np.random.default_rng(index))
            assert cv2.imwrite(str(folder / role / f"{role[0]}{index}.png"), photo)
    rows = ["name,x,y,z,qw,qx,qy,qz"]
    for name, pose in poses.items():
        w, x, y, z = pose.qvec.tolist()
        rows.append(",".join([name.rpartition("/")[2], *map(repr, [*pose.cam_in_world.tolist(), w, -x, -y, -z])]))
    (folder / "poses.csv").write_text("\n".join(rows) + "\n")
    return folder, poses


def run_lazyloc(colmap, monkeypatch, *words):
    monkeypatch.setenv("COLMAP", str(colmap))
    return main([str(word) for word in ["run", *words, *photo_scene.SIFT]])


def assert_near(poses, truth, max_position_error=MAX_POSITION_ERROR, max_rotation_error_deg=0.3):
    assert sorted(poses) == sorted(truth)
    for name, pose in poses.items():
        position_error, rotation_error_deg = pose.errors(truth[name])
        assert position_error < max_position_error and rotation_error_deg < max_rotation_error_deg, name


def test_panoramas_in_panoramas(colmap, tour, monkeypatch, tmp_path, capsys):
    folder, poses = tour
    words = ["--database_images", folder / "database", "--poses", folder / "poses.csv", "--panoramas", "all"]
    words += ["--output", tmp_path / "out"]
    assert run_lazyloc(colmap, monkeypatch, *words, "--queries", folder / "query") == 0
    printed = capsys.readouterr()
    assert "2 of 2 queries localized" in printed.out and "query/q0.png  " in printed.out
    truth = {name: pose for name, pose in poses.items() if name.startswith("query/")}
    found = read_poses(tmp_path / "out" / "localized" / "rig_poses.txt")
    assert_near(found, truth)
    faces = read_poses(tmp_path / "out" / "localized" / "poses.txt")
    for name, pose in found.items():
        front = faces[name.replace("query/", f"query/{panoramas.REFERENCE}/")]
        assert front.errors(pose) < (1e-9, 1e-7)
    for image in read_model(tmp_path / "out" / "model").images.values():
        panorama = image.name.split("/")[0] + "/" + image.name.rpartition("/")[2]
        assert image.pose.errors(poses[panorama])[0] < 1e-9
    # A single panorama needs no other faces of the database.
    assert run_lazyloc(colmap, monkeypatch, *words, "--queries", folder / "query" / "q1.png") == 0
    printed = capsys.readouterr()
    assert "features" not in printed.err and "1 of 1 queries localized" in printed.out


def test_panoramas_in_photos(colmap, tour, photos, monkeypatch, tmp_path):
    folder, poses = tour
    words = ["--database_images", photos.image_path / "database", "--poses", photos.model_path]
    words += ["--queries", folder / "query", "--panoramas", "queries", "--output", tmp_path / "out"]
    assert run_lazyloc(colmap, monkeypatch, *words) == 0
    truth = {name: pose for name, pose in poses.items() if name.startswith("query/")}
    assert_near(read_poses(tmp_path / "out" / "localized" / "rig_poses.txt"), truth)


def test_photos_in_panoramas(colmap, tour, photos, monkeypatch, tmp_path):
    folder, _ = tour
    words = ["--database_images", folder / "database", "--poses", folder / "poses.csv", "--panoramas", "database"]
    words += ["--queries", photos.image_path / "query", "--query_camera", photo_scene.CAMERA.text()]
    assert run_lazyloc(colmap, monkeypatch, *words, "--output", tmp_path / "out") == 0
    truth = {name: photos.poses[name] for name in photos.query_names}
    # The panoramas are three times as coarse as the photos, so that few features match: allow for two of their pixels.
    poses = read_poses(tmp_path / "out" / "localized" / "poses.txt")
    assert_near(poses, truth, max_position_error=0.15, max_rotation_error_deg=0.6)
    assert not (tmp_path / "out" / "localized" / "rig_poses.txt").exists()


def test_import_writes_what_lazy_localizer_needs(localize, photos, tour, tmp_path, capsys):
    folder, poses = tour
    words = ["import", "panoramas", folder / "query", "--output_path", tmp_path / "faces"]
    assert main(list(map(str, [*words, "--poses", folder / "poses.csv"]))) == 0
    assert f"2 panoramas, {2 * len(panoramas.FACES)} faces" in capsys.readouterr().out
    assert len(read_model(tmp_path / "faces" / "model").images) == 2 * len(panoramas.FACES)
    run = localize(
        "--database_path",
        photos.database_path,
        "--input_path",
        photos.model_path,
        "--image_path",
        tmp_path / "faces" / "images",
        "--query_list_path",
        tmp_path / "faces" / "queries.txt",
        "--rig_config_path",
        tmp_path / "faces" / "rig.json",
        *photo_scene.SIFT,
    )
    assert run.exit_code == 0, run.stderr
    truth = {name.removeprefix("query/"): pose for name, pose in poses.items() if name.startswith("query/")}
    assert_near(read_poses(run.output_path / "rig_poses.txt"), truth)


SPHERE = Camera("EQUIRECTANGULAR", WIDTH, WIDTH // 2, (WIDTH, WIDTH / 2))


@pytest.fixture(scope="session")
def spherical(tour, tmp_path_factory):
    """Returns the paths of a database and a model of COLMAP 4 with spherical cameras, by COLMAP 4's own functions."""
    folder, poses = tour
    path = tmp_path_factory.mktemp("spherical")
    extraction, matching = pycolmap.FeatureExtractionOptions(), pycolmap.FeatureMatchingOptions()
    extraction.use_gpu = matching.use_gpu = False
    extraction.sift.max_num_features = 3000
    pycolmap.extract_features(
        path / "database.db",
        folder,
        camera_mode=pycolmap.CameraMode.SINGLE,
        reader_options=pycolmap.ImageReaderOptions(camera_model=SPHERE.model),
        extraction_options=extraction,
    )
    pycolmap.match_exhaustive(path / "database.db", matching_options=matching)
    images = [
        Image(name, 1, pose, index)
        for index, (name, pose) in enumerate(poses.items(), 1)
        if name.startswith("database/")
    ]
    write_model(path / "model", {1: SPHERE}, images)
    return path / "database.db", path / "model"


def test_spherical_cameras_of_colmap_4(localize, spherical, tour):
    database_path, model_path = spherical
    run = localize("--database_path", database_path, "--input_path", model_path)
    assert run.exit_code == 0, run.stderr
    assert_near(run.poses, {name: pose for name, pose in tour[1].items() if name.startswith("query/")})
    for result in run.results.values():
        assert result["intrinsics"]["verdict"] == "not_tested" and "camera" not in result
        assert max(result["position_stddevs"]) < MAX_POSITION_ERROR
    written = pycolmap.Reconstruction(run.output_path / "model")
    assert {camera.model_name for camera in written.cameras.values()} == {SPHERE.model}


def test_photos_of_spherical_cameras(localize, spherical, tour, tmp_path):
    """The geometry of the pairs is estimated from rays."""
    database_path, model_path = spherical
    folder, poses = tour
    names = [name for name in poses if name.startswith("query/")]
    (tmp_path / "queries.txt").write_text("".join(f"new/{name} {SPHERE.text()}\n" for name in names))
    (tmp_path / "new").symlink_to(folder)
    words = ["--database_path", database_path, "--input_path", model_path, "--image_path", tmp_path]
    run = localize(*words, "--query_list_path", tmp_path / "queries.txt", *photo_scene.SIFT)
    assert run.exit_code == 0, run.stderr
    assert_near(run.poses, {f"new/{name}": poses[name] for name in names})


@pytest.mark.parametrize(
    ("size", "message"), [((200, 100), "is not a photo"), ((300, 100), "300 x 100 pixels; an equirectangular")]
)
def test_bad_panoramas_are_one_line(tmp_path, capsys, size, message):
    (tmp_path / "in").mkdir()
    path = tmp_path / "in" / "a.png"
    assert cv2.imwrite(str(path), np.zeros((size[1], size[0], 3), np.uint8))
    if size == (200, 100):
        path.write_bytes(path.read_bytes()[:20])
    assert main(["import", "panoramas", str(tmp_path / "in"), "--output_path", str(tmp_path / "out")]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and f"a.png: {message}" in error.replace("has ", "")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--panoramas", "all", "--sequence"], "--panoramas excludes"),
        (["--panoramas", "queries", "--query_camera", photo_scene.CAMERA.text()], "--query_camera"),
    ],
)
def test_options_that_exclude_each_other_are_one_line(colmap, tour, monkeypatch, tmp_path, capsys, words, message):
    folder, _ = tour
    paths = ["--database_images", folder / "database", "--queries", folder / "query", "--output", tmp_path / "out"]
    assert run_lazyloc(colmap, monkeypatch, *paths, *words) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and message in error
