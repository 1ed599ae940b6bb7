"""Tests of reading COLMAP models and lists of names as COLMAP and pycolmap write them."""

import re

import numpy as np
import pycolmap
import pytest

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.model import CAMERA_MODELS, Camera, Image, read_model, write_model
from colmap_lazyloc.pairs import read_pairs
from colmap_lazyloc.poses import Pose
from colmap_lazyloc.queries import read_queries, read_query_cameras

CAMERAS = {
    3: Camera("OPENCV", 640, 480, (500.5, 501, 320, 240, -0.1, 0.01, 1e-3, 1 / 3)),
    7: Camera("SIMPLE_PINHOLE", 10, 20, (8.0, 5.0, 10.0)),
}
IMAGES = [
    Image("with blank é.jpg", 3, Pose(np.array([0.6, 0, -0.8, 0]), np.array([1e6, 1 / 3, -2])), 5),
    Image("b.jpg", 7, Pose(np.array([1.0, 0, 0, 0]), np.array([1.0, 2, 3])), 9),
]


def test_camera_models_are_those_of_colmap():
    for model_id, (name, num_params) in enumerate(CAMERA_MODELS):
        camera = pycolmap.Camera.create_from_model_id(1, pycolmap.CameraModelId(model_id), 500, 640, 480)
        assert (camera.model.name, len(camera.params)) == (name, num_params)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("PINHOL 640 480 500 500 320 240", "unknown camera model 'PINHOL'; the nearest is PINHOLE"),
        ("opencv 640 480 500 500 320 240 0 0 0 0", "unknown camera model 'opencv'; the nearest is OPENCV"),
        ("XYZ 640 480 500", "unknown camera model 'XYZ'; expected one of SIMPLE_PINHOLE, PINHOLE"),
        ("PINHOLE 640 480 500 320 240", "camera model PINHOLE takes 4 parameters, not 3"),
        ("PINHOLE 640 0 500 500 320 240", "expected an image size in pixels, found 640 x 0"),
        ("PINHOLE 640 -480 500 500 320 240", "expected `MODEL width height params...`"),
        ("PINHOLE 640 480 500 -500 320 240", "expected a positive focal length, found -500"),
        ("SIMPLE_RADIAL 640 480 0 320 240 -0.1", "expected a positive focal length, found 0"),
        ("RADIAL 640 480 nan 320 240 -0.1 0", "a camera parameter is not a finite number"),
    ],
)
def test_cameras_that_cannot_be_are_one_line(text, message):
    with pytest.raises(InputError, match=f"^--camera: {re.escape(message)}"):
        Camera.parse("--camera", text)


def test_cameras_of_every_model_are_parsed():
    for model_id, (name, _) in enumerate(CAMERA_MODELS):
        made = pycolmap.Camera.create_from_model_id(1, pycolmap.CameraModelId(model_id), 500, 640, 480)
        camera = Camera(name, 640, 480, tuple(made.params))
        assert Camera.parse("--camera", camera.text()) == camera
        focal_lengths = made.focal_length_idxs() if name != "EQUIRECTANGULAR" else range(2)
        for i in focal_lengths:
            params = tuple(-1.0 if j == i else param for j, param in enumerate(made.params))
            with pytest.raises(InputError, match="a positive focal length, found -1"):
                Camera.parse("--camera", Camera(name, 640, 480, params).text())


@pytest.mark.parametrize("binary", [True, False])
def test_model_is_read_as_it_was_written(tmp_path, binary):
    model = read_model(write_model(tmp_path / "model", CAMERAS, IMAGES, binary))
    assert model.cameras == CAMERAS and list(model.images) == [image.name for image in IMAGES]
    for image in IMAGES:
        read = model.images[image.name]
        assert (read.image_id, read.camera_id, len(read.points2d)) == (image.image_id, image.camera_id, 0)
        assert read.cam_from_world.bits() == image.cam_from_world.bits()
    by_pycolmap = pycolmap.Reconstruction(tmp_path / "model")
    np.testing.assert_array_equal(by_pycolmap.image(5).cam_from_world().translation, IMAGES[0].cam_from_world.tvec)


@pytest.mark.parametrize("binary", [True, False])
def test_points_of_pycolmaps_models_are_read(tmp_path, binary):
    model = pycolmap.Reconstruction(write_model(tmp_path, CAMERAS, IMAGES))
    xy = np.array([[1.5, 2.25], [3.0, 4.0]])
    model.image(9).points2D = pycolmap.Point2DList([pycolmap.Point2D(point) for point in xy])
    track = pycolmap.Track()
    track.add_element(9, 1)
    point3d_id = model.add_point3D(np.zeros(3), track)
    (tmp_path / "out").mkdir()
    (model.write_binary if binary else model.write_text)(str(tmp_path / "out"))
    points = read_model(tmp_path / "out").images["b.jpg"].points2d
    np.testing.assert_array_equal([points["x"], points["y"]], xy.T)
    assert points["point3d_id"].tolist() == [-1, point3d_id]


def test_damaged_models_are_one_error(tmp_path):
    with pytest.raises(InputError, match="holds no COLMAP model"):
        read_model(tmp_path)
    for path in list(write_model(tmp_path / "model", CAMERAS, IMAGES, binary=True).glob("[ci]*.bin")):
        content = path.read_bytes()
        for damaged in (b"", content[:-3], content[:50], content + b"x" * 9, b"\xff" * 40 + content[40:]):
            path.write_bytes(damaged)
            with pytest.raises(InputError, match=f"^{path}: "):
                read_model(tmp_path / "model")
        path.write_bytes(content)


CAMERA_LINE = "1 PINHOLE 640 480 500 500 320 240\n"
IMAGE_LINE = "1 1 0 0 0 0 0 0 1 a.jpg\n\n"


@pytest.mark.parametrize(
    ("cameras", "images", "message"),
    [
        (CAMERA_LINE, IMAGE_LINE + "2 1 0 0 0 0 0 0 7 b.jpg\n\n", "images.txt:3: image 2 ('b.jpg'): its camera 7"),
        (CAMERA_LINE, IMAGE_LINE + "2 1 0 0 0 0 0 0 1 a.jpg\n\n", "images.txt:3: image 2 ('a.jpg'): its name appears"),
        (CAMERA_LINE, IMAGE_LINE.replace(" 1 0 0 0 ", " 0 0 0 0 "), "its quaternion is zero"),
        (CAMERA_LINE, IMAGE_LINE.replace(" 1 0 0 0 ", " nan 0 0 0 "), "the pose is not finite"),
        (CAMERA_LINE, IMAGE_LINE.strip() + "\n2 1 0 0 0 0 0 0 1 b.jpg\n", "expected the points of the image above"),
        (CAMERA_LINE.replace("PINHOLE", "PINHOL"), IMAGE_LINE, "cameras.txt:1: unknown camera model 'PINHOL'"),
        (CAMERA_LINE.replace(" 240", ""), IMAGE_LINE, "cameras.txt:1: camera 1: camera model PINHOLE takes 4"),
    ],
)
def test_errors_are_those_of_the_program(localize, tmp_path, cameras, images, message):
    (tmp_path / "cameras.txt").write_text(cameras)
    (tmp_path / "images.txt").write_text(images)
    with pytest.raises(InputError, match=re.escape(message)) as error:
        read_model(tmp_path)
    run = localize("--database_path", tmp_path / "none.db", "--input_path", tmp_path)
    assert run.exit_code == 1 and str(error.value) in run.stderr


def test_quaternions_of_any_length_and_a_byte_order_mark_are_read(tmp_path):
    (tmp_path / "cameras.txt").write_text("\ufeff" + CAMERA_LINE, encoding="utf-8")
    (tmp_path / "images.txt").write_text("\ufeff" + IMAGE_LINE.replace(" 1 0 0 0 ", " 2 0 0 1e-3 "), encoding="utf-8")
    image = read_model(tmp_path).images["a.jpg"]
    assert image.pose.qvec.tolist() == [2, 0, 0, 1e-3]


def test_a_model_may_have_no_images(tmp_path):
    assert read_model(write_model(tmp_path, CAMERAS, [])).images == {}


def test_pairs_are_the_first_two_names_of_a_line(tmp_path):
    path = tmp_path / "pairs.txt"
    path.write_text("# comment\nquery/a.jpg db/1.jpg\nquery/a.jpg query/a.jpg\nquery/a.jpg db/2.jpg 0.75\r\n")
    assert read_pairs(path) == [("query/a.jpg", "db/1.jpg"), ("query/a.jpg", "db/2.jpg")]
    path.write_text("a b\nc\n")
    with pytest.raises(InputError, match=r"pairs.txt:2: expected two image names"):
        read_pairs(path)
    path.write_text("# nothing\n")
    with pytest.raises(InputError, match=r"pairs.txt: holds no pair"):
        read_pairs(path)


def test_queries_may_have_cameras_and_names_blanks(tmp_path):
    path = tmp_path / "list.txt"
    path.write_text("q/a.jpg SIMPLE_RADIAL 1600 1200 1469.2 800 600 -0.0353\n\n# comment\nmy photo.jpg\nX 1 2\n")
    assert read_queries(path) == {
        "q/a.jpg": Camera("SIMPLE_RADIAL", 1600, 1200, (1469.2, 800.0, 600.0, -0.0353)),
        "my photo.jpg": None,
        "X 1 2": None,
    }
    with pytest.raises(InputError, match=r"list.txt: expected `name MODEL .*found 'my photo.jpg'"):
        read_query_cameras(path)
